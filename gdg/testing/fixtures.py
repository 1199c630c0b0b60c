"""The small hand, object, grasps and maps that components are tested on."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch

from gdg.components import NoOptions
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.hands.hand import Hand, load_hand
from gdg.kinds.distance import Distance
from gdg.kinds.generator import Generator
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object
from gdg.pipeline.jobs import DEFAULTS
from gdg.protocols import Protocol, load_protocol
from gdg.registry import get_registry
from gdg.testing.gripper import OPEN_M, write_gripper

#: Half the edge of the bundled cube, metres.
HALF_CUBE_M = 0.02
#: The base lies this far under the cube's middle, so that the jaws close on it, metres.
BASE_BELOW_M = 0.035
#: The stand-in's contacts fade over this distance along the surface, metres.
SPOT_M = 0.01


def small_cube(points: int | None = None) -> ObjectModel:
    """The bundled cube of 40 mm, with fewer surface points if a number is given."""
    cube = find_object("cube_small")
    if points is None:
        return cube
    return replace(cube, points=cube.points[:points], normals=cube.normals[:points])


def two_jaws() -> Hand:
    """The two-jaw gripper of ``gdg.testing.gripper``, loaded."""
    with tempfile.TemporaryDirectory() as folder:
        return load_hand(write_gripper(Path(folder)))


def model_of(hand: Hand, surface_points: int = 200) -> HandModel:
    """A hand's model on the CPU, by the kinematics that the command line uses."""
    record = get_registry().find("hand-model", DEFAULTS["hand_model"])
    has_size = "surface_points" in record.options.model_fields
    options = {"surface_points": surface_points} if has_size else {}
    return record.load()(record.options(**options), hand, torch.device("cpu"))


def jaw_grasps(shifts: tuple[float, ...], squeeze: float | None = 0.002) -> GraspSet:
    """The two jaws around the cube, each inner face on it.

    Args:
        shifts: per grasp, how far the hand is moved away along x, metres.
        squeeze: how far the drives' targets lie beyond the joints, metres; None for no targets.
    """
    poses = torch.eye(4).repeat(len(shifts), 1, 1)
    poses[:, 0, 3] = torch.tensor(shifts)
    poses[:, 2, 3] = -BASE_BELOW_M
    joints = torch.full((len(shifts), 1), OPEN_M - HALF_CUBE_M)
    targets = None if squeeze is None else joints + squeeze
    return GraspSet("two_jaws", "cube_small", ("close",), "base", poses, joints, targets)


def quick_protocol(per_direction: bool) -> Protocol:
    """The preset ``dro-2024`` without shifted trials.

    Args:
        per_direction: every push starts anew and is judged by itself.
    """
    preset = load_protocol("dro-2024")
    changes: dict[str, object] = {"shifts": preset.shifts.model_copy(update={"count": 0})}
    if per_direction and preset.pushes is not None:
        changes["pushes"] = preset.pushes.model_copy(update={"order": "reset"})
        changes["success"] = preset.success.model_copy(update={"measured": "per-push"})
    return preset.model_copy(update=changes)


@dataclass(frozen=True)
class GripperCase:
    """What a component is tried on: the two-jaw gripper and the cube."""

    @cached_property
    def hand(self) -> HandModel:
        """The two-jaw gripper."""
        return model_of(two_jaws())

    @cached_property
    def obj(self) -> ObjectModel:
        """The cube, with all its points: networks may rely on their number."""
        return small_cube()


class StandInGenerator(Generator):
    """Contact maps of two spots on opposite sides of an object; needs no weights.

    Args:
        distance: what the maps are written in.
    """

    def __init__(self, distance: Distance):
        super().__init__(NoOptions())
        self._distance = distance

    def generate(self, obj: ObjectModel, count: int, generator: torch.Generator) -> ContactMap:
        """``count`` maps on ``obj.points``; the same generator state gives the same maps."""
        first = torch.randint(len(obj.points), (count,), generator=generator)
        centers = obj.points[first.to(obj.points.device)]
        mirrored = 2 * obj.center_of_mass - centers
        spots = torch.stack((centers, mirrored), dim=1)
        along = torch.cdist(spots, obj.points.expand(count, -1, -1)).amin(1)
        # 1 mm of gap for each SPOT_M along the surface
        gap = 0.001 * (along / SPOT_M).square()
        values = self._distance.contact_value(self._distance.of_gap(gap))
        provenance = {"generator": "stand-in"}
        return ContactMap(obj.name, values, self._distance.label, provenance)
