"""A hand's fingers as sets of pad points, and where on an object each would touch."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gdg.errors import GdgError
from gdg.kinds.hand_model import HandModel, LinkPoints
from gdg.pads import contact_pads
from gdg.quality.fingers import fingers_of_links


@dataclass(frozen=True)
class Fingers:
    """Fingers in the order of the stages, those that oppose each other first.

    Attributes:
        names: the first link of each.
        pads: points of all contact regions of fingers; the palm's are left out.
        finger: of each pad point.
        tip: whether a pad point is on its finger's outermost link that has a region.
    """

    names: tuple[str, ...]
    pads: LinkPoints
    finger: Int[Tensor, "pad"]
    tip: Bool[Tensor, "pad"]

    def __len__(self) -> int:
        return len(self.names)

    def first(self, count: int) -> Fingers:
        """The first ``count`` fingers."""
        kept = self.finger < count
        pads = LinkPoints(
            self.pads.points[kept], self.pads.normals[kept], self.pads.link_index[kept]
        )
        return Fingers(self.names[:count], pads, self.finger[kept], self.tip[kept])


@dataclass(frozen=True)
class Touched:
    """The object point nearest to each finger.

    Attributes:
        index: of the object point.
        gap: how far it is from the finger's nearest pad point, metres.
    """

    index: Int[Tensor, "batch finger"]
    gap: Float[Tensor, "batch finger"]


def fingers_of(hand: HandModel) -> Fingers:
    """The fingers that have contact regions, in an order that depends on the hand alone.

    The first is the one whose pads, in the posture halfway closed, look most against the others';
    then come those that look against it, the one whose tip is nearest to its own first; then the
    others. So the first two or three fingers can hold an object between them, and most grasps
    use them: a thumb and the two fingers whose tips are nearest to its own.

    Raises:
        GdgError: fewer than two fingers have contact regions.
    """
    pads = contact_pads(hand)
    of_link = fingers_of_links(hand.hand)
    owners = [of_link[hand.link_names[link]] for link in pads.link_index.tolist()]
    names = list(dict.fromkeys(name for name in owners if name is not None))
    if len(names) < 2:
        raise GdgError(
            f"hand '{hand.hand.name}': planner unigrasp needs contact_regions on at least two "
            f"fingers, but {len(names)} has any."
        )
    kept = torch.tensor([owner is not None for owner in owners], device=hand.device)
    own = LinkPoints(pads.points[kept], pads.normals[kept], pads.link_index[kept])
    numbers = [names.index(owner) for owner in owners if owner is not None]
    finger = torch.tensor(numbers, device=hand.device)
    tip = _on_tips(hand, own.link_index, finger)
    middle = ((hand.open_posture + hand.closed_posture) / 2)[None]
    poses = hand.link_poses_in_root(middle)
    normals = hand.turn(poses, own.normals, own.link_index)[0]
    points = hand.place(poses, own.points, own.link_index)[0]
    order = _opposing_order(_means(normals, finger), _means(points[tip], finger[tip]))
    place = torch.tensor(order, device=hand.device).argsort()
    return Fingers(tuple(names[number] for number in order), own, place[finger], tip)


def touched(
    fingers: Fingers,
    pads: Float[Tensor, "batch pad 3"],
    points: Float[Tensor, "batch object_point 3"],
) -> Touched:
    """Where each finger of placed hands is nearest to the objects beside them."""
    apart, nearest = torch.cdist(pads, points).min(-1)
    index, gap = [], []
    for number in range(len(fingers)):
        own = (fingers.finger == number).to(pads.device)
        smallest, which = apart[:, own].min(-1)
        gap.append(smallest)
        index.append(nearest[:, own].gather(1, which[:, None])[:, 0])
    return Touched(torch.stack(index, -1), torch.stack(gap, -1))


def _opposing_order(
    normals: Float[Tensor, "finger 3"], tips: Float[Tensor, "finger 3"]
) -> list[int]:
    """Numbers of the fingers, of mean pad normals and tips (metres), as ``fingers_of`` says.

    Ties, which are told to the millimetre, go by number.
    """
    alike = (normals @ normals.T).fill_diagonal_(0)
    first = int(alike.sum(-1).argmin())
    looks_along = (alike[first] >= 0).tolist()
    apart_mm = (1000 * (tips - tips[first]).norm(dim=-1)).round().tolist()
    return sorted(range(len(tips)), key=lambda n: (n != first, looks_along[n], apart_mm[n]))


def _means(values: Float[Tensor, "pad 3"], finger: Int[Tensor, "pad"]) -> Float[Tensor, "finger 3"]:
    """Mean over the pads of each finger."""
    return torch.stack([values[finger == number].mean(0) for number in finger.unique()])


def _on_tips(
    hand: HandModel, link_index: Int[Tensor, "pad"], finger: Int[Tensor, "pad"]
) -> Bool[Tensor, "pad"]:
    """Whether each pad is on the link of its finger that has most moving joints above it."""
    above = hand.hand.rows_above
    depth = torch.tensor([len(above[hand.link_names[link]]) for link in link_index.tolist()])
    depth = depth.to(finger.device)
    deepest = torch.zeros(int(finger.max()) + 1, dtype=depth.dtype, device=finger.device)
    deepest = deepest.scatter_reduce(0, finger, depth, "amax")
    return depth == deepest[finger]
