"""Which grasps a training run may see. Test objects and held-out hands never enter.

``gdg.training.leaks`` refuses them, under whatever name.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gdg.data.shards import ShardInfo, shards
from gdg.errors import GdgError, did_you_mean
from gdg.folders import HANDS, OBJECTS
from gdg.hands.hand import Hand
from gdg.identity import Assets
from gdg.splits import SplitLock, bare_name, load_split, where_is_object
from gdg.training.job import TrainJob
from gdg.training.leaks import (
    refuse_by_lock,
    refuse_renamed_hands,
    refuse_renamed_objects,
    refuse_test_objects,
)


@dataclass(frozen=True)
class Split:
    """Shards to train on, and shards of other train objects to choose the best epoch by.

    Attributes:
        train: to train on.
        validation: to choose by.
        lock: what divided them, or None where the job's ``val_fraction`` did.
    """

    train: tuple[ShardInfo, ...]
    validation: tuple[ShardInfo, ...]
    lock: SplitLock | None = None

    def objects(self, which: str) -> list[str]:
        """Object names of ``train`` or ``validation``, sorted."""
        return sorted({info.object_name for info in getattr(self, which)})

    def held_out_hands(self) -> list[str]:
        """Names of the hands that the lock holds out, sorted."""
        entries = self.lock.hands.held_out if self.lock is not None else ()
        return sorted({entry.name for entry in entries})

    def record(self) -> dict[str, str]:
        """Name and content hash of the lock, as they stand in the run's record."""
        if self.lock is None:
            return {"split": "none", "split_sha256": ""}
        return {"split": self.lock.label, "split_sha256": self.lock.content_hash}


def choose_shards(job: TrainJob, hand: Hand | None = None) -> Split:
    """The shards of the allowed hands and objects, divided by object.

    Args:
        job: what to leave out, and how to divide.
        hand: the only one to learn from; all by default.

    Raises:
        GdgError: no data, a test object or a held-out hand among them, an unknown hand or object
            excluded, grasps of different hands of one name, or too few objects to hold some out.
    """
    lock = load_split(job.split) if job.split else None
    found = [info for info in shards(Path(job.data).expanduser()) if info.count]
    refuse_test_objects(found)
    _refuse_unknown(job, found)
    left_out = {bare_name(name) for name in job.exclude_object}
    objects = [info for info in found if bare_name(info.object_name) not in left_out]
    allowed = [info for info in objects if info.hand not in job.exclude_hand]
    if hand is not None:
        allowed = _of_hand(hand, allowed, job)
    if not allowed:
        without = ", ".join((*job.exclude_hand, *job.exclude_object))
        raise GdgError(f"data: {job.data}{without and f' without {without}'} holds no grasps.")
    _refuse_namesakes(allowed)
    assets = Assets()
    excluded = [info for info in found if info.hand in job.exclude_hand]
    refuse_renamed_hands(allowed, excluded, job.exclude_hand, assets)
    refuse_renamed_objects(
        allowed, [info for info in found if bare_name(info.object_name) in left_out]
    )
    if lock is not None:
        refuse_by_lock(allowed, lock, assets)
    held_out = _validation_objects(allowed, job, lock)
    return Split(
        tuple(info for info in allowed if bare_name(info.object_name) not in held_out),
        tuple(info for info in allowed if bare_name(info.object_name) in held_out),
        lock,
    )


def _of_hand(hand: Hand, found: Sequence[ShardInfo], job: TrainJob) -> list[ShardInfo]:
    own = [info for info in found if info.hand == hand.name]
    if hand.name in job.exclude_hand:
        raise GdgError(f"exclude_hand: '{hand.name}' is the hand to be trained for.")
    if not own:
        others = ", ".join(sorted({info.hand for info in found})) or "none"
        raise GdgError(f"data: {job.data} holds no grasps of hand '{hand.name}'; it has: {others}.")
    other = next((info for info in own if info.hand_hash != hand.content_hash), None)
    if other is not None:
        raise GdgError(
            f"data: {other.path}: its grasps are of another hand '{hand.name}' than "
            f"{hand.folder}; write hand= the folder that they were made with, or synthesise them "
            f"anew."
        )
    return own


def _refuse_namesakes(allowed: Sequence[ShardInfo]) -> None:
    """Raises if hands of one name differ: what is recorded of a run names one of each."""
    first: dict[str, ShardInfo] = {}
    for info in allowed:
        known = first.setdefault(info.hand, info)
        if known.hand_hash != info.hand_hash:
            raise GdgError(
                f"data: {known.path} and {info.path} hold grasps of different hands, both named "
                f"'{info.hand}'; remove those of one of them."
            )


def _refuse_unknown(job: TrainJob, found: Sequence[ShardInfo]) -> None:
    hands = {info.hand for info in found} | set(HANDS.all())
    for hand in job.exclude_hand:
        if hand not in hands:
            raise GdgError(f"exclude_hand: there is no hand '{hand}'.{did_you_mean(hand, hands)}")
    objects: Collection[str] = {bare_name(info.object_name) for info in found} | {
        bare_name(name) for name in OBJECTS.all()
    }
    for name in job.exclude_object:
        if bare_name(name) not in objects:
            raise GdgError(
                f"exclude_object: there is no object '{name}'.{did_you_mean(name, objects)}"
            )


def _validation_objects(
    allowed: Sequence[ShardInfo], job: TrainJob, lock: SplitLock | None
) -> set[str]:
    """Bare names of the objects to hold out: all meshes of one object stay together."""
    objects = sorted({bare_name(info.object_name) for info in allowed})
    if lock is not None:
        return _locked_validation(allowed, job, lock)
    if job.val_fraction == 0:
        if job.keep == "best":
            raise GdgError("keep=best needs validation objects; write keep=last or a val_fraction.")
        return set()
    count = max(1, round(job.val_fraction * len(objects)))
    if count >= len(objects):
        raise GdgError(
            f"val_fraction: {job.val_fraction:g} of {len(objects)} object(s) leaves none to train "
            f"on; give data of more objects, or val_fraction=0 with keep=last."
        )
    order = np.random.default_rng(job.seed).permutation(len(objects))
    return {objects[index] for index in order[:count]}


def _locked_validation(allowed: Sequence[ShardInfo], job: TrainJob, lock: SplitLock) -> set[str]:
    where = {
        bare_name(info.object_name): where_is_object(lock, info.object_name, info.object_hash)
        for info in allowed
    }
    held_out = {name for name, part in where.items() if part == "validation"}
    if held_out == set(where):
        raise GdgError(f"data: {job.data} holds no train object of the split {lock.label}.")
    if not held_out and job.keep == "best":
        raise GdgError(
            f"keep=best needs validation objects, but {job.data} holds none of the split "
            f"{lock.label}; write keep=last."
        )
    return held_out
