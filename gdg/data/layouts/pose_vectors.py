"""q vectors of MultiDex and its descendants: translation, rotation, joints without names.

Two forms are in use: 3 + 6 + N of MultiDex and CMapDataset (GenDexGrasp), whose six numbers are the
first two columns of the root's rotation, and 3 + 3 + N of the files that D(R,O) filtered from
them, whose three are angles about moving axes x, y, z. N counts every joint of the kinematic chain,
mimic joints included, in the order of pytorch_kinematics.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gdg.data.layouts.chain import chain_joints, chain_values
from gdg.data.layouts.foreign import ForeignGrasps, PairToExport
from gdg.data.layouts.rotations import (
    columns_from_rotation,
    nearest_rotation,
    poses_from,
    rotation_from_columns,
    rotation_from_moving_xyz,
)
from gdg.errors import GdgError

#: Longer vectors are no hand's.
MAX_LENGTH = 500


@dataclass(frozen=True)
class KnownHand:
    """A hand of the published files: the link whose pose they give, and the order of the joints."""

    root_link: str
    joints: tuple[str, ...]


def _shadow_joints() -> tuple[str, ...]:
    lengths = (("FF", 4), ("MF", 4), ("RF", 4), ("LF", 5), ("TH", 5))
    fingers = (f"{finger}J{n}" for finger, count in lengths for n in range(count, 0, -1))
    return ("WRJ2", "WRJ1", *fingers)


_EZ = "left_ezgripper_knuckle"
#: The five hands of MultiDex, by the URDFs that its authors used.
KNOWN_HANDS = {
    "ezgripper": KnownHand(
        "world",
        (f"{_EZ}_palm_L1_1", f"{_EZ}_L1_L2_1", f"{_EZ}_palm_L1_2", f"{_EZ}_L1_L2_2"),
    ),
    "barrett": KnownHand(
        "bh_base_link", tuple(f"bh_j{n}_joint" for n in (32, 33, 11, 12, 13, 21, 22, 23))
    ),
    "robotiq_3finger": KnownHand(
        "palm_base",
        (
            *(f"gripper_fingerA_joint_{n}" for n in (2, 3, 4)),
            *(
                f"gripper_finger{finger}_{joint}"
                for finger in "BC"
                for joint in ("knuckle", "joint_2", "joint_3", "joint_4")
            ),
        ),
    ),
    "allegro": KnownHand(
        "base_link",
        tuple(f"joint_{n}.0" for n in (8, 9, 10, 11, 4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15)),
    ),
    "shadowhand": KnownHand("forearm", _shadow_joints()),
}


@dataclass(frozen=True)
class VectorRow:
    """One grasp as a file holds it."""

    q: Tensor
    object_name: str
    hand: str


def vector_rows(source: str, metadata: Any, first: int) -> list[VectorRow]:
    """Checks a ``metadata`` list: tuples of q, object and hand from position ``first`` on.

    Raises:
        GdgError: naming the first entry that is something else.
    """
    if not isinstance(metadata, list):
        raise GdgError(f"{source}: 'metadata' is no list.")
    rows = []
    for index, entry in enumerate(metadata):
        values: Sequence[Any] = entry[first:] if isinstance(entry, (tuple, list)) else ()
        q, names = (values[0], values[1:]) if values else (None, ())
        if [type(name) for name in names] != [str, str] or not isinstance(q, Tensor):
            raise GdgError(
                f"{source}: metadata[{index}] is no tuple of "
                f"{'a contact map, ' if first else ''}a tensor q, an object's and a hand's name."
            )
        if q.is_nested or q.ndim != 1 or not 6 < len(q) <= MAX_LENGTH:
            raise GdgError(f"{source}: metadata[{index}]: q has the shape {tuple(q.shape)}.")
        if q.layout != torch.strided or not q.is_floating_point() or q.device.type != "cpu":
            raise GdgError(
                f"{source}: metadata[{index}]: q is no plain tensor of floating-point numbers."
            )
        rows.append(VectorRow(q.detach(), *names))
    return rows


def grasps_of_rows(
    source: str,
    rows: Sequence[VectorRow],
    info: Mapping[str, Any],
    euler: bool = False,
    own_order: bool = False,
) -> list[ForeignGrasps]:
    """The grasps of each hand-object pair, pairs and grasps in the file's order.

    Args:
        source: the file's name.
        rows: its grasps.
        info: hand -> what the file says of it; gdg's own files name joints and root link there.
        euler: take q of unknown hands for the form with angles.
        own_order: do not name the joints of ``KNOWN_HANDS``.
    """
    pairs: dict[tuple[str, str, int], list[Tensor]] = {}
    for row in rows:
        pairs.setdefault((row.hand, row.object_name, len(row.q)), []).append(row.q)
    read = []
    for (hand, object_name, length), vectors in pairs.items():
        q = torch.stack(vectors).to(torch.float64).numpy()
        facts = info.get(hand)
        named = _named(source, facts) or (None if own_order else KNOWN_HANDS.get(hand))
        root = _root_length(hand, length, named, euler)
        angles = root == 6
        to_rotation = rotation_from_moving_xyz if angles else rotation_from_columns
        fits = named is not None and len(named.joints) == length - root
        read.append(
            ForeignGrasps(
                source=source,
                hand=hand,
                object_name=object_name,
                poses=poses_from(q[:, :3], to_rotation(q[:, 3:root])),
                joints=q[:, root:],
                joint_names=named.joints if named is not None and fits else None,
                root_link=named.root_link if named is not None and not angles else "",
            )
        )
    return read


def vector_of_pair(pair: PairToExport) -> Tensor:
    """(grasp, 9 + joints) q vectors of the MultiDex form, float32, chain order."""
    poses = pair.grasps.poses.double().numpy()
    columns = [pair.grasps.joint_names.index(name) for name in pair.hand.spec.joints]
    joints = chain_values(pair.hand, pair.grasps.joints.double().numpy()[:, columns])
    rotation = columns_from_rotation(nearest_rotation(poses[:, :3, :3]))
    q = np.concatenate((poses[:, :3, 3], rotation, joints), axis=1)
    return torch.from_numpy(q.astype(np.float32))


def hand_info(pairs: Iterable[PairToExport]) -> dict[str, Any]:
    """What the published files say of a hand, and, for gdg, its joints and root link."""
    counts: dict[str, int] = {}
    hand = None
    for pair in pairs:
        hand = pair.hand
        name = pair.grasps.object_name
        counts[name] = counts.get(name, 0) + len(pair.grasps)
    assert hand is not None
    return {
        "robot_name": hand.name,
        "num_total": sum(counts.values()),
        "num_upper_object": max(counts.values()),
        "num_per_object": counts,
        "joint_names": list(chain_joints(hand)),
        "root_link": hand.spec.root_link,
    }


def by_hand(pairs: Iterable[PairToExport]) -> dict[str, list[PairToExport]]:
    """Hand -> its pairs, in order."""
    hands: dict[str, list[PairToExport]] = {}
    for pair in pairs:
        hands.setdefault(pair.grasps.hand, []).append(pair)
    return hands


def _named(source: str, facts: Any) -> KnownHand | None:
    """The joints and root link that a file of gdg's names."""
    if not isinstance(facts, Mapping) or "joint_names" not in facts:
        return None
    names, root_link = facts["joint_names"], facts.get("root_link", "")
    if not isinstance(names, list) or not all(isinstance(n, str) for n in (*names, root_link)):
        raise GdgError(f"{source}: info: 'joint_names' is no list of names.")
    return KnownHand(root_link, tuple(names))


def _root_length(hand: str, length: int, named: KnownHand | None, euler: bool) -> int:
    """How many numbers of q stand before the joints: 9, or 6 with angles."""
    known = named or KNOWN_HANDS.get(hand)
    if known is not None:
        for root in (9, 6):
            if length - root == len(known.joints):
                return root
    return 6 if euler or length <= 9 else 9
