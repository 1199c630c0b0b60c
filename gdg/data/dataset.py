"""Grasp datasets: Parquet shards in folders ``hand=…/object=…``, one grasp per row.

A shard is complete or absent, never half. Its schema metadata holds, under ``gdg``, what is the
same for all its rows, so that a listing reads only file footers::

    <root>/hand=allegro/object=mug/part-<key>.parquet
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq
import torch
from torch import Tensor

from gdg.data.atomic import atomic_path
from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.errors import GdgError

SCHEMA = "gdg-dataset-1"
METADATA_KEY = b"gdg"
ENERGY_PREFIX = "energy_"
#: Facts of a shard's hand and object that its writer must give.
REQUIRED = ("hand_hash", "object_hash", "split")
#: Facts that it may give.
OPTIONAL = ("hand_path", "object_path", "object_scale")

_NUMBERS = pa.list_(pa.float32())


@dataclass(frozen=True)
class ShardInfo:
    """What a shard's footer says.

    Attributes:
        path: the file.
        key: the key that it was written under.
        hand: the hand's name.
        object_name: the object's name.
        hand_hash: content hash of the hand folder.
        object_hash: content hash of the object's geometry.
        split: ``train``, ``test`` or ``""`` for an object without a manifest.
        joint_names: columns of the joint values.
        root_link: the link whose poses are stored.
        hand_path: what to load the hand by, if its name does not find it.
        object_path: what to load the object by, if its name does not find it.
        object_scale: factor from the mesh's unit to metres.
        count: grasps in the file.
        provenance: of the grasps.
    """

    path: Path
    key: str
    hand: str
    object_name: str
    hand_hash: str
    object_hash: str
    split: str
    joint_names: tuple[str, ...]
    root_link: str
    hand_path: str = ""
    object_path: str = ""
    object_scale: float = 1.0
    count: int = 0
    provenance: dict[str, Any] = field(default_factory=dict)


def shard_path(root: Path, hand: str, object_name: str, key: str) -> Path:
    """Where the shard of a key lies; names are percent-encoded as Hive-style readers expect."""
    folder = root / f"hand={quote(hand, safe='+')}" / f"object={quote(object_name, safe='+')}"
    return folder / f"part-{key}.parquet"


def write_shard(root: Path, key: str, grasps: GraspSet, provenance: Mapping[str, Any]) -> Path:
    """Writes grasps as one shard, atomically, and returns its path.

    Contact values aren't stored: they follow from the grasps.

    Args:
        root: the dataset's folder.
        key: names the shard; the same key of the same pair replaces it.
        grasps: what to store; verdicts, targets, energies and status where it has them.
        provenance: ``hand_hash``, ``object_hash``, ``split``, optionally ``hand_path``,
            ``object_path`` and
            ``object_scale``; other entries join the grasps' own provenance.

    Raises:
        GdgError: a required fact is missing.
    """
    missing = [name for name in REQUIRED if name not in provenance]
    if missing:
        raise GdgError(f"write_shard: the provenance lacks {', '.join(missing)}.")
    facts = {name: provenance[name] for name in (*REQUIRED, *OPTIONAL) if name in provenance}
    rest = {name: value for name, value in provenance.items() if name not in facts}
    header = {
        "schema": SCHEMA,
        "hand": grasps.hand,
        "object": grasps.object_name,
        "joint_names": list(grasps.joint_names),
        "root_link": grasps.root_link,
        **facts,
        "provenance": {**grasps.provenance, **rest},
    }
    table = pa.table(_columns(grasps))
    table = table.replace_schema_metadata({METADATA_KEY: json.dumps(header).encode()})
    path = shard_path(root, grasps.hand, grasps.object_name, key)
    with atomic_path(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")
    return path


def shards(root: Path) -> list[ShardInfo]:
    """Every shard below a folder, sorted by path; only file footers are read.

    Raises:
        GdgError: there is no such folder, or a Parquet file in it is no shard.
    """
    if not root.is_dir():
        raise GdgError(f"{root}: there is no such folder of grasps; 'gdg synth' writes one.")
    files = (p for p in root.rglob("*.parquet") if not p.name.startswith("."))
    return [_info(path) for path in sorted(files)]


def read_shard(path: Path) -> GraspSet:
    """The grasps of a shard.

    Raises:
        GdgError: the file can't be read or is no shard.
    """
    info = _info(path)
    try:
        # the file itself: a path with key=value folders would add columns of these names
        with pq.ParquetFile(path) as stored:
            table = stored.read()
        return _grasps(info, table)
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise _unreadable(path, error) from error


def _columns(grasps: GraspSet) -> dict[str, pa.Array]:
    columns = {
        "joints": pa.array(grasps.joints.float().cpu().tolist(), _NUMBERS),
        "pose": pa.array(grasps.poses.float().cpu().flatten(1).tolist(), _NUMBERS),
    }
    if grasps.targets is not None:
        columns["targets"] = pa.array(grasps.targets.float().cpu().tolist(), _NUMBERS)
    for name, values in grasps.energies.items():
        columns[ENERGY_PREFIX + name] = pa.array(values.float().cpu().tolist(), pa.float32())
    if grasps.status:
        columns["status"] = pa.array(grasps.status, pa.string())
    if grasps.verdicts:
        columns["success"] = pa.array([v.success for v in grasps.verdicts], pa.bool_())
        texts = [json.dumps(verdict.as_dict()) for verdict in grasps.verdicts]
        columns["verdict"] = pa.array(texts, pa.string())
    return columns


def _info(path: Path) -> ShardInfo:
    try:
        footer = pq.read_metadata(path)
        header = json.loads((footer.metadata or {}).get(METADATA_KEY, b"null"))
        if not isinstance(header, dict) or header.get("schema") != SCHEMA:
            raise ValueError(f"its schema is not '{SCHEMA}'")
        return ShardInfo(
            path=path,
            key=path.stem.removeprefix("part-"),
            hand=header["hand"],
            object_name=header["object"],
            joint_names=tuple(header["joint_names"]),
            root_link=header["root_link"],
            count=footer.num_rows,
            provenance=header["provenance"],
            **{name: header[name] for name in REQUIRED},
            **{name: header[name] for name in OPTIONAL if name in header},
        )
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        raise _unreadable(path, error) from error


def _grasps(info: ShardInfo, table: pa.Table) -> GraspSet:
    def rows(name: str, width: int) -> Tensor:
        return torch.tensor(table[name].to_pylist(), dtype=torch.float32).reshape(-1, width)

    def numbers(name: str) -> Tensor:
        return torch.tensor(table[name].to_pylist(), dtype=torch.float32)

    def texts(name: str) -> list[str]:
        return table[name].to_pylist() if name in table.column_names else []

    joints = len(info.joint_names)
    energies = [name for name in table.column_names if name.startswith(ENERGY_PREFIX)]
    return GraspSet(
        hand=info.hand,
        object_name=info.object_name,
        joint_names=info.joint_names,
        root_link=info.root_link,
        poses=rows("pose", 16).reshape(-1, 4, 4),
        joints=rows("joints", joints),
        targets=rows("targets", joints) if "targets" in table.column_names else None,
        energies={name.removeprefix(ENERGY_PREFIX): numbers(name) for name in energies},
        status=tuple(texts("status")),
        verdicts=tuple(Verdict.from_dict(json.loads(text)) for text in texts("verdict")),
        provenance=info.provenance,
    )


def _unreadable(path: Path, error: Exception) -> GdgError:
    reason = " ".join(str(error).split())
    return GdgError(f"{path}: is no readable dataset shard: {reason}")
