"""Turns the shards of a dataset into training items: a stream in, arrays on disk out.

What is made of a shard is cached by the content that it follows from, so that it is made once. A
shard is read a chunk at a time, and its arrays are mapped into memory only where they are used:
memory does not grow with the dataset.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, TypeAlias

import numpy as np
import torch
from numpy.lib.format import write_array_header_1_0

from gdg.cache import UNREADABLE, cache_directory, content_hash
from gdg.config import ComponentChoice
from gdg.contact_maps import q_of_grasps
from gdg.data.atomic import atomic_path
from gdg.data.dataset import read_shard, stream_shard
from gdg.data.grasps import GraspSet
from gdg.data.shards import ShardInfo
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.kinds.distance import Distance
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.trainable import BatchKind
from gdg.objects.model import ObjectModel, find_object
from gdg.rotations import ROOT_DIM
from gdg.training.items import ItemGroup, MapMaker
from gdg.training.leaks import TEST

#: Grasps that are read, and whose maps are made, at once.
CHUNK = 256
Chunks: TypeAlias = Iterable[np.ndarray]


class ItemSource:
    """Makes the items of shards.

    Args:
        distance: what contact maps are made with.
        hand_model: the component that places the hands.
        kind: of the batches that the items are for.
        computed: whether maps are made for every batch anew instead of being kept.
    """

    def __init__(
        self,
        distance: ComponentChoice,
        hand_model: ComponentChoice,
        kind: BatchKind = "maps",
        computed: bool = False,
    ):
        self._recipe = "\n".join(
            f"{choice.record.version} {sorted(choice.as_tree().items())}"
            for choice in (distance, hand_model)
        )
        self.distance: Distance = distance.record.load()(distance.options)
        self._hand_model = hand_model
        self._with_q, self._computed = kind == "grasps" or computed, computed
        self._hands: dict[str, HandModel] = {}
        self._makers: dict[str, HandModel] = {}
        self._object: tuple[tuple[str, float], ObjectModel] | None = None
        #: Content hashes of the shards that were read, by path.
        self.shard_hashes: dict[Path, str] = {}

    def groups(
        self, infos: Sequence[ShardInfo], progress: Progress | None = None
    ) -> list[ItemGroup]:
        """The items of shards, object by object, so that each object is loaded once.

        Raises:
            GdgError: as ``group``; or there are shards, but no good grasp in any of them.
        """
        found = []
        for done, info in enumerate(sorted(infos, key=lambda i: (i.object_hash, str(i.path)))):
            group = self.group(info)
            found += [group] if group is not None else []
            if progress is not None:
                progress(done + 1, len(infos))
        if infos and not found:
            raise GdgError("data: none of its grasps passed the simulation.")
        return found

    def group(self, info: ShardInfo) -> ItemGroup | None:
        """The items of a shard's good grasps; None where it has none.

        Good are those that a simulation passed, or all where none was run.

        Raises:
            GdgError: the shard can't be read, or its hand or object are not what they were.
        """
        obj = self._object_of(info)
        surface = cache_directory() / "surfaces" / f"{content_hash('1', info.object_hash)}.npy"
        if _stored_items(surface) is None:
            _save(surface, [torch.cat((obj.points, obj.normals), dim=-1).numpy()])
        q = self._stored(info, "grasps", self._q) if self._with_q else None
        values = None if self._computed else self._stored(info, "maps", self._values)
        if self._computed:
            self._makers[info.hand] = self._hand(info)
        count = _stored_items(next(path for path in (values, q) if path is not None))
        if not count:
            return None
        return ItemGroup(info.hand, info.object_name, surface, count, values, q)

    def maker(self) -> MapMaker:
        """Makes the maps of items that have none."""
        return MapMaker(self.distance, self._makers)

    def _stored(self, info: ShardInfo, what: str, make: Callable[[ShardInfo], Chunks]) -> Path:
        path = self._cache_path(info, what)
        if _stored_items(path) is None:
            _save(path, make(info))
        return path

    def _q(self, info: ShardInfo) -> Iterator[np.ndarray]:
        """Pose vectors of the good grasps, a chunk at a time."""
        hand = self._hand(info)
        yield np.empty((0, ROOT_DIM + len(hand.joint_names)), np.float32)
        for grasps in good_grasps(info):
            yield q_of_grasps(hand, grasps).numpy()

    def _values(self, info: ShardInfo) -> Iterator[np.ndarray]:
        """Maps of the good grasps in half precision, a chunk at a time."""
        obj, hand = self._object_of(info), self._hand(info)
        maker = MapMaker(self.distance, {info.hand: hand})
        surface = torch.cat((obj.points, obj.normals), dim=-1)
        yield np.empty((0, len(obj.points)), np.float16)
        for grasps in good_grasps(info):
            yield maker.values(info.hand, surface, q_of_grasps(hand, grasps)).half().numpy()

    def _cache_path(self, info: ShardInfo, what: str) -> Path:
        # every shard of schema 2 knows its checksum; of an older one the bytes are read
        shard_hash = info.checksum or content_hash(info.path.read_bytes())
        self.shard_hashes[info.path] = shard_hash
        parts = (f"{what}-1", shard_hash, info.hand_hash, info.object_hash, self._recipe)
        return cache_directory() / what / f"{content_hash(*parts)}.npy"

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

    def _object_of(self, info: ShardInfo) -> ObjectModel:
        """The shard's object; the one used last is kept."""
        key = info.object_path or info.object_name, info.object_scale
        if self._object is None or self._object[0] != key:
            obj = find_object(key[0], scale=key[1])
            if obj.split == TEST:
                raise GdgError(f"data: {info.path}: '{obj.name}' is a test object.")
            self._object = key, obj
        obj = self._object[1]
        if obj.content_hash != info.object_hash:
            raise GdgError(
                f"{info.path}: its grasps were made with another version of the object "
                f"'{info.object_name}' than {obj.path}; synthesise them anew."
            )
        return obj


def good_grasps(info: ShardInfo) -> Iterator[GraspSet]:
    """The grasps that passed their simulation, or all where none was run, a chunk at a time."""
    if info.version == 1:  # its footer does not say whether there was a test
        grasps = read_shard(info.path)
        yield grasps.select(grasps.passed) if grasps.verdicts else grasps
        return
    success = None if info.passed is None else True
    yield from stream_shard(info, success=success, batch=CHUNK, verdicts=False)


def _stored_items(path: Path) -> int | None:
    """How many rows a file holds; None where there is none, or one that can't be read."""
    try:
        return len(np.load(path, mmap_mode="r", allow_pickle=False))
    except UNREADABLE:
        return None


def _save(path: Path, chunks: Chunks) -> None:
    """Writes arrays of equal width below each other as one ``.npy`` file, never all at once.

    Raises:
        GdgError: the cache can't be written.
    """
    pending = iter(chunks)
    first = next(pending)
    try:
        with atomic_path(path) as temporary, temporary.open("r+b") as stream:
            _write_header(stream, first, 0)
            count = 0
            for chunk in itertools.chain([first], pending):
                stream.write(np.ascontiguousarray(chunk).tobytes())
                count += len(chunk)
            stream.seek(0)
            _write_header(stream, first, count)  # as long as before: numpy leaves room for digits
    except OSError as error:
        raise GdgError(
            f"{path}: the cache cannot be written: {error.strerror or error}. Set GDG_CACHE to a "
            f"folder with space that you may write to."
        ) from error


def _write_header(stream: BinaryIO, chunk: np.ndarray, count: int) -> None:
    shape = (count, *chunk.shape[1:])
    header = {"descr": np.lib.format.dtype_to_descr(chunk.dtype), "fortran_order": False}
    write_array_header_1_0(stream, {**header, "shape": shape})
