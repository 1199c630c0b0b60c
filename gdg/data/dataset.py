"""Grasp datasets: written, read and streamed, one grasp per row (see ``gdg.data.shards``)."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from gdg.data.atomic import atomic_path
from gdg.data.columns import METRIC_PREFIX, grasps_of, parts_of, table_of
from gdg.data.grasps import GraspSet
from gdg.data.hashes import checksum_of, content_of, grasp_ids
from gdg.data.header import SCHEMA, parse_header
from gdg.data.json_values import finite_or_none
from gdg.data.shards import (
    CHECKSUM_KEY,
    METADATA_KEY,
    OPTIONAL,
    REQUIRED,
    UNREADABLE,
    ShardInfo,
    iterate_shards,
    read_info,
    shard_path,
    shards,
    unreadable,
)
from gdg.errors import GdgError

__all__ = [
    "ShardInfo", "read_shard", "shard_path", "shards", "stream_grasps", "stream_shard",
    "write_shard",
]  # fmt: skip

#: Rows per row group: what a reader holds in memory at least.
ROW_GROUP = 16384
#: Figures of the verdicts that a shard's footer sums up, in millimetres.
VERDICT_FIGURES = ("penetration_start_mm", "penetration_end_mm")


def write_shard(root: Path, key: str, grasps: GraspSet, provenance: Mapping[str, Any]) -> Path:
    """Writes grasps as one shard, atomically, and returns its path.

    Contact values aren't stored: they follow from the grasps.

    Args:
        root: the dataset's folder.
        key: names the shard; the same key of the same pair replaces it.
        grasps: what to store, with all it has; none at all where the pair gave none.
        provenance: ``hand_hash``, ``object_hash``, ``split``, optionally ``hand_path``,
            ``object_path``, ``object_scale`` and ``reason`` (why there are no grasps); other
            entries join the grasps' own provenance.

    Raises:
        GdgError: a required fact is missing, or the key or a fact is not what it must be.
    """
    missing = [name for name in REQUIRED if name not in provenance]
    if missing:
        raise GdgError(f"write_shard: the provenance lacks {', '.join(missing)}.")
    facts = {name: provenance[name] for name in (*REQUIRED, *OPTIONAL) if name in provenance}
    rest = {name: value for name, value in provenance.items() if name not in facts}
    ids = grasp_ids(facts["hand_hash"], facts["object_hash"], grasps.poses, grasps.joints)
    header = {
        "schema": SCHEMA,
        "key": key,
        "hand": grasps.hand,
        "object": grasps.object_name,
        "joint_names": list(grasps.joint_names),
        "root_link": grasps.root_link,
        **({} if grasps.scene is None else {"scene": grasps.scene.as_dict()}),
        "parts": parts_of(grasps),
        "content": content_of(ids, [verdict.success for verdict in grasps.verdicts]),
        "summary": _summary(grasps),
        **facts,
        "provenance": {**grasps.provenance, **rest},
    }
    text = json.dumps(finite_or_none(header), allow_nan=False).encode()
    try:
        parse_header(text)
    except ValueError as error:
        raise GdgError(f"write_shard: {error}") from error
    table = table_of(grasps, ids)
    checksum = checksum_of(text, table).encode("ascii")
    table = table.replace_schema_metadata({METADATA_KEY: text, CHECKSUM_KEY: checksum})
    path = shard_path(root, grasps.hand, grasps.object_name, key)
    with atomic_path(path) as temporary:
        pq.write_table(
            table,
            temporary,
            compression="zstd",
            row_group_size=ROW_GROUP,
            write_page_checksum=True,
        )
    return path


def read_shard(path: Path) -> GraspSet:
    """The grasps of a shard.

    Raises:
        GdgError: the file can't be read or is no shard.
    """
    info = read_info(path)
    try:
        return grasps_of(info, read_table(path))
    except UNREADABLE as error:
        raise unreadable(path, error) from error


def read_table(path: Path, columns: list[str] | None = None) -> pa.Table:
    """All rows of a shard, or some of their columns; damaged pages are noticed.

    Raises:
        pa.ArrowException, OSError: the file can't be read.
    """
    # the file itself: a path with key=value folders would add columns of these names
    with pq.ParquetFile(path, page_checksum_verification=True) as stored:
        return stored.read(columns=columns)


def stream_grasps(
    root: Path,
    *,
    hands: Collection[str] = (),
    objects: Collection[str] = (),
    splits: Collection[str] = (),
    success: bool | None = None,
    batch: int = 4096,
    verdicts: bool = True,
) -> Iterator[GraspSet]:
    """The grasps of a dataset in batches, shard by shard in the order of their paths.

    Holds one batch and one row group in memory, however large the dataset.

    Args:
        root: the dataset's folder.
        hands: names of the wanted hands; none given means all.
        objects: names of the wanted objects; none given means all.
        splits: wanted splits of the objects, ``train``, ``test`` or ``""``; none given means all.
        success: only grasps that passed (True) or failed (False) their test; untested ones are
            neither. None means all.
        batch: most grasps at once.
        verdicts: read the verdicts too; they take more time than all numbers together.

    Yields:
        Batches of one hand-object pair each, never empty, with the shard's provenance.

    Raises:
        GdgError: there is no such folder, or a file in it can't be read.
    """
    wanted = ((hands, "hand"), (objects, "object_name"), (splits, "split"))
    for info in iterate_shards(root):
        if info.count and all(
            not names or getattr(info, field) in names for names, field in wanted
        ):
            yield from stream_shard(info, success=success, batch=batch, verdicts=verdicts)


def stream_shard(
    info: ShardInfo, *, success: bool | None = None, batch: int = 4096, verdicts: bool = True
) -> Iterator[GraspSet]:
    """The grasps of one shard in batches; arguments and errors as of ``stream_grasps``."""
    try:
        with pq.ParquetFile(info.path, page_checksum_verification=True) as stored:
            names = stored.schema_arrow.names
            if success is not None and "success" not in names:
                return
            columns = [name for name in names if verdicts or name != "verdict"]
            for rows in stored.iter_batches(batch_size=batch, columns=columns, use_threads=False):
                table = pa.Table.from_batches([rows])
                if success is not None:
                    table = table.filter(pc.field("success") == success)
                if table.num_rows:
                    yield grasps_of(info, table)
    except UNREADABLE as error:
        raise unreadable(info.path, error) from error


def _summary(grasps: GraspSet) -> dict[str, Any]:
    """What ``gdg data info`` shows, so that it reads no grasp."""
    good = grasps.passed if grasps.verdicts else list(range(len(grasps)))
    measured = {}
    for name, values in grasps.metrics.items():
        chosen = values.detach().double().cpu()[good]
        finite = chosen[chosen.isfinite()]
        measured[METRIC_PREFIX + name] = (len(finite), float(finite.sum()))
    for name in VERDICT_FIGURES if grasps.verdicts else ():
        figures = [getattr(grasps.verdicts[index], name) for index in good]
        finite = [value for value in figures if abs(value) < float("inf")]
        measured[name] = (len(finite), sum(finite))
    return {"passed": len(good) if grasps.verdicts else None, "measured": measured}
