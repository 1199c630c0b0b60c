"""A batch of grasps as the columns of an Arrow table, and back, without a Python object per number.

Every table has the same columns, null where a grasp set lacks them, so that other tools can take
the schema of any file for that of all; only energies and metrics differ between planners. Vectors
are lists of single-precision numbers: ``pose`` has the 16 of T_object_root by rows, ``joints`` and
``targets`` one per joint, ``contact_points`` and ``contact_normals`` three per contact.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pyarrow as pa
import torch
from torch import Tensor

from gdg.data.contacts import ContactSet
from gdg.data.grasps import GraspSet
from gdg.data.shards import ShardInfo
from gdg.data.verdict import Verdict

ENERGY_PREFIX, METRIC_PREFIX = "energy_", "metric_"
#: Parts of a grasp set that may be absent.
PARTS = ("targets", "status", "contacts", "verdicts")

NUMBERS = pa.list_(pa.float32())
TEXTS = pa.list_(pa.string())
#: Type of every column that each shard has.
TYPES = {
    "grasp_id": pa.string(),
    "joints": NUMBERS,
    "pose": NUMBERS,
    "targets": NUMBERS,
    "status": pa.string(),
    "success": pa.bool_(),
    "verdict": pa.string(),
    "contact_links": TEXTS,
    "contact_points": NUMBERS,
    "contact_normals": NUMBERS,
    "contact_gaps": NUMBERS,
}


def table_of(grasps: GraspSet, ids: Sequence[str]) -> pa.Table:
    """The grasps as a table; contact values aren't stored, they follow from the grasps."""
    columns: dict[str, pa.Array] = {
        "grasp_id": pa.array(ids, pa.string()),
        "joints": _matrix(grasps.joints),
        "pose": _matrix(grasps.poses.flatten(1)),
    }
    if grasps.targets is not None:
        columns["targets"] = _matrix(grasps.targets)
    if grasps.status:
        columns["status"] = pa.array(grasps.status, pa.string())
    if grasps.verdicts:
        columns["success"] = pa.array([v.success for v in grasps.verdicts], pa.bool_())
        texts = [json.dumps(verdict.as_dict()) for verdict in grasps.verdicts]
        columns["verdict"] = pa.array(texts, pa.string())
    if grasps.contacts is not None:
        columns |= _contact_columns(grasps.contacts)
    for name, kind in TYPES.items():
        columns.setdefault(name, pa.nulls(len(grasps), kind))
    ordered = {name: columns[name] for name in TYPES}
    for prefix, values in ((ENERGY_PREFIX, grasps.energies), (METRIC_PREFIX, grasps.metrics)):
        ordered |= {prefix + name: pa.array(_numpy(column)) for name, column in values.items()}
    return pa.table(ordered)


def parts_of(grasps: GraspSet) -> list[str]:
    """Which of ``PARTS`` the grasps have."""
    given = (grasps.targets, grasps.status or None, grasps.contacts, grasps.verdicts or None)
    return [name for name, value in zip(PARTS, given, strict=True) if value is not None]


def grasps_of(info: ShardInfo, table: pa.Table) -> GraspSet:
    """The grasps of a shard's table, or of some of its rows.

    Raises:
        ValueError, KeyError, pa.ArrowException: a column is missing or malformed.
    """
    joints, parts = len(info.joint_names), _parts(info, table)
    return GraspSet(
        hand=info.hand,
        object_name=info.object_name,
        joint_names=info.joint_names,
        root_link=info.root_link,
        poses=_rows(table, "pose", 16).reshape(-1, 4, 4),
        joints=_rows(table, "joints", joints),
        targets=_rows(table, "targets", joints) if "targets" in parts else None,
        energies=_prefixed(table, ENERGY_PREFIX),
        metrics=_prefixed(table, METRIC_PREFIX),
        contacts=_contacts(table) if "contacts" in parts else None,
        status=tuple(table["status"].to_pylist()) if "status" in parts else (),
        verdicts=_verdicts(table) if "verdicts" in parts else (),
        provenance=info.provenance,
        scene=info.scene,
    )


def column_of_ids(table: pa.Table) -> list[str]:
    """The ids of a table's grasps."""
    return table["grasp_id"].to_pylist()


def _parts(info: ShardInfo, table: pa.Table) -> set[str]:
    """What to read: what the shard has and the table was read with."""
    columns = {"contacts": "contact_gaps", "verdicts": "verdict"}
    known = PARTS if info.version == 1 else info.parts
    return {part for part in known if columns.get(part, part) in table.column_names}


def _numpy(values: Tensor) -> np.ndarray:
    return np.ascontiguousarray(values.detach().float().cpu().numpy())


def _matrix(values: Tensor) -> pa.ListArray:
    rows, width = values.shape
    return _lists(pa.array(_numpy(values).reshape(-1)), np.full(rows, width))


def _lists(values: pa.Array, lengths: np.ndarray) -> pa.ListArray:
    offsets = np.concatenate(([0], np.cumsum(lengths))).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets), values)


def _contact_columns(contacts: ContactSet) -> dict[str, pa.Array]:
    counts = contacts.counts.cpu().numpy()
    links = pa.array(list(contacts.links), pa.string())
    return {
        "contact_links": _lists(links, counts),
        "contact_points": _lists(pa.array(_numpy(contacts.points).reshape(-1)), 3 * counts),
        "contact_normals": _lists(pa.array(_numpy(contacts.normals).reshape(-1)), 3 * counts),
        "contact_gaps": _lists(pa.array(_numpy(contacts.gaps)), counts),
    }


def _flat(table: pa.Table, name: str) -> tuple[np.ndarray, pa.Array]:
    """Length of each row's list, and all values of the lists."""
    column = table[name].combine_chunks()
    if column.null_count:
        raise ValueError(f"column '{name}' has empty cells")
    return column.value_lengths().to_numpy(zero_copy_only=False), column.flatten()


def _as_tensor(values: pa.Array) -> Tensor:
    if values.null_count:
        raise ValueError("a number is missing")
    # a copy: torch wants to own what it may write to
    return torch.from_numpy(np.array(values.to_numpy(zero_copy_only=False), np.float32))


def _rows(table: pa.Table, name: str, width: int) -> Tensor:
    lengths, values = _flat(table, name)
    if (lengths != width).any():
        raise ValueError(f"column '{name}' has a row that is not of {width} numbers")
    return _as_tensor(values).reshape(len(lengths), width)


def _prefixed(table: pa.Table, prefix: str) -> dict[str, Tensor]:
    names = [name for name in table.column_names if name.startswith(prefix)]
    return {name.removeprefix(prefix): _as_tensor(table[name].combine_chunks()) for name in names}


def _contacts(table: pa.Table) -> ContactSet:
    counts, gaps = _flat(table, "contact_gaps")
    link_counts, links = _flat(table, "contact_links")
    if (link_counts != counts).any():
        raise ValueError("column 'contact_links' does not have one link per contact")
    vectors = {}
    for name in ("contact_points", "contact_normals"):
        lengths, values = _flat(table, name)
        if (lengths != 3 * counts).any():
            raise ValueError(f"column '{name}' does not have three numbers per contact")
        vectors[name] = _as_tensor(values).reshape(-1, 3)
    coded = links.dictionary_encode()
    names = coded.dictionary.to_pylist()
    return ContactSet(
        torch.from_numpy(counts.astype(np.int64)),
        tuple(names[index] for index in coded.indices.to_numpy(zero_copy_only=False)),
        vectors["contact_points"],
        vectors["contact_normals"],
        _as_tensor(gaps),
    )


def _verdicts(table: pa.Table) -> tuple[Verdict, ...]:
    texts = table["verdict"].to_pylist()
    return tuple(Verdict.from_dict(tree) for tree in json.loads(f"[{','.join(texts)}]"))
