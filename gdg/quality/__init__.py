"""What is measured of a finished grasp: overlap, contacts, and what the contacts can resist."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.contacts import ContactSet
from gdg.data.grasps import GraspSet
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.quality.contact_points import find_contacts
from gdg.quality.fingers import fingers_of_links
from gdg.quality.overlap import Overlap, exact_overlap
from gdg.quality.wrench_space import (
    FRICTION,
    WrenchSpace,
    force_closure_margin,
    wrench_space,
)

__all__ = [
    "METRICS",
    "Overlap",
    "WrenchSpace",
    "exact_overlap",
    "find_contacts",
    "force_closure_margin",
    "force_closure_margins",
    "measure",
    "wrench_space",
]

#: The metric that ``measure`` gives beside the others in a table-top scene.
TABLE_METRIC = "table_penetration_mm"
#: Names of the metrics that ``measure`` gives, in order.
METRICS = (
    "penetration_mm",
    "self_penetration_mm",
    "contacts",
    "contact_links",
    "contact_fingers",
    "epsilon",
    "wrench_volume",
    "wrench_residual",
)


def measure(
    hand: HandModel, obj: ObjectModel, grasps: GraspSet, friction: float = FRICTION
) -> GraspSet:
    """The same grasps with ``contacts`` and these ``metrics``, beside those they have.

    - ``penetration_mm``: the deepest overlap of a part of the hand and one of the object,
      millimetres (``exact_overlap``); NaN for a grasp that is not finite.
    - ``self_penetration_mm``: the same of links that must not touch, millimetres.
    - ``table_penetration_mm``: the same of the hand in the table, millimetres; only where the
      object rests on one.
    - ``contacts``: number of contact points (``find_contacts``).
    - ``contact_links``: number of links with a contact.
    - ``contact_fingers``: number of fingers with a contact, the palm not counted.
    - ``epsilon``, ``wrench_volume``, ``wrench_residual``: no unit (``WrenchSpace``); torques per
      the object's largest distance from its centre of mass.

    Args:
        hand: the hand.
        obj: the object.
        grasps: of that hand on that object.
        friction: Coulomb's coefficient between them.
    """
    overlap = exact_overlap(hand, obj, grasps)
    contacts = find_contacts(hand, obj, grasps)
    fingers = fingers_of_links(hand.hand)
    links = [set(contacts.links[contacts.rows(index)]) for index in range(len(grasps))]
    spaces = _wrench_spaces(obj, contacts, friction)
    columns = (
        overlap.object_mm,
        overlap.self_mm,
        contacts.counts,
        [len(touching) for touching in links],
        [len({fingers[link] for link in touching} - {None}) for touching in links],
        [space.epsilon for space in spaces],
        [space.volume for space in spaces],
        [space.residual for space in spaces],
    )
    measured = {
        name: torch.as_tensor(column).to(torch.float32)
        for name, column in zip(METRICS, columns, strict=True)
    }
    if obj.table is not None:
        measured[TABLE_METRIC] = overlap.table_mm
    return replace(grasps, metrics={**grasps.metrics, **measured}, contacts=contacts)


def force_closure_margins(
    obj: ObjectModel, contacts: ContactSet, friction: float = FRICTION
) -> Float[Tensor, "grasp"]:
    """``force_closure_margin`` of each grasp; torques per the object's reach."""
    margins = [
        force_closure_margin(points, normals, obj.reach, friction)
        for points, normals in _around_center(obj, contacts)
    ]
    return torch.tensor(margins, dtype=torch.float32)


def _wrench_spaces(obj: ObjectModel, contacts: ContactSet, friction: float) -> list[WrenchSpace]:
    return [
        wrench_space(points, normals, obj.reach, friction)
        for points, normals in _around_center(obj, contacts)
    ]


def _around_center(
    obj: ObjectModel, contacts: ContactSet
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Points, relative to the centre of mass, and normals of each grasp's contacts."""
    center = obj.center_of_mass.cpu().double().numpy()
    points, normals = contacts.points.double().numpy() - center, contacts.normals.double().numpy()
    for index in range(len(contacts)):
        rows = contacts.rows(index)
        yield points[rows], normals[rows]
