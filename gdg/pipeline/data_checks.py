"""Checks grasps of a dataset against the hands and objects that gdg finds now."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gdg.data.findings import FileFinding
from gdg.data.grasps import GraspSet
from gdg.data.shards import ShardInfo
from gdg.hands.hand import Hand
from gdg.identity import Assets

#: How far a joint may be beyond its limit, rad or m: what single precision and a closing
#: refinement leave.
LIMIT_TOLERANCE = 1e-3


class AssetChecks:
    """Checks shards one after the other; what concerns a whole hand or object is told once."""

    def __init__(self, assets: Assets | None = None):
        self._assets = assets or Assets()
        self._told: set[tuple[str, str]] = set()

    def __call__(self, info: ShardInfo, grasps: GraspSet) -> Iterator[FileFinding]:
        """What is wrong with a shard's grasps."""
        hand = self._assets.hand_of(info)
        if hand is not None and hand.content_hash == info.hand_hash:
            yield from _joint_findings(info, grasps, hand)
        elif self._first(info.hand, info.hand_hash):
            yield _warning(info, "hand", info.hand, str(hand.folder) if hand else "")
        if self._first(info.object_name, info.object_hash):
            found = self._assets.object_hash_of(info)
            if found != info.object_hash:
                where = info.object_path or info.object_name
                yield _warning(info, "object", info.object_name, where if found else "")

    def _first(self, name: str, content: str) -> bool:
        if (name, content) in self._told:
            return False
        self._told.add((name, content))
        return True


def _warning(info: ShardInfo, what: str, name: str, found: str) -> FileFinding:
    if found:
        text = f"its {what} '{name}' has another content than {found} now; gdg train refuses it."
    else:
        text = f"its {what} '{name}' is not found here, so nothing was compared with it."
    return FileFinding("warning", info.path, text)


def _joint_findings(info: ShardInfo, grasps: GraspSet, hand: Hand) -> Iterator[FileFinding]:
    if info.joint_names != hand.spec.joints:
        yield FileFinding(
            "error",
            info.path,
            f"its joints are {', '.join(info.joint_names)}; those of {hand.name} are "
            f"{', '.join(hand.spec.joints)}.",
        )
        return
    if info.root_link != hand.spec.root_link:
        yield FileFinding(
            "error",
            info.path,
            f"its poses are those of the link '{info.root_link}'; the root of {hand.name} is "
            f"'{hand.spec.root_link}'.",
        )
    lower, upper = hand.limits()
    values = grasps.joints.numpy()
    beyond = np.maximum(lower - values, values - upper)
    rows, columns = np.nonzero(beyond > LIMIT_TOLERANCE)
    if len(rows):
        worst = int(np.argmax(beyond[rows, columns]))
        yield FileFinding(
            "error",
            info.path,
            f"{len(set(rows.tolist()))} of {len(grasps)} grasps exceed joint limits, most by "
            f"{beyond[rows, columns][worst]:.3g} ({hand.spec.joints[columns[worst]]} in row "
            f"{rows[worst]}).",
        )
