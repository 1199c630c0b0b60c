"""Grids asked together answer as each does by itself."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from gdg.geometry.sdf import SignedDistanceGrid
from gdg.geometry.sdf_stack import SdfStack

#: Shapes and spacings of grids that differ on every axis.
SHAPES = (((9, 12, 7), 0.004), ((5, 6, 14), 0.007), ((9, 3, 7), 0.003))


def grid(shape: tuple[int, int, int], spacing: float, seed: int) -> SignedDistanceGrid:
    """A grid of random values, which shows every node that is mistaken for another."""
    generator = torch.Generator().manual_seed(seed)
    values = 0.01 * torch.randn(*shape, generator=generator)
    return SignedDistanceGrid(values, 0.1 * torch.randn(3, generator=generator), spacing)


@pytest.fixture(scope="module")
def grids() -> tuple[SignedDistanceGrid, ...]:
    return tuple(grid(*shape, seed) for seed, shape in enumerate(SHAPES))


def points_of(grids: tuple[SignedDistanceGrid, ...], *shape: int) -> Tensor:
    """Points in, at the border of, and around each grid; (grid × shape[0], …, 3)."""
    generator = torch.Generator().manual_seed(7)
    rows = []
    for one in grids:
        share = 1.6 * torch.rand(*shape, 3, generator=generator) - 0.3
        share[0] = share[0].round()  # corners
        rows.append(one.origin + share * one.extent)
    return torch.cat(rows)


def value_and_gradient(ask, points: Tensor) -> tuple[Tensor, Tensor]:  # type: ignore[no-untyped-def]
    points = points.clone().requires_grad_(True)
    value = ask(points)
    weights = torch.linspace(1, 2, value.numel()).reshape(value.shape)
    return value.detach(), torch.autograd.grad((weights * value).sum(), points)[0]


@pytest.mark.parametrize("what", ["distance", "normals"])
@pytest.mark.parametrize("shape", [(4, 50), (6,)])
def test_a_padded_stack_answers_as_its_grids(grids, what: str, shape: tuple[int, ...]):
    points = points_of(grids, *shape)
    apart = value_and_gradient(getattr(SdfStack(grids, padded=False), what), points)
    padded = value_and_gradient(getattr(SdfStack(grids, padded=True), what), points)
    torch.testing.assert_close(padded[0], apart[0], rtol=1e-4, atol=1e-4)
    # on the border the gradient is that of either side
    inner = torch.ones(len(points), dtype=torch.bool)
    inner[:: shape[0]] = False
    torch.testing.assert_close(padded[1][inner], apart[1][inner], rtol=1e-3, atol=2e-2)
    assert padded[1].abs().max() < 1.5 * apart[1].abs().max()


def test_without_padding_every_grid_gives_its_own_bits(grids):
    stack = SdfStack.of(grids)
    assert not stack.padded
    points = points_of(grids, 4, 30)
    for what in ("distance", "normals"):
        alone = [getattr(g, what)(part) for g, part in zip(grids, points.chunk(3))]
        assert torch.equal(getattr(stack, what)(points), torch.cat(alone))
    one = SdfStack.of(grids[:1])
    assert torch.equal(one.distance(points[:4]), grids[0].distance(points[:4]))


def test_a_grid_may_stand_twice(grids):
    points = points_of(grids, 4, 20)[:4]
    twice = SdfStack((grids[0], grids[0]), padded=True).distance(points.repeat(2, 1, 1))
    assert torch.equal(twice[:4], twice[4:])


@pytest.mark.parametrize("padded", [False, True])
def test_points_that_the_grids_cannot_share_evenly_are_refused(grids, padded: bool):
    with pytest.raises(RuntimeError):
        SdfStack(grids, padded).distance(torch.zeros(4, 2, 3))
