"""The manifest of a hand folder, ``hand.yaml``, validated. Light: imports no geometry library."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from gdg.validation import PathInside, Plain, validated
from gdg.yaml_files import read_yaml_mapping

MANIFEST = "hand.yaml"
#: What a hand's name looks like.
NAME = r"[a-z0-9][a-z0-9_-]*"
#: A contact region smaller than this, m², has no direction (that of a fingertip has 10 mm²).
MIN_REGION_AREA = 1e-8


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("must be a finite number")
    return value


def _unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    norm = math.hypot(*vector)
    if abs(norm - 1.0) > 0.01:
        raise ValueError(f"must be a unit vector (its length is {norm:.3g})")
    return (vector[0] / norm, vector[1] / norm, vector[2] / norm)


Finite = Annotated[float, AfterValidator(_finite)]
Point = tuple[Finite, Finite, Finite]
UnitVector = Annotated[Point, AfterValidator(_unit)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Palm(_Section):
    """The palm surface, in the frame of its link.

    Attributes:
        link: the link that carries the palm.
        normal: unit vector out of the palm, toward what the hand grasps.
        center: a point on the palm's surface, metres.
    """

    link: str
    normal: UnitVector
    center: Point


class Drive(_Section):
    """Gains of a joint's position drive; a protocol may override stiffness and damping.

    Attributes:
        stiffness: N m/rad (N/m for a prismatic joint).
        damping: N m s/rad.
        force_limit: N m (N for a prismatic joint).
    """

    stiffness: Annotated[Finite, Field(gt=0)] = 20.0
    damping: Annotated[Finite, Field(ge=0)] = 1.0
    force_limit: Annotated[Finite, Field(gt=0)] = 10.0


class Drives(_Section):
    """Default drive and exceptions by joint."""

    default: Drive = Drive()
    joints: dict[str, Drive] = {}

    def of(self, joint: str) -> Drive:
        """The drive of one joint."""
        return self.joints.get(joint, self.default)


class Provenance(_Section):
    """Where the figures come from and on what terms."""

    source: Plain
    licence: Plain


def _area(corners: tuple[Point, Point, Point, Point]) -> tuple[Point, Point, Point, Point]:
    first, second = (
        tuple(b - a for a, b in zip(corners[i], corners[i + 2], strict=True)) for i in (0, 1)
    )
    cross = [first[i - 2] * second[i - 1] - first[i - 1] * second[i - 2] for i in range(3)]
    if math.hypot(*cross) / 2 < MIN_REGION_AREA:
        raise ValueError(
            "the corners span no area; list them counter-clockwise as seen from outside"
        )
    return corners


Region = Annotated[tuple[Point, Point, Point, Point], AfterValidator(_area)]


class HandSpec(_Section):
    """What ``hand.yaml`` says; checked against the URDF by ``gdg.hands.hand.load_hand``.

    Attributes:
        name: the name users type; lower case.
        title: the name people read.
        urdf: path of the URDF inside the folder.
        geometry: which shapes of the URDF are the hand's one geometry; ``visual`` for URDFs whose
            collision shapes are placeholders.
        root_link: the link whose pose is the grasp's pose.
        palm: palm link, outward normal and centre.
        joints: actuated joints in the order of every joint vector; mimic joints are left out.
        open: open posture, joint -> rad (m for a prismatic joint).
        closed: posture with the fingers flexed, same units. A joint that is left out of both
            takes no part in closing and rests in the middle of its range.
        contact_regions: link -> quadrilaterals of four corners, link frame, metres,
            counter-clockwise seen from outside.
        allowed_self_contacts: pairs of links that may touch beyond those that always do
            (neighbours in the chain).
        drives: gains and force limits.
        provenance: sources and licence.
    """

    name: Annotated[str, Field(pattern=f"^{NAME}$")]
    title: Plain = ""
    urdf: PathInside
    geometry: Literal["collision", "visual"] = "collision"
    root_link: str
    palm: Palm
    joints: Annotated[tuple[str, ...], Field(min_length=1)]
    open: dict[str, Finite] = {}
    closed: dict[str, Finite] = {}
    contact_regions: dict[str, list[Region]]
    allowed_self_contacts: list[tuple[str, str]] = []
    drives: Drives = Drives()
    provenance: Provenance

    def joint_references(self) -> Iterable[tuple[str, str]]:
        """Every joint name that the manifest mentions, with the dotted place of the mention."""
        for index, joint in enumerate(self.joints):
            yield f"joints[{index}]", joint
        for section in ("open", "closed"):
            for joint in getattr(self, section):
                yield f"{section}.{joint}", joint
        for joint in self.drives.joints:
            yield f"drives.joints.{joint}", joint

    def link_references(self) -> Iterable[tuple[str, str]]:
        """Every link name that the manifest mentions, with the dotted place of the mention."""
        yield "root_link", self.root_link
        yield "palm.link", self.palm.link
        for link in self.contact_regions:
            yield f"contact_regions.{link}", link
        for index, pair in enumerate(self.allowed_self_contacts):
            for link in pair:
                yield f"allowed_self_contacts[{index}]", link


def read_spec(folder: Path) -> HandSpec:
    """Reads and validates ``hand.yaml``; says every mistake at once.

    Raises:
        GdgError: the file is missing, too large, no YAML, or breaks the schema.
    """
    path = folder / MANIFEST
    return validated(HandSpec, read_yaml_mapping(path), str(path))
