"""Placing points of links: compiled against plain tensor operations."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
import torch
from torch import Tensor

from gdg.placement import place_points
from gdg.placement.eager import place_each, place_shared

BATCH, LINKS, POINTS = 67, 4, 37
PLACED = {"shared": place_shared, "each": place_each}


def drawn(kind: str) -> tuple[Tensor, Tensor, Tensor]:
    """Poses (any affine ones), points and links; some link has no point."""
    generator = torch.Generator().manual_seed(1)
    shape = (POINTS,) if kind == "shared" else (BATCH, POINTS)
    Ts = torch.randn(BATCH, LINKS, 4, 4, generator=generator).requires_grad_(True)
    points = torch.randn(*shape, 3, generator=generator).requires_grad_(True)
    return Ts, points, torch.randint(LINKS - 1, shape, generator=generator)


@pytest.fixture(params=[1, 2])
def threads(request: pytest.FixtureRequest) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("kind", PLACED)
def test_the_compiled_pass_gives_the_values_and_gradients_of_the_reference(kind: str):
    Ts, points, links = drawn(kind)
    reference: Callable[..., Tensor] = PLACED[kind]
    expected, found = reference(Ts, points, links), place_points(Ts, points, links)
    assert found.shape == expected.shape
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)
    weights = torch.randn(found.shape, generator=torch.Generator().manual_seed(2))
    want = torch.autograd.grad((weights * expected).sum(), (Ts, points))
    have = torch.autograd.grad((weights * found).sum(), (Ts, points))
    for one, other in zip(have, want, strict=True):
        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-5)
    assert not have[0][:, LINKS - 1].any()


@pytest.mark.parametrize("kind", PLACED)
def test_no_pose_gives_no_point(kind: str):
    Ts, points, links = drawn(kind)
    own = points if kind == "shared" else points[:0]
    placed = place_points(Ts[:0], own, links if kind == "shared" else links[:0])
    assert placed.shape == (0, POINTS, 3)


def test_what_the_compiled_pass_could_not_bear_is_refused():
    Ts, points, links = drawn("each")
    with pytest.raises(IndexError, match=r"link_index must lie in \[0, 4\)"):
        place_points(Ts, points, links + LINKS)
    with pytest.raises(ValueError, match="must be those of every pose or of 67 poses"):
        place_points(Ts, points[:3], links[:3])
    with pytest.raises(ValueError, match="must be those"):
        place_points(Ts, points, links[0])
