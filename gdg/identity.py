"""What gdg finds now for the hand and the object that grasps were made with.

A hand's content hash changes with its name or title; ``body_hash`` does not, so that a hand is
known again under another name. An object's content hash is of its geometry alone.
"""

from __future__ import annotations

import json
from typing import Protocol

import numpy as np

from gdg.cache import content_hash
from gdg.errors import GdgError
from gdg.folders import OBJECTS
from gdg.hands.hand import Hand, find_hand
from gdg.objects.model import checked_mesh
from gdg.objects.spec import read_object_spec

#: Numbers closer than this are the same: metres, radians.
RESOLUTION = 1e-6


class Origin(Protocol):
    """Where grasps say they come from; ``ShardInfo`` is one."""

    @property
    def hand(self) -> str: ...  # noqa: D102

    @property
    def hand_path(self) -> str: ...  # noqa: D102

    @property
    def object_name(self) -> str: ...  # noqa: D102

    @property
    def object_path(self) -> str: ...  # noqa: D102

    @property
    def object_scale(self) -> float: ...  # noqa: D102


class Assets:
    """Hands and objects as gdg finds them now, each loaded once; None where it finds none."""

    def __init__(self) -> None:
        self._hands: dict[str, Hand | None] = {}
        self._objects: dict[tuple[str, float], str | None] = {}

    def hand(self, given: str) -> Hand | None:
        """The hand that a name or path means."""
        if given not in self._hands:
            try:
                self._hands[given] = find_hand(given)
            except GdgError:
                self._hands[given] = None
        return self._hands[given]

    def hand_of(self, origin: Origin) -> Hand | None:
        """The hand of some grasps."""
        return self.hand(origin.hand_path or origin.hand)

    def object_hash(self, given: str, scale: float = 1.0) -> str | None:
        """Content hash of the object that a name or path means."""
        if (given, scale) not in self._objects:
            try:
                self._objects[given, scale] = object_hash(given, scale)
            except GdgError:
                self._objects[given, scale] = None
        return self._objects[given, scale]

    def object_hash_of(self, origin: Origin) -> str | None:
        """Content hash of the object of some grasps."""
        return self.object_hash(origin.object_path or origin.object_name, origin.object_scale)


def object_hash(given: str, scale: float = 1.0) -> str:
    """``ObjectModel.content_hash`` of a name or path, without computing distances and masses.

    Raises:
        GdgError: as ``find_object``.
    """
    found = OBJECTS.find(given).path
    path = found if found.is_file() else found / read_object_spec(found).mesh
    return checked_mesh(path, scale)[2]


def body_hash(hand: Hand) -> str:
    """Hash of a hand's joints and shapes, whatever the hand, its joints and links are called.

    Tells that a renamed copy is the same hand. It does not see through changes of the geometry:
    other collision shapes for the same fingers make another body.
    """
    joints = [
        (
            joint.type,
            _rounded(joint.T_parent_child),
            _rounded(joint.axis),
            _rounded([joint.lower, joint.upper]) if joint.type != "fixed" else [],
        )
        for joint in hand.urdf.joints.values()
    ]
    # a mesh's pieces share it, and depend on how it is cut
    shapes = [part.mesh if part.cut_from is None else part.cut_from for part in hand.parts]
    hashes = [content_hash(_bytes(shape.vertices)) for shape in {id(s): s for s in shapes}.values()]
    return content_hash(json.dumps(sorted(joints)), *sorted(hashes))


def _rounded(values: object) -> list[int]:
    return np.rint(np.asarray(values, np.float64).reshape(-1) / RESOLUTION).astype(int).tolist()


def _bytes(values: np.ndarray) -> bytes:
    return np.rint(np.asarray(values, np.float64) / RESOLUTION).astype(np.int64).tobytes()
