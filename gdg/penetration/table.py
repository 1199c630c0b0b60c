"""How much of a hand is inside the table that an object rests on, and how high its links are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import torch
import trimesh
from jaxtyping import Float, Int
from torch import Tensor

from gdg.data.table import Table
from gdg.kinds.hand_model import HandModel
from gdg.penetration.blocks import link_blocks, pose_array


def table_penetration(
    hand: HandModel,
    tables: Sequence[Table | None],
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    stride: int = 1,
    margin_m: float = 0.0,
) -> tuple[Float[Tensor, "batch"], Float[Tensor, "batch"]]:
    """Summed penetration and the largest term, as ``penetration`` has them of an object; metres.

    Args:
        hand: the hand.
        tables: one per object, each for an equal share of the poses; None: no table.
        Ts_world_link: link poses; metres.
        stride: as that of ``penetration``.
        margin_m: likewise.
    """
    ups, offsets = _planes(tables, Ts_world_link)
    if Ts_world_link.device.type == "cpu":
        found: Any = _TablePenetration.apply(Ts_world_link, hand, ups, offsets, stride, margin_m)
        return found
    return eager_table_penetration(hand, ups, offsets, Ts_world_link, stride, margin_m)


def eager_table_penetration(
    hand: HandModel,
    ups: Float[Tensor, "object 3"],
    offsets: Float[Tensor, "object"],
    Ts_world_link: Float[Tensor, "batch link 4 4"],
    stride: int,
    margin_m: float,
) -> tuple[Float[Tensor, "batch"], Float[Tensor, "batch"]]:
    """The same by plain tensor operations: the reference, on any device."""
    each = len(Ts_world_link) // len(ups)
    up, offset = ups.repeat_interleave(each, 0), offsets.repeat_interleave(each, 0)[:, None]

    def depths(points: Tensor, link: Tensor, radii: Tensor | float) -> Tensor:
        heights = (hand.place(Ts_world_link, points, link) @ up[:, :, None])[..., 0] - offset
        return torch.relu(margin_m + radii - heights)

    spheres, surface = hand.spheres, hand.surface
    in_spheres = depths(spheres.centers, spheres.link_index, spheres.radii)
    at_points = depths(surface.points[::stride], surface.link_index[::stride], 0.0)
    deepest = torch.nn.functional.pad(torch.cat((at_points, in_spheres), -1), (0, 1)).amax(-1)
    return stride * at_points.sum(-1) + in_spheres.sum(-1), deepest.detach()


def _planes(
    tables: Sequence[Table | None], like: Tensor
) -> tuple[Float[Tensor, "object 3"], Float[Tensor, "object"]]:
    """Normals and offsets; where there is no table, one so far below that nothing reaches it."""
    ups = [(0.0, 0.0, 1.0) if table is None else tuple(table.up.tolist()) for table in tables]
    offsets = [-1e6 if table is None else table.offset for table in tables]
    device = like.device
    return torch.tensor(ups, device=device), torch.tensor(offsets, device=device)


class _TablePenetration(torch.autograd.Function):
    """The compiled pass, whose gradient is made along with the value."""

    @staticmethod
    def forward(
        ctx: Any,
        Ts: Tensor,
        hand: HandModel,
        ups: Tensor,
        offsets: Tensor,
        stride: int,
        margin_m: float,
    ) -> tuple[Tensor, Tensor]:
        from gdg.penetration import compiled_table  # compiles (or loads its cache) on import

        blocks = link_blocks(hand, stride)
        poses = np.split(pose_array(Ts), len(ups)) if len(ups) > 1 else [pose_array(Ts)]
        found = [
            compiled_table.table_penetration(
                own, up.numpy(), float(offset), *blocks.shape_arguments, float(stride), margin_m
            )
            for own, up, offset in zip(poses, ups, offsets)
        ]
        summed, deepest, gradient = (
            torch.from_numpy(parts[0] if len(parts) == 1 else np.concatenate(parts))
            for parts in zip(*found)
        )
        ctx.save_for_backward(gradient)
        ctx.mark_non_differentiable(deepest)
        return summed, deepest

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor, None, None, None, None, None]:
        (gradient,) = ctx.saved_tensors
        return grads[0][:, None, None, None] * gradient, None, None, None, None, None


def link_heights(
    hand: HandModel, table: Table, Ts_world_link: Float[Tensor, "batch link 4 4"]
) -> Float[Tensor, "batch link"]:
    """How high the lowest point of each link is above a table, metres; below it is negative.

    Exact on the collision shapes: the lowest corner of a polyhedron, the lowest point of a sphere.
    A link without shapes is infinitely high; poses that are not finite give NaN.
    """
    corners = _corners(hand)
    (up,), (offset,) = _planes([table], Ts_world_link)
    planes = (up @ Ts_world_link[..., :3, :]).detach()  # height = plane · (x, y, z, 1) + offset
    heights = (planes[:, corners.link_index] * corners.points).sum(-1) - corners.radii - offset
    lowest = heights.new_full(Ts_world_link.shape[:2], torch.inf)
    return lowest.scatter_reduce(1, corners.link_index.expand_as(heights), heights, "amin")


def hand_height(
    hand: HandModel, table: Table, q: Float[Tensor, "batch dof"]
) -> Float[Tensor, "batch"]:
    """Height of the lowest point of a hand above a table, metres; see ``link_heights``."""
    return link_heights(hand, table, hand.link_poses(q)).amin(-1)


def raised(
    hand: HandModel,
    table: Table,
    q: Float[Tensor, "batch dof"],
    clearance_m: float | Float[Tensor, "batch"] = 0.0,
) -> Float[Tensor, "batch dof"]:
    """q with hands that reach below ``clearance_m`` above a table moved up to there, metres."""
    missing = torch.relu(clearance_m - hand_height(hand, table, q))
    (up,), _ = _planes([table], q)
    return torch.cat((q[:, :3] + missing[:, None] * up, q[:, 3:]), dim=-1)


@dataclass(frozen=True)
class _Corners:
    """What can be the lowest point of a link: corners of its hull, and spheres.

    Attributes:
        points: (x, y, z, 1) in link frames, metres.
        radii: 0 for corners.
        link_index: into ``HandModel.link_names``.
    """

    points: Float[Tensor, "corner 4"]
    radii: Float[Tensor, "corner"]
    link_index: Int[Tensor, "corner"]


_CACHE: WeakKeyDictionary[HandModel, _Corners] = WeakKeyDictionary()


def _corners(hand: HandModel) -> _Corners:
    if hand not in _CACHE:
        _CACHE[hand] = _find_corners(hand)
    return _CACHE[hand]


def _find_corners(hand: HandModel) -> _Corners:
    points, radii, index = [np.zeros((0, 3))], [np.zeros(0)], [np.zeros(0, np.int64)]
    for link, name in enumerate(hand.link_names):
        parts = hand.hand.parts_of(name)
        spheres = [part for part in parts if part.kind == "sphere"]
        solid = [part.mesh.vertices for part in parts if part.kind != "sphere"]
        own = [part.T_link_part[None, :3, 3] for part in spheres]
        if solid:
            own.append(trimesh.convex.convex_hull(np.concatenate(solid)).vertices)
        own_radii = np.zeros(sum(map(len, own)))
        own_radii[: len(spheres)] = [part.size[0] for part in spheres]
        points += own
        radii.append(own_radii)
        index.append(np.full(len(own_radii), link))
    all_points = np.concatenate(points)
    ones = np.ones((len(all_points), 1))
    return _Corners(
        torch.as_tensor(np.concatenate((all_points, ones), 1), dtype=torch.float32).to(hand.device),
        torch.as_tensor(np.concatenate(radii), dtype=torch.float32).to(hand.device),
        torch.as_tensor(np.concatenate(index), device=hand.device),
    )
