"""Checks of distances: minimum, gradient, symmetries, contact value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from gdg.kinds.distance import Distance, HandDistance
from gdg.rotations import random_rotations
from gdg.testing.checks import differ, seeded
from gdg.testing.fixtures import small_cube

#: Clouds are small: every pair is also computed by itself.
OBJECT_POINTS, HAND_POINTS, BATCH = 32, 60, 3
#: Hand points lie in a ball of this radius around the cube's middle, metres.
REACH_M = 0.08
#: Values are compared to this share of the largest one; float32 sums over a few terms.
TOLERANCE = 1e-4
#: Gradients are compared to this share of the largest entry.
GRADIENT_TOLERANCE = 0.02
#: Step of the finite differences, and the distance that their points keep, metres.
STEP_M, KEEP_OFF_M = 5e-4, 0.02
#: Gaps between hand and surface that a contact map tells apart, metres.
GAPS_M = (0.0005, 0.02)


@dataclass(frozen=True)
class DistanceCase:
    """A distance with a few points of a cube and random hand points around it."""

    distance: Distance

    @cached_property
    def points(self) -> Tensor:
        """Object points."""
        return small_cube(OBJECT_POINTS).points

    @cached_property
    def normals(self) -> Tensor:
        """Their normals."""
        return small_cube(OBJECT_POINTS).normals

    @cached_property
    def hand(self) -> Tensor:
        """Hand points, (batch, hand_point, 3)."""
        directions = torch.randn(BATCH, HAND_POINTS, 3, generator=seeded())
        radius = REACH_M * torch.rand(BATCH, HAND_POINTS, 1, generator=seeded(1))
        return radius * torch.nn.functional.normalize(directions, dim=-1)

    def measure(self, hand: Tensor) -> HandDistance:
        """The distance of the case's object to the given hand points."""
        return self.distance.to_hand(self.points, self.normals, hand)

    @cached_property
    def found(self) -> HandDistance:
        """The distance of object and hand."""
        return self.measure(self.hand)

    @cached_property
    def tolerance(self) -> float:
        """How far two computations of the same distance may be apart."""
        return TOLERANCE * float(self.found.distance.max())


def result(case: DistanceCase) -> Iterator[str]:
    """Shapes, types, ranges and the label are as documented."""
    found, shape = case.found, (BATCH, OBJECT_POINTS)
    if found.distance.shape != shape or found.hand_index.shape != shape:
        yield f"distance and hand_index must have the shape {shape}."
        return
    if found.distance.dtype != torch.float32 or found.hand_index.dtype != torch.int64:
        yield "distance must be float32, hand_index int64."
    if not bool((found.distance.isfinite() & (found.distance >= 0)).all()):
        yield "distances must be finite and not negative."
    if not bool(((found.hand_index >= 0) & (found.hand_index < HAND_POINTS)).all()):
        yield "hand_index must lie in [0, hand points)."
    name, slash, preset = getattr(case.distance, "label", "").partition("/")
    if not (name and slash and preset):
        yield "label must be written 'name/preset'; it tells with which distance a map was made."


def minimum(case: DistanceCase) -> Iterator[str]:
    """The distance is the least over single hand points, and the index names that point."""
    singles = case.measure(case.hand[0][:, None]).distance  # (hand_point, object_point)
    if differ(case.found.distance[0], singles.amin(0), case.tolerance):
        yield "the distance to a hand is not the least of the distances to its points."
    named = singles.gather(0, case.found.hand_index[:1])
    if differ(named, singles.amin(0, keepdim=True), case.tolerance):
        yield "hand_index does not name the hand point of the least distance."
    twice = case.measure(case.hand.repeat(1, 2, 1))
    if bool((twice.hand_index >= HAND_POINTS).any()):
        yield "of two equally near hand points hand_index must name the first."


def given_points(case: DistanceCase) -> Iterator[str]:
    """With ``hand_index`` given, the distance is that to these hand points."""
    shape = (BATCH, OBJECT_POINTS)
    index = torch.randint(HAND_POINTS, shape, generator=seeded(5))
    given = case.distance.to_hand(case.points, case.normals, case.hand, index)
    if differ(given.hand_index, index, 0):
        yield "a hand_index that is given must come back as it is."
    singles = case.measure(case.hand[0][:, None]).distance
    if differ(given.distance[0], singles.gather(0, index[:1])[0], case.tolerance):
        yield "with hand_index given, the distance is not that to the hand points it names."


def gradient(case: DistanceCase) -> Iterator[str]:
    """Gradients in the hand points equal finite differences and touch selected points alone."""
    directions = torch.nn.functional.normalize(case.hand[0], dim=-1)
    reach = case.points.norm(dim=-1).max() + KEEP_OFF_M
    singles = (reach * directions)[:, None]  # one hand point each, so that the winner can't change
    probe = singles.clone().requires_grad_(True)
    (slope,) = torch.autograd.grad(case.measure(probe).distance.sum(), probe)
    for axis, name in enumerate("xyz"):
        step = STEP_M * torch.eye(3)[axis]
        change = case.measure(singles + step).distance - case.measure(singles - step).distance
        expected = change.sum(-1) / (2 * STEP_M)
        if differ(slope[:, 0, axis], expected, GRADIENT_TOLERANCE * float(slope.abs().max())):
            yield f"the gradient along {name} differs from finite differences."
    whole = case.hand.clone().requires_grad_(True)
    found = case.measure(whole)
    (slope,) = torch.autograd.grad(found.distance.sum(), whole)
    chosen = torch.zeros(BATCH, HAND_POINTS, dtype=torch.bool).scatter_(1, found.hand_index, True)
    if bool((slope[~chosen] != 0).any()):
        yield "gradients flow into hand points that no object point selected."


def gradient_in_contact(case: DistanceCase) -> Iterator[str]:
    """The gradient is finite where a hand point lies exactly on an object point."""
    probe = case.points[None].clone().requires_grad_(True)
    (slope,) = torch.autograd.grad(case.measure(probe).distance.sum(), probe)
    if not bool(slope.isfinite().all()):
        yield "the gradient is not finite where a hand point lies on an object point."


def rigid_motion(case: DistanceCase) -> Iterator[str]:
    """Turning and shifting hand and object together changes nothing."""
    rotation = random_rotations(1, seeded(2))[0]
    shift = torch.tensor([0.1, -0.2, 0.05])
    moved = case.distance.to_hand(
        case.points @ rotation.T + shift, case.normals @ rotation.T, case.hand @ rotation.T + shift
    )
    # points that coincide to 0.1 µm after the motion differ more in √d than elsewhere
    if differ(moved.distance, case.found.distance, 10 * case.tolerance):
        yield "moving hand and object together changes the distance: it depends on the frame."


def permutations(case: DistanceCase) -> Iterator[str]:
    """Reordered hand points give the same distance, reordered object points reordered rows."""
    order = torch.randperm(HAND_POINTS, generator=seeded(3))
    if differ(case.measure(case.hand[:, order]).distance, case.found.distance, case.tolerance):
        yield "the order of the hand points changes the distance."
    order = torch.randperm(OBJECT_POINTS, generator=seeded(4))
    turned = case.distance.to_hand(case.points[order], case.normals[order], case.hand)
    if differ(turned.distance, case.found.distance[:, order], case.tolerance):
        yield "reordered object points do not give distances in the same order."


def batches(case: DistanceCase) -> Iterator[str]:
    """A batch of one equals its row in the batch; an empty batch stays empty."""
    for row in range(BATCH):
        alone = case.measure(case.hand[row : row + 1])
        if differ(alone.distance, case.found.distance[row : row + 1], case.tolerance):
            yield f"hand {row} of a batch has another distance than by itself."
    if case.measure(case.hand[:0]).distance.shape != (0, OBJECT_POINTS):
        yield "an empty batch of hands must give an empty batch of distances."


def repetition(case: DistanceCase) -> Iterator[str]:
    """The same points have the same distance, and stay as they are."""
    if differ(case.measure(case.hand).distance, case.found.distance, 0):
        yield "the same points have another distance the second time."
    drawn = [torch.randn(OBJECT_POINTS, 3, generator=seeded(6)) for _ in range(3)]
    points, normals, hand = (torch.nn.functional.normalize(one, dim=-1) for one in drawn)
    given = points.clone(), normals.clone(), hand[None].clone()
    case.distance.to_hand(*given)
    if any(differ(a, b, 0) for a, b in zip(given, (points, normals, hand[None]))):
        yield "to_hand must not write into its arguments."


def contact_value(case: DistanceCase) -> Iterator[str]:
    """In (0, 1], 1 at distance 0, and falling."""
    distances = torch.linspace(0.0, float(case.found.distance.max()), 200)
    values = case.distance.contact_value(distances)
    if values.shape != distances.shape or values.dtype != torch.float32:
        yield "contact_value must keep the shape of its argument, and float32."
        return
    if not bool(((values > 0) & (values <= 1)).all()):
        yield "contact values must lie in (0, 1]."
    if abs(float(values[0]) - 1.0) > 1e-6:
        yield f"the contact value at distance 0 is {float(values[0]):g}, not 1."
    if not bool((values.diff() <= 1e-7).all()) or not float(values[-1]) < float(values[0]):
        yield "contact_value must fall as the distance grows."
    sharp = case.distance.sharpen(values)
    if sharp.shape != values.shape or not bool(((sharp >= 0) & (sharp <= 1)).all()):
        yield "sharpen must keep the shape and the range [0, 1]."


def contact_slope(case: DistanceCase) -> Iterator[str]:
    """The gradient of the contact value equals finite differences."""
    far = float(case.found.distance.max())
    distances = torch.linspace(0.1 * far, far, 50).requires_grad_(True)
    (slope,) = torch.autograd.grad(case.distance.contact_value(distances).sum(), distances)
    step, at = 0.01 * far, distances.detach()
    change = case.distance.contact_value(at + step) - case.distance.contact_value(at - step)
    if differ(slope, change / (2 * step), GRADIENT_TOLERANCE * float(slope.abs().max())):
        yield "the gradient of contact_value differs from finite differences."


def gaps(case: DistanceCase) -> Iterator[str]:
    """``aligned_gap`` is the inverse of ``contact_value`` after ``of_gap``."""
    distance, gap = case.distance, torch.linspace(*GAPS_M, 20)
    back = distance.aligned_gap(distance.contact_value(distance.of_gap(gap)))
    if differ(back, gap, 0.01 * GAPS_M[1]):
        yield "aligned_gap(contact_value(of_gap(gap))) does not give the gap."
    in_front = (case.points + 0.005 * case.normals)[None, :1]
    found = distance.to_hand(case.points[:1], case.normals[:1], in_front).distance[0]
    if differ(found, distance.of_gap(torch.tensor([0.005])), 0.01 * float(found)):
        yield "a hand point 5 mm in front of the surface is not at the distance of_gap(0.005)."


CHECKS = (
    result, minimum, given_points, gradient, gradient_in_contact, rigid_motion, permutations,
    batches, repetition, contact_value, contact_slope, gaps,
)  # fmt: skip
