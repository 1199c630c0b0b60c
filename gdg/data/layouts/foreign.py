"""What passes between a layout's file and gdg: grasps as the file says them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.hands.hand import Hand


@dataclass(frozen=True)
class ForeignGrasps:
    """Grasps of one hand on one object, read from a file of another layout.

    Attributes:
        source: the file's name, for messages.
        hand: the hand's name in the file; "" where the layout names none.
        object_name: the object's name in gdg.
        poses: (grasp, 4, 4) float64, T_object_root, metres.
        joints: (grasp, value) float64, rad or m.
        joint_names: names of the columns, or None: the order of the URDF's chain.
        root_link: the link that the poses are of; "" where the file does not say.
        object_lookup: by what the object is found, if not by its name.
        object_scale: factor from the mesh to the object that was grasped.
        split: ``train``, ``test`` or "" where the file does not say.
        energies: name -> (grasp,) values.
    """

    source: str
    hand: str
    object_name: str
    poses: np.ndarray
    joints: np.ndarray
    joint_names: tuple[str, ...] | None = None
    root_link: str = ""
    object_lookup: str = ""
    object_scale: float = 1.0
    split: str = ""
    energies: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class PairToExport:
    """Grasps of one hand-object pair on their way into another layout.

    Attributes:
        hand: the loaded hand.
        grasps: what to write.
        object_lookup: by what the object is found.
        object_scale: factor from the mesh's unit to metres.
        object_hash: content hash of the object that was grasped.
        split: ``train``, ``test`` or "".
    """

    hand: Hand
    grasps: GraspSet
    object_lookup: str
    object_scale: float
    object_hash: str
    split: str


def file_name(noun: str, name: str) -> str:
    """A hand's or object's name as the name of a file or folder that an export writes.

    Raises:
        GdgError: it would lead elsewhere, or is no file's name.
    """
    if not name.isprintable() or "/" in name or "\\" in name or name[:1] in ("", "."):
        raise GdgError(f"{noun} {name[:80]!r}: its name can't be a file's name.")
    return name
