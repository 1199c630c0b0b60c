"""Contact maps of grasps, and maps rewritten from one distance into another."""

from __future__ import annotations

import re

import torch
from jaxtyping import Float
from torch import Tensor

from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.registry import get_registry
from gdg.validation import validated

#: Grasps whose maps are computed at once; bounds the memory.
BATCH = 64
#: In a distance's label: an option that differs from the preset's.
CHANGED_OPTION = re.compile(r"-([a-z_]+)([0-9.]+(?:e[+-]?[0-9]+)?)")


def contact_map_of(
    hand: HandModel, obj: ObjectModel, q: Float[Tensor, "grasp dof"], distance: Distance
) -> ContactMap:
    """The maps that a hand in the poses q makes on an object, one row per grasp."""
    values = contact_values(hand, obj.points, obj.normals, q, distance)
    return ContactMap(obj.name, values, distance.label)


@torch.no_grad()
def contact_values(
    hand: HandModel,
    points: Float[Tensor, "object_point 3"],
    normals: Float[Tensor, "object_point 3"],
    q: Float[Tensor, "grasp dof"],
    distance: Distance,
) -> Float[Tensor, "grasp object_point"]:
    """The contact values that a hand in the poses q makes at some points of an object."""
    rows = []
    for batch in q.to(hand.device).split(BATCH):
        found = distance.to_hand(points, normals, hand.surface_points(batch))
        rows.append(distance.contact_value(found.distance))
    return torch.cat(rows) if rows else torch.zeros(0, len(points))


def contact_maps_of_grasps(
    hand: HandModel, obj: ObjectModel, grasps: GraspSet, distance: Distance
) -> ContactMap:
    """The maps of stored grasps; joints are matched by name, whatever their order.

    Raises:
        GdgError: as ``q_of_grasps``.
    """
    return contact_map_of(hand, obj, q_of_grasps(hand, grasps), distance)


def q_of_grasps(hand: HandModel, grasps: GraspSet) -> Float[Tensor, "grasp dof"]:
    """Pose vectors of stored grasps; joints are matched by name, whatever their order.

    Raises:
        GdgError: the hand has other joints or another root link than the grasps were made with.
    """
    made_with = f"the grasps of '{grasps.hand}' on '{grasps.object_name}'"
    if grasps.root_link != hand.hand.spec.root_link:
        raise GdgError(
            f"{made_with} give the pose of link '{grasps.root_link}', but the root link of "
            f"'{hand.hand.name}' is '{hand.hand.spec.root_link}'; use the hand folder that they "
            f"were made with."
        )
    if sorted(grasps.joint_names) != sorted(hand.joint_names):
        raise GdgError(
            f"{made_with} have the joints {', '.join(grasps.joint_names)}, but "
            f"'{hand.hand.name}' has {', '.join(hand.joint_names)}; use the hand folder that they "
            f"were made with."
        )
    columns = [grasps.joint_names.index(name) for name in hand.joint_names]
    return hand.q_of(grasps, grasps.joints[:, columns])


def in_distance(maps: ContactMap, distance: Distance) -> Float[Tensor, "map object_point"]:
    """The values of maps as ``distance`` would have made them.

    Maps of the same distance come back as they are. Others are rewritten through the gap, in
    metres along the normal, at which each value arises; that is exact for aligned points.

    Raises:
        GdgError: the maps name a distance that no plugin provides, or options it doesn't have.
    """
    if maps.distance == distance.label:
        return maps.values
    source = _distance_of(maps.distance)
    return distance.contact_value(distance.of_gap(source.aligned_gap(maps.values)))


def values_on(
    obj: ObjectModel, maps: ContactMap, distance: Distance
) -> Float[Tensor, "map object_point"]:
    """The values of maps at an object's points, as ``distance`` would have made them.

    Raises:
        GdgError: the maps lie on other points; or see ``in_distance``.
    """
    if maps.values.shape[1] != len(obj.points):
        raise GdgError(
            f"the contact maps of '{maps.object_name}' have {maps.values.shape[1]} values, but "
            f"'{obj.name}' has {len(obj.points)} points; generate the maps on this object."
        )
    return in_distance(maps, distance)


def _distance_of(label: str) -> Distance:
    """The distance that wrote a label: ``name/preset``, ``name/preset-option0.5``."""
    name, _, rest = label.partition("/")
    record = get_registry().find("distance", name)
    options: dict[str, str] = dict(CHANGED_OPTION.findall(rest))
    if "preset" in record.options.model_fields:
        options["preset"] = CHANGED_OPTION.sub("", rest)
    where = f"contact maps made with '{label}'"
    return record.load()(validated(record.options, options, where))
