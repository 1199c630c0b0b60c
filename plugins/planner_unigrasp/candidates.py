"""Candidate sets of contact points: a beam of stages, ranked with force closure."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gdg.force_closure import force_closure_error
from gdg.objects.model import ObjectModel
from gdg.scenes.reach import reachable

from .network import ContactSelection, Scene, Stage
from .options import UniGraspOptions

#: Sets that a stage continues at once; bounds the memory at some 0.1 GB for 2048 points.
CHUNK = 32
#: Steps of the search for balancing forces.
BALANCE_STEPS = 100


@dataclass(frozen=True)
class Candidates:
    """Sets of contact points, best first.

    Attributes:
        index: object points, one per finger.
        cost: −log probability per contact plus the weighted force-closure error, nats.
        force_closure: ‖G f‖ of the best forces.
        rejected: sets without force closure.
    """

    index: Int[Tensor, "set finger"]
    cost: Float[Tensor, "set"]
    force_closure: Float[Tensor, "set"]
    rejected: int


@torch.no_grad()
def candidates(
    network: ContactSelection, obj: ObjectModel, contacts: int, options: UniGraspOptions
) -> Candidates:
    """The ``options.top`` best sets of contacts of the first fingers; nothing in it is random.

    Points that a table keeps from fingers are left out.
    """
    scene = network.scene(obj.points[None], obj.normals[None])
    near = torch.cdist(obj.points, obj.points) < options.spacing_m
    hidden = ~reachable(obj)
    index = torch.zeros(1, 0, dtype=torch.long, device=obj.points.device)
    log_probability = torch.zeros(1, device=obj.points.device)
    for number in range(contacts):
        stage = network.stages[number]
        assert isinstance(stage, Stage)
        # the first stage has one set to continue, so it fills the beam by itself
        branch = options.width if number == 0 else options.branch
        index, log_probability = _continued(
            stage, scene, near, hidden, index, log_probability, branch
        )
        if number + 1 < contacts:
            kept = log_probability.argsort(descending=True, stable=True)[: options.width]
            index, log_probability = index[kept], log_probability[kept]
    error = set_force_closure(obj, index)
    cost = options.force_closure_weight * error - log_probability / contacts
    closed = (error <= options.max_force_closure).nonzero()[:, 0]
    best = closed[cost[closed].argsort(stable=True)][: options.top]
    return Candidates(index[best], cost[best], error[best], len(index) - len(closed))


def set_force_closure(obj: ObjectModel, index: Int[Tensor, "set finger"]) -> Float[Tensor, "set"]:
    """‖G f‖ of pushes along the inward normals, f ≥ 0 with Σ f = 1 chosen as well as possible.

    ``gdg.force_closure`` with equal forces, as in DFC, would refuse a thumb against two fingers.
    """
    points = obj.points[index] - obj.center_of_mass
    normals = obj.normals[index]
    share = balancing_forces(points, normals, obj.reach)
    # its mean over contacts becomes the weighted sum
    weighted = normals * (share * index.shape[1])[..., None]
    return force_closure_error(points, weighted, obj.reach)


def balancing_forces(
    points: Float[Tensor, "batch contact 3"],
    normals: Float[Tensor, "batch contact 3"],
    length: float,
) -> Float[Tensor, "batch contact"]:
    """Forces ≥ 0 with sum 1 along the normals whose net wrench is smallest.

    By accelerated projected gradient on ‖W f‖², W the unit wrenches, torques divided by
    ``length``; its norm ends within some hundredths of the least.
    """
    wrenches = torch.cat((normals, torch.linalg.cross(points, normals) / length), -1)
    gram = wrenches @ wrenches.mT
    # the trace bounds the largest eigenvalue, so that no step overshoots
    rate = 1 / gram.diagonal(dim1=-2, dim2=-1).sum(-1, keepdim=True)
    share = torch.full_like(normals[..., 0], 1 / normals.shape[1])
    ahead = share
    for step in range(BALANCE_STEPS):
        descended = _on_simplex(ahead - rate * (gram @ ahead[..., None])[..., 0])
        ahead = descended + step / (step + 3) * (descended - share)
        share = descended
    return share


def _on_simplex(values: Float[Tensor, "batch contact"]) -> Float[Tensor, "batch contact"]:
    """The nearest shares: ≥ 0, with sum 1."""
    falling = values.sort(-1, descending=True).values
    number = torch.arange(1, values.shape[-1] + 1, device=values.device)
    level = (falling.cumsum(-1) - 1) / number
    last = (falling > level).sum(-1, keepdim=True) - 1
    return torch.relu(values - level.gather(-1, last))


def _continued(
    stage: Stage,
    scene: Scene,
    near: Bool[Tensor, "object_point object_point"],
    hidden: Bool[Tensor, "object_point"],
    index: Int[Tensor, "set earlier"],
    log_probability: Float[Tensor, "set"],
    branch: int,
) -> tuple[Int[Tensor, "longer_set finger"], Float[Tensor, "longer_set"]]:
    """Every set with each of its best next points, which keep their distance from each other."""
    longer, probabilities = [], []
    for chosen, known in zip(index.split(CHUNK), log_probability.split(CHUNK), strict=True):
        rows = torch.zeros(len(chosen), dtype=torch.long, device=chosen.device)
        scores = torch.log_softmax(stage(scene.of(rows), chosen), dim=-1)
        scores = scores.masked_fill(hidden, -torch.inf)
        for earlier in chosen.T:  # two fingers don't touch the same place
            scores = scores.masked_fill(near[earlier], -torch.inf)
        for _ in range(branch):
            found, point = scores.max(-1)
            some = found.isfinite()
            longer.append(torch.cat((chosen, point[:, None]), -1)[some])
            probabilities.append((known + found)[some])
            scores = scores.masked_fill(near[point], -torch.inf)
    return torch.cat(longer), torch.cat(probabilities)
