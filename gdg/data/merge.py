"""Unites datasets: every shard once, every grasp once."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from gdg.data.atomic import atomic_path
from gdg.data.columns import column_of_ids, grasps_of
from gdg.data.dataset import read_table, write_shard
from gdg.data.grasps import GraspSet
from gdg.data.hashes import checksum_of, content_of, grasp_ids
from gdg.data.shards import (
    METADATA_KEY,
    UNREADABLE,
    ShardInfo,
    iterate_shards,
    read_info,
    shard_files,
    shard_path,
    unreadable,
)
from gdg.errors import GdgError, raise_if_any

#: Entry of the provenance of a shard that lost duplicates: the content that it had.
MERGED_FROM = "merged_from"
#: What of its key a shard keeps that gets a key of its own, since another has it already.
KEY_START = 40


@dataclass
class Merged:
    """What a merge did.

    Attributes:
        shards: written in this run.
        grasps: in them.
        present: shards that stood in the output already.
        repeated: shards that stood in several inputs.
        dropped: grasps left out since another shard has them.
    """

    shards: int = 0
    grasps: int = 0
    present: int = 0
    repeated: int = 0
    dropped: int = 0


def merge_datasets(
    inputs: Sequence[Path], out: Path, progress: Callable[[int, int], None] | None = None
) -> Merged:
    """Writes the union of some datasets; one that was interrupted goes on where it stopped.

    A shard that stands in several inputs under the same key with the same grasps is taken once;
    where an earlier merge dropped grasps of one of them, the whole one is taken. Of a grasp that
    stands in several shards the first stays, tested ones before untested ones and then in the
    order of the inputs; the shards that lose grasps are written anew, the others are copied as
    they are. What stands in ``out`` already stays; what an earlier merge dropped of a shard there
    and no other shard has is added as a further shard.

    Args:
        inputs: folders of datasets; they are only read.
        out: the folder of the union.
        progress: called with shards done and shards in all.

    Raises:
        GdgErrors: a file that can't be read, or two shards of the same key with different grasps;
            nothing was written then.
        GdgError: a file that is damaged, found on the way.
    """
    done = {_place(info): info for info in iterate_shards(out)} if out.is_dir() else {}
    merged = Merged()
    chosen = _choose(inputs, done, merged)
    total, finished = sum(map(len, chosen.values())), 0
    for group in chosen.values():
        seen = {row for info in _of_pair(done, group[0].info) for row in _read(info)[1]}
        for choice in sorted(group, key=_Chosen.rank):
            _add(choice, out, seen, merged)
            finished += 1
            if progress is not None:
                progress(finished, total)
    return merged


@dataclass(frozen=True)
class _Chosen:
    """A shard to write.

    Attributes:
        info: the shard.
        taken: whether its key is that of another shard, with other grasps of the same origin.
        present: whether that one stands in the output already.
    """

    info: ShardInfo
    taken: bool = False
    present: bool = False

    def rank(self) -> tuple[bool, bool]:
        """Shards of lower rank are written first, so their grasps stay."""
        return not _is_tested(self.info), self.taken


def _choose(
    inputs: Sequence[Path], done: dict[tuple[str, str, str], ShardInfo], merged: Merged
) -> dict[tuple[str, str], list[_Chosen]]:
    """The shards to write, by the contents of hand and object."""
    first = dict(done)
    mistakes: list[str] = []
    chosen: dict[tuple[str, str], list[_Chosen]] = {}
    known: dict[tuple[str, str, str], set[str]] = {}
    for info in _readable(inputs, mistakes):
        place = _place(info)
        group = chosen.setdefault(_contents(info), [])
        if place not in first:
            first[place] = info
            group.append(_Chosen(info))
            continue
        if not _same(info, first[place]):
            mistakes.append(
                f"{info.path}: has the key of {first[place].path} but other grasps; remove the "
                f"wrong one of them."
            )
            continue
        content = _content_of(info)
        contents = known.setdefault(place, {_content_of(first[place])})
        if content in contents:
            merged.present += place in done
            merged.repeated += place not in done
        elif place not in done and content == _origin(first[place]):
            # the one that was chosen is what an earlier merge left of this one
            group[group.index(_Chosen(first[place]))] = _Chosen(info)
            first[place] = info
            merged.repeated += 1
        else:
            group.append(_Chosen(info, taken=True, present=place in done))
        contents.add(content)
    raise_if_any(mistakes)
    return {contents: group for contents, group in chosen.items() if group}


def _readable(inputs: Sequence[Path], mistakes: list[str]) -> Iterator[ShardInfo]:
    """Every shard of the inputs, in order; of others one sentence is appended."""
    for root in inputs:
        for path in shard_files(root):
            try:
                yield read_info(path)
            except GdgError as error:
                mistakes.append(str(error))


def _add(choice: _Chosen, out: Path, seen: set[str], merged: Merged) -> None:
    """Writes one shard without the grasps that are known; adds its grasps to them."""
    info = choice.info
    table, ids = _read(info)
    keep = []
    for row, grasp in enumerate(ids):
        if grasp not in seen:
            seen.add(grasp)
            keep.append(row)
    if choice.taken and not keep:
        merged.present += choice.present
        merged.repeated += not choice.present
        return
    if len(keep) == len(ids) and info.version > 1 and not choice.taken:
        target = shard_path(out, info.hand, info.object_name, info.key)
        with atomic_path(target) as temporary:
            shutil.copyfile(info.path, temporary)
    else:
        grasps = grasps_of(info, table)
        kept = grasps.select(keep)
        origin = _origin(info) or _content(info, table, ids)
        facts = {**info.facts(), **_counts(grasps, kept), MERGED_FROM: origin}
        if ids and not keep:
            facts["reason"] = "all its grasps stand in other shards"
        key = info.key
        if choice.taken:
            key = f"{key[:KEY_START]}-{content_of([ids[row] for row in keep], [])[:16]}"
        write_shard(out, key, kept, facts)
    merged.shards += 1
    merged.grasps += len(keep)
    merged.dropped += len(ids) - len(keep)


def _place(info: ShardInfo) -> tuple[str, str, str]:
    return info.hand, info.object_name, info.key


def _contents(info: ShardInfo) -> tuple[str, str]:
    return info.hand_hash, info.object_hash


def _of_pair(done: dict[tuple[str, str, str], ShardInfo], like: ShardInfo) -> Iterator[ShardInfo]:
    return (info for info in done.values() if _contents(info) == _contents(like))


def _same(first: ShardInfo, second: ShardInfo) -> bool:
    """Whether two shards hold the same grasps, or one is left of the other after a merge."""
    return _contents(first) == _contents(second) and bool(_origins(first) & _origins(second))


def _origins(info: ShardInfo) -> set[str]:
    return {_content_of(info), _origin(info) or _content_of(info)}


def _origin(info: ShardInfo) -> str:
    """The content that a shard had before merges dropped some of its grasps, or ""."""
    origin = info.provenance.get(MERGED_FROM)
    return origin if isinstance(origin, str) else ""


def _is_tested(info: ShardInfo) -> bool:
    """Whether the grasps of a shard have verdicts."""
    if info.version > 1:
        return info.passed is not None
    try:
        return "success" in pq.read_schema(info.path).names
    except UNREADABLE as error:
        raise unreadable(info.path, error) from error


def _counts(before: GraspSet, after: GraspSet) -> dict[str, int]:
    """The counts of the provenance, as if the dropped grasps had never been candidates."""
    lost = {name: len(before) - len(after) for name in ("candidates", "planned", "tested")}
    lost["passed"] = len(before.passed) - len(after.passed)
    given = {name: before.provenance.get(name) for name in lost}
    return {
        name: max(0, value - lost[name]) for name, value in given.items() if isinstance(value, int)
    }


def _content_of(info: ShardInfo) -> str:
    return info.content or _content(info, *_read(info))


def _content(info: ShardInfo, table: pa.Table, ids: list[str]) -> str:
    if info.content:
        return info.content
    success = table["success"].to_pylist() if "success" in table.column_names else []
    return content_of(ids, success)


def _read(info: ShardInfo) -> tuple[pa.Table, list[str]]:
    """All rows of a shard, undamaged, and the ids of its grasps."""
    try:
        table = read_table(info.path)
        if info.version > 1:
            header = (table.schema.metadata or {}).get(METADATA_KEY, b"")
            if checksum_of(header, table) != read_info(info.path).checksum:
                raise ValueError("its content does not have the checksum it was written with")
            return table, column_of_ids(table)
        grasps = grasps_of(info, table)
    except UNREADABLE as error:
        raise unreadable(info.path, error) from error
    if not len(grasps):
        return table, []
    return table, grasp_ids(info.hand_hash, info.object_hash, grasps.poses, grasps.joints)
