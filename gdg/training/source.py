"""Which grasps a training run may see, and their contact maps.

Test objects and held-out hands never enter (``gdg.training.leaks``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from gdg.cache import UNREADABLE, cache_directory, content_hash
from gdg.config import ComponentChoice
from gdg.contact_maps import contact_maps_of_grasps
from gdg.data.atomic import atomic_path
from gdg.data.dataset import read_shard
from gdg.data.grasps import GraspSet
from gdg.data.shards import ShardInfo, shards
from gdg.errors import GdgError, did_you_mean
from gdg.folders import HANDS
from gdg.hands.hand import find_hand
from gdg.identity import Assets
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel, find_object
from gdg.splits import SplitLock, bare_name, load_split, where_is_object
from gdg.training.job import TrainJob
from gdg.training.leaks import TEST, refuse_by_lock, refuse_renamed_hands, refuse_test_objects
from gdg.training.maps import MapGroup

#: Grasps whose maps are made at once.
CHUNK = 256
#: Objects that are kept in memory; one that was dropped is loaded again.
MAX_OBJECTS = 64


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


def choose_shards(job: TrainJob) -> Split:
    """The shards of the allowed hands, divided by object.

    Raises:
        GdgError: no data, a test object or a held-out hand among them, an unknown hand excluded,
            or too few objects to hold some out.
    """
    lock = load_split(job.split) if job.split else None
    found = [info for info in shards(Path(job.data).expanduser()) if info.count]
    refuse_test_objects(found)
    _refuse_unknown_hands(job, {info.hand for info in found})
    allowed = [info for info in found if info.hand not in job.exclude_hand]
    if not allowed:
        without = f" without {', '.join(job.exclude_hand)}" if job.exclude_hand else ""
        raise GdgError(f"data: {job.data}{without} holds no grasps.")
    assets = Assets()
    excluded = [info for info in found if info.hand in job.exclude_hand]
    refuse_renamed_hands(allowed, excluded, job.exclude_hand, assets)
    if lock is not None:
        refuse_by_lock(allowed, lock, assets)
    held_out = _validation_objects(allowed, job, lock)
    return Split(
        tuple(info for info in allowed if bare_name(info.object_name) not in held_out),
        tuple(info for info in allowed if bare_name(info.object_name) in held_out),
        lock,
    )


def _refuse_unknown_hands(job: TrainJob, in_data: set[str]) -> None:
    known = in_data | set(HANDS.all())
    for hand in job.exclude_hand:
        if hand not in known:
            raise GdgError(f"exclude_hand: there is no hand '{hand}'.{did_you_mean(hand, known)}")


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


class MapSource:
    """Computes the contact maps of shards, once: they are cached by the content they follow from.

    Args:
        distance: what the maps are made with.
        hand_model: the component that places the hands.
    """

    def __init__(self, distance: ComponentChoice, hand_model: ComponentChoice):
        self._recipe = "\n".join(
            f"{choice.record.version} {sorted(choice.as_tree().items())}"
            for choice in (distance, hand_model)
        )
        self.distance: Distance = distance.record.load()(distance.options)
        self._hand_model = hand_model
        self._hands: dict[str, HandModel] = {}
        self._objects: dict[tuple[str, float], ObjectModel] = {}
        #: Content hashes of the shards that were read, by path.
        self.shard_hashes: dict[Path, str] = {}

    def group(self, info: ShardInfo) -> MapGroup | None:
        """The maps of a shard's good grasps; None where it has none.

        Good are those that a simulation passed, or all where none was run.

        Raises:
            GdgError: the shard can't be read, or its hand or object are not what they were.
        """
        obj, path = self._object(info), self._cache_path(info)
        count = _stored_maps(path)
        if count is None:
            values = self._maps(info, obj)
            count = len(values)
            with atomic_path(path) as temporary, temporary.open("wb") as stream:
                np.save(stream, values)
        if not count:
            return None
        return MapGroup(info.hand, info.object_name, obj.points, path, count)

    def _maps(self, info: ShardInfo, obj: ObjectModel) -> np.ndarray:
        """The maps in half precision, made a chunk at a time: in single they are large."""
        grasps, maps = good_grasps(read_shard(info.path)), [np.empty((0, len(obj.points)), "f2")]
        for start in range(0, len(grasps), CHUNK):
            chunk = grasps.select(range(start, min(start + CHUNK, len(grasps))))
            made = contact_maps_of_grasps(self._hand(info), obj, chunk, self.distance)
            maps.append(made.values.half().numpy())
        return np.concatenate(maps)

    def _cache_path(self, info: ShardInfo) -> Path:
        # every shard of schema 2 knows its checksum; of an older one the bytes are read
        shard_hash = info.checksum or content_hash(info.path.read_bytes())
        self.shard_hashes[info.path] = shard_hash
        parts = ("maps-1", shard_hash, info.hand_hash, info.object_hash, self._recipe)
        return cache_directory() / "maps" / f"{content_hash(*parts)}.npy"

    def _hand(self, info: ShardInfo) -> HandModel:
        given = info.hand_path or info.hand
        if given not in self._hands:
            hand = find_hand(given)
            choice = self._hand_model
            model = choice.record.load()(choice.options, hand, torch.device("cpu"))
            self._hands[given] = model
        model = self._hands[given]
        if model.hand.content_hash != info.hand_hash:
            raise GdgError(
                f"{info.path}: its grasps were made with another version of the hand "
                f"'{info.hand}' than {model.hand.folder}; synthesise them anew."
            )
        return model

    def _object(self, info: ShardInfo) -> ObjectModel:
        key = info.object_path or info.object_name, info.object_scale
        obj = self._objects.pop(key, None)
        if obj is None:
            obj = find_object(key[0], scale=key[1])
            if obj.split == TEST:
                raise GdgError(f"data: {info.path}: '{obj.name}' is a test object.")
            while len(self._objects) >= MAX_OBJECTS:
                del self._objects[next(iter(self._objects))]
        self._objects[key] = obj  # last, as the one used last
        if obj.content_hash != info.object_hash:
            raise GdgError(
                f"{info.path}: its grasps were made with another version of the object "
                f"'{info.object_name}' than {obj.path}; synthesise them anew."
            )
        return obj


def _stored_maps(path: Path) -> int | None:
    """How many maps a file holds; None where there is none, or one that can't be read."""
    try:
        return len(np.load(path, mmap_mode="r", allow_pickle=False))
    except UNREADABLE:
        return None


def good_grasps(grasps: GraspSet) -> GraspSet:
    """The grasps that passed their simulation, or all where none was run."""
    return grasps.select(grasps.passed) if grasps.verdicts else grasps
