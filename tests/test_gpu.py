"""What is computed on a GPU agrees with the CPU; skipped where there is none."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from gdg.config import compose
from gdg.fitting.energy import FitEnergy
from gdg.fitting.particles import ParticleFitter
from gdg.initial_poses import above_surface
from gdg.nearest import EPSILON_M, nearest_hand_points
from gdg.nearest.fused import can_fuse
from gdg.pipeline.jobs import DEFAULTS, PairJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.registry import get_registry

GPU = "cuda"
pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU")


@pytest.fixture(params=["barrett", "allegro"])
def pairs(request: pytest.FixtureRequest) -> tuple[Pair, Pair]:
    """The same hand and object on the CPU and on the GPU."""
    return pair_on("cpu", request.param), pair_on(GPU, request.param)


def pair_on(device: str, hand: str) -> Pair:
    words = f"hand={hand}", "object=mug", f"device={device}"
    return Pair.load(compose(PairJob, get_registry(), DEFAULTS, (), words)[0])


def energy_and_gradient(pair: Pair, q: Tensor) -> tuple[dict[str, Tensor], Tensor]:
    """Every term at q against one map, and the gradient of the total, on the CPU."""
    fitter, values = pair.components.get("fitter"), torch.linspace(0, 1, len(pair.obj.points))
    assert isinstance(fitter, ParticleFitter)
    energy = FitEnergy(
        pair.hand, pair.obj, pair.obj.points, pair.obj.normals, values[None].to(pair.hand.device),
        pair.hand.surface, fitter.distance, fitter.options,
    )  # fmt: skip
    probe = q.to(pair.hand.device).requires_grad_(True)
    maps = torch.zeros(len(q), dtype=torch.long, device=pair.hand.device)
    terms = energy.terms(probe, maps)
    energy.total(terms).sum().backward()
    assert probe.grad is not None
    names = ("contact", "penetration", "depth", "limits", "self_penetration")
    return {name: getattr(terms, name).detach().cpu() for name in names}, probe.grad.cpu()


def test_energy_and_gradient_agree(pairs: tuple[Pair, Pair]):
    q = above_surface(pairs[0].hand, pairs[0].obj, 64, generator_for(0))
    (terms, gradient), (expected, on_cpu) = (
        energy_and_gradient(pair, q) for pair in reversed(pairs)
    )
    for name, values in expected.items():
        torch.testing.assert_close(terms[name], values, rtol=1e-3, atol=1e-5, msg=name)
    torch.testing.assert_close(gradient, on_cpu, rtol=1e-2, atol=1e-3)


def test_the_nearest_hand_points_agree(pairs: tuple[Pair, Pair]):
    on_cpu, on_gpu = pairs
    q = above_surface(on_cpu.hand, on_cpu.obj, 32, generator_for(0))
    hand = on_cpu.hand.surface_points(q)
    expected = nearest_hand_points(on_cpu.obj.points, on_cpu.obj.normals, hand, 1.0)
    obj = on_gpu.obj
    found = nearest_hand_points(obj.points, obj.normals, hand.to(GPU), 1.0).cpu()
    assert can_fuse(hand.to(GPU).device)

    def scores(index: Tensor) -> Tensor:
        chosen = torch.gather(hand, 1, index[..., None].expand(-1, -1, 3)) - on_cpu.obj.points
        length = chosen.norm(dim=-1)
        along = (chosen * on_cpu.obj.normals).sum(-1) / (length + EPSILON_M)
        return length * torch.exp(-2 * along)

    torch.testing.assert_close(scores(found), scores(expected), rtol=1e-4, atol=1e-7)


def test_generated_maps_agree(pairs: tuple[Pair, Pair]):
    maps = [
        pair.components.get("generator").generate(pair.obj, 4, generator_for(0)).values.cpu()
        for pair in pairs
    ]
    torch.testing.assert_close(maps[1], maps[0], rtol=0, atol=2e-2)


def test_plans_agree_in_quality(pairs: tuple[Pair, Pair]):
    energies = [pair.plan(4, generator_for(0)).energies["total"].mean() for pair in pairs]
    torch.testing.assert_close(energies[1], energies[0], rtol=0.1, atol=0.02)
