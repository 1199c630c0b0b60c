"""How deep the links of a hand lie in each other."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from gdg.geometry.overlap import ConvexBody, body_of, penetration_depth
from gdg.hands.geometry import ConvexPart
from gdg.hands.hand import Hand

Pair = tuple[str, str]


class LinkBodies:
    """The convex parts of a hand, ready to be tested against each other in any posture.

    Args:
        hand: the hand.
    """

    def __init__(self, hand: Hand):
        self._names = hand.link_names
        self._link = np.array([self._names.index(part.link) for part in hand.parts])
        self._bodies = [_body(part) for part in hand.parts]
        bounds = np.array([part.mesh.bounds for part in hand.parts])
        self._middles = bounds.mean(1)
        self._radii = np.linalg.norm(bounds[:, 1] - bounds[:, 0], axis=-1) / 2

    def overlaps(
        self,
        Ts_root_link: Float[np.ndarray, "link 4 4"],
        apart: Bool[np.ndarray, "link link"],
        ignored_m: float,
    ) -> dict[Pair, float]:
        """Pairs of links -> how deep they lie in each other, metres, if more than ``ignored_m``.

        Args:
            Ts_root_link: poses of all links.
            apart: pairs of links that are looked at; symmetric.
            ignored_m: smaller depths are left out.

        Returns:
            Names in the order of ``Hand.link_names``; of links with several convex parts the
            deepest two count.
        """
        Ts = Ts_root_link[self._link]
        middles = np.einsum("nij,nj->ni", Ts[:, :3, :3], self._middles) + Ts[:, :3, 3]
        gaps = np.linalg.norm(middles[:, None] - middles, axis=-1)
        near = gaps < self._radii[:, None] + self._radii - ignored_m
        near &= apart[self._link][:, self._link] & (self._link[:, None] < self._link)
        found: dict[Pair, float] = {}
        for first, second in np.argwhere(near).tolist():
            one, other = (self._bodies[i].placed(Ts[i]) for i in (first, second))
            depth = penetration_depth(one, other, ignored_m)
            pair = self._names[self._link[first]], self._names[self._link[second]]
            if depth > max(ignored_m, found.get(pair, 0.0)):
                found[pair] = depth
        return found


def _body(part: ConvexPart) -> ConvexBody:
    if part.kind == "sphere":
        return ConvexBody(part.T_link_part[None, :3, 3], np.zeros((0, 3)), part.size[0])
    return body_of(part.mesh)
