"""A hand's points and spheres grouped by link, with bounding balls, as arrays for compiled code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float
from torch import Tensor

from gdg.kinds.hand_model import HandModel

Array: TypeAlias = np.ndarray


@dataclass(frozen=True)
class LinkBlocks:
    """Arrays that ``gdg.penetration.compiled`` takes; link frames, metres, float32.

    Attributes:
        balls: centre and radius of a ball around all of a link, (link, 4).
        points: every so-manieth surface point, (point, 3), grouped by link.
        point_starts: first point of each link, and the number of points.
        spheres: inscribed spheres, centre and radius, (sphere, 4), grouped by link.
        sphere_starts: first sphere of each link, and their number.
        sphere_links: link of each sphere.
        link_pairs: links with spheres that must stay apart, (link_pair, 2).
        pair_starts: first sphere pair of each, and their number.
        pairs: sphere pairs, (pair, 2), into ``spheres``.
        reach: distance that each pair must keep.
    """

    balls: np.ndarray
    points: np.ndarray
    point_starts: np.ndarray
    spheres: np.ndarray
    sphere_starts: np.ndarray
    sphere_links: np.ndarray
    link_pairs: np.ndarray
    pair_starts: np.ndarray
    pairs: np.ndarray
    reach: np.ndarray

    @property
    def shape_arguments(self) -> tuple[Array, Array, Array, Array, Array]:
        """What compiled passes over an object take of a hand, in order."""
        return self.balls, self.points, self.point_starts, self.spheres, self.sphere_starts

    @property
    def pair_arguments(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """What compiled passes over a hand alone take, in order."""
        pairs = (self.link_pairs, self.pair_starts, self.pairs, self.reach)
        return (self.balls, *pairs, self.spheres)


def pose_array(Ts_world_link: Float[Tensor, "batch link 4 4"]) -> np.ndarray:
    """Link poses as compiled passes take them."""
    return Ts_world_link.detach().float().contiguous().numpy()


_CACHE: WeakKeyDictionary[HandModel, dict[int, LinkBlocks]] = WeakKeyDictionary()


def link_blocks(hand: HandModel, stride: int = 1) -> LinkBlocks:
    """The blocks of a hand with every ``stride``-th surface point, built once."""
    made = _CACHE.setdefault(hand, {})
    if stride not in made:
        made[stride] = _build(hand, stride)
    return made[stride]


def _build(hand: HandModel, stride: int) -> LinkBlocks:
    links = len(hand.link_names)
    points, point_starts, _ = _grouped(
        hand.surface.points[::stride].cpu().numpy(),
        hand.surface.link_index[::stride].cpu().numpy(),
        links,
    )
    found = hand.spheres
    centers, radii = found.centers.cpu().numpy(), found.radii.cpu().numpy()
    joined = np.concatenate((centers, radii[:, None]), axis=1).astype(np.float32)
    spheres, sphere_starts, order = _grouped(joined, found.link_index.cpu().numpy(), links)
    link_pairs, pair_starts, pairs, reach = _pairs(
        found.reach.cpu().numpy()[np.ix_(order, order)], sphere_starts
    )
    return LinkBlocks(
        _balls(points, point_starts, spheres, sphere_starts),
        points,
        point_starts,
        spheres,
        sphere_starts,
        found.link_index.cpu().numpy()[order],
        link_pairs,
        pair_starts,
        pairs,
        reach,
    )


def _grouped(
    rows: np.ndarray, link: np.ndarray, links: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows sorted by link, the first of each link, and the order that sorts them."""
    order = np.argsort(link, kind="stable")
    starts = np.searchsorted(link[order], np.arange(links + 1))
    return np.ascontiguousarray(rows[order], np.float32), starts.astype(np.int64), order


def _balls(
    points: np.ndarray, point_starts: np.ndarray, spheres: np.ndarray, sphere_starts: np.ndarray
) -> np.ndarray:
    """A ball around the points and spheres of each link; a link without any gets radius 0."""
    balls = np.zeros((len(point_starts) - 1, 4), np.float32)
    for link in range(len(balls)):
        own = points[point_starts[link] : point_starts[link + 1]]
        round_ = spheres[sphere_starts[link] : sphere_starts[link + 1]]
        centers = np.concatenate((own, round_[:, :3]))
        if not len(centers):
            continue
        radii = np.concatenate((np.zeros(len(own)), round_[:, 3]))
        center = (centers.min(0) + centers.max(0)) / 2
        balls[link, :3] = center
        balls[link, 3] = (np.linalg.norm(centers - center, axis=1) + radii).max() * 1.00001
    return balls


def _pairs(
    reach: np.ndarray, sphere_starts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Sphere pairs with a positive reach, grouped by their pair of links (i < j)."""
    both = np.maximum(reach, reach.T)  # sorting by link may have left a pair in the lower triangle
    link = np.searchsorted(sphere_starts, np.arange(len(reach)), side="right") - 1
    s, t = np.nonzero(np.triu(both > 0, 1))
    key = np.stack((link[s], link[t]), axis=1)
    order = np.lexsort((key[:, 1], key[:, 0]))
    s, t, key = s[order], t[order], key[order]
    link_pairs, starts = np.unique(key, axis=0, return_index=True)
    return (
        link_pairs.astype(np.int64).reshape(-1, 2),
        np.append(starts, len(s)).astype(np.int64),
        np.stack((s, t), axis=1).astype(np.int64),
        both[s, t].astype(np.float32),
    )
