"""Joint vectors without names: the order of a hand's kinematic chain, mimic joints included.

pytorch_kinematics lists joints depth first, the children of a link in the order of the URDF; the
published datasets use that order, and treat joints that mimic others as free.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gdg.data.layouts.foreign import ForeignGrasps
from gdg.errors import GdgError
from gdg.hands.hand import Hand
from gdg.hands.urdf import MOVING_TYPES, Joint

#: A mimic joint that strays further from its master, rad or m, is told.
COUPLING_TOLERANCE = 1e-3


def chain_joints(hand: Hand) -> tuple[str, ...]:
    """All joints that move, in the order of pytorch_kinematics."""
    children: dict[str, list[Joint]] = {}
    for joint in hand.urdf.joints.values():  # children of one link stand in the URDF's order
        children.setdefault(joint.parent, []).append(joint)

    def below(link: str) -> Iterator[str]:
        for joint in children.get(link, ()):
            if joint.type in MOVING_TYPES:
                yield joint.name
            yield from below(joint.child)

    return tuple(below(hand.urdf.root))


def chain_values(hand: Hand, joints: np.ndarray) -> np.ndarray:
    """(grasp, moving joint) values in the chain's order, from (grasp, actuated) values."""
    matrix, offset = hand.coupling
    rows = [joint.name for joint in hand.moving_joints]
    order = [rows.index(name) for name in chain_joints(hand)]
    return (joints @ matrix.T + offset)[:, order]


def actuated_values(hand: Hand, read: ForeignGrasps) -> tuple[np.ndarray, float]:
    """The hand's actuated joints, declared order, and how far others stray from their coupling.

    Returns:
        (grasp, actuated) values, and the largest difference of a mimic or passive joint in the
        file from what its master demands, rad or m (0 where the file holds none).

    Raises:
        GdgError: the file's joints aren't the hand's.
    """
    names = read.joint_names or _unnamed(hand, read)
    columns = _columns(hand, read, names)
    values = read.joints[:, [columns[name] for name in hand.spec.joints]]
    matrix, offset = hand.coupling
    strays = 0.0
    for row, joint in enumerate(hand.moving_joints):
        if joint.name in columns and joint.name not in hand.spec.joints and len(values):
            demanded = values @ matrix[row] + offset[row]
            strays = max(
                strays, float(np.abs(read.joints[:, columns[joint.name]] - demanded).max())
            )
    return values, strays


def _unnamed(hand: Hand, read: ForeignGrasps) -> tuple[str, ...]:
    """Names for columns that have none: all moving joints, or those that mimic none."""
    every, count = chain_joints(hand), read.joints.shape[1]
    free = tuple(name for name in every if hand.urdf.joints[name].mimic is None)
    for names in (every, free):
        if len(names) == count:
            return names
    also = "" if len(free) == len(every) else f", {len(free)} without mimic joints"
    raise GdgError(
        f"{read.source}: {count} joint values per grasp, but {hand.folder} has {len(every)} joints"
        f"{also}, in the order of its chain: {', '.join(every)}."
    )


def _columns(hand: Hand, read: ForeignGrasps, names: Sequence[str]) -> dict[str, int]:
    """Joint of the hand -> column. A prefix up to a colon (``robot0:``) may differ."""
    known = {joint.name for joint in hand.moving_joints}
    bare = {_bare(name): name for name in known}
    columns = {}
    for column, name in enumerate(names):
        columns[name if name in known else bare.get(_bare(name), name)] = column
    missing = [name for name in hand.spec.joints if name not in columns]
    foreign = [name for name in columns if name not in known]
    if missing or foreign or len(columns) != len(names):
        there = f"lacks {', '.join(missing)}" if missing else ""
        too_many = f"has {', '.join(foreign)} besides" if foreign else ""
        what = " and ".join(filter(None, (there, too_many))) or "names a joint twice"
        raise GdgError(
            f"{read.source}: the file {what}, so it is not of the hand {hand.folder} (joints "
            f"{', '.join(hand.spec.joints)}). Give the hand that it was made with: "
            f"--hand {read.hand + '=' if read.hand else ''}FOLDER (gdg hands new makes one of a "
            f"URDF or MJCF file)."
        )
    return columns


def _bare(name: str) -> str:
    return name.rpartition(":")[2]
