"""Points on a hand's contact regions: the pads that it is meant to touch with."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.errors import GdgError
from gdg.kinds.hand_model import HandModel, LinkPoints

#: Neighbouring points of a region are about this far apart, metres.
SPACING_M = 0.006


def contact_pads(hand: HandModel, spacing_m: float = SPACING_M) -> LinkPoints:
    """Points that cover every contact region of a hand, region by region, with their normals.

    A region is cut into equal cells of at most ``spacing_m`` in both directions; the points are
    the cells' middles.

    Raises:
        GdgError: the hand has no contact regions.
    """
    regions = hand.regions
    if len(regions.corners) == 0:
        raise GdgError(
            f"hand '{hand.hand.name}': this planner needs contact_regions in hand.yaml; "
            f"'gdg hands new' proposes them."
        )
    parts = [_cell_middles(corners, spacing_m) for corners in regions.corners]
    counts = torch.tensor([len(part) for part in parts], device=hand.device)
    return LinkPoints(
        torch.cat(parts),
        regions.normals.repeat_interleave(counts, dim=0),
        regions.link_index.repeat_interleave(counts),
    )


def _cell_middles(corners: Float[Tensor, "4 3"], spacing_m: float) -> Float[Tensor, "point 3"]:
    """Middles of the cells of one quadrilateral, by bilinear interpolation."""
    a, b, c, d = corners
    along = max(float((b - a).norm()), float((c - d).norm()))
    across = max(float((d - a).norm()), float((c - b).norm()))
    u, v = (_middles(length, spacing_m).to(corners) for length in (along, across))
    u, v = u[:, None, None], v[None, :, None]
    points = (1 - u) * ((1 - v) * a + v * d) + u * ((1 - v) * b + v * c)
    return points.reshape(-1, 3)


def _middles(length_m: float, spacing_m: float) -> Float[Tensor, "cell"]:
    cells = max(1, round(length_m / spacing_m))
    return (torch.arange(cells) + 0.5) / cells
