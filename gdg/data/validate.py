"""Checks every file of a dataset by what it says itself, and sets damaged ones aside."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from gdg.data.columns import column_of_ids, grasps_of
from gdg.data.dataset import read_table
from gdg.data.findings import FileFinding
from gdg.data.grasps import GraspSet
from gdg.data.hashes import checksum_of, grasp_ids
from gdg.data.shards import (
    METADATA_KEY,
    UNREADABLE,
    ShardInfo,
    names_of_folders,
    read_info,
    shard_files,
    unreadable,
)
from gdg.errors import GdgError

#: Where damaged files go, inside of the dataset; readers pass over it.
SET_ASIDE = ".corrupt"
#: What a killed process may leave: the temporary names of ``gdg.data.atomic``.
LEFTOVER = re.compile(r"\..+\.[a-z0-9_]{8}(\.[^.]+)?")
#: A younger temporary file may belong to a run that goes on, seconds.
LEFTOVER_AGE_S = 60.0
#: How far a rotation may be from orthonormal; single precision leaves 1e-6.
RIGID = 1e-3

#: Further checks of one shard: what hands and objects say (``gdg.pipeline.data_checks``).
MoreChecks = Callable[[ShardInfo, GraspSet], Iterable[FileFinding]]


def check_dataset(
    root: Path, more: MoreChecks | None = None, progress: Callable[[int, int], None] | None = None
) -> list[FileFinding]:
    """Everything that is wrong with a dataset, in the order of its files.

    Reads every row once; holds one shard and the ids of all grasps (16 bytes each) in memory.

    Args:
        root: the dataset's folder.
        more: further checks of each shard that can be read.
        progress: called with files done and files in all.

    Raises:
        GdgError: there is no such folder.
    """
    findings: list[FileFinding] = []
    known, files = _KnownIds(), shard_files(root)
    for number, path in enumerate(files):
        findings += _check_file(path, more, known)
        if progress is not None:
            progress(number + 1, len(files))
    findings += known.duplicates()
    findings += [
        FileFinding("warning", path, "is what a killed run left over; delete it.", damaged=True)
        for path in _leftovers(root)
    ]
    return findings


def set_aside(root: Path, findings: Iterable[FileFinding]) -> list[Path]:
    """Moves the damaged files into ``.corrupt`` inside of the dataset; nothing is deleted.

    Returns:
        Where they are now.
    """
    moved = []
    for path in dict.fromkeys(finding.path for finding in findings if finding.damaged):
        target = _free_name(root / SET_ASIDE / path.relative_to(root))
        target.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, target)
        moved.append(target)
    return moved


def _free_name(path: Path) -> Path:
    number, free = 0, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.name}.{number}")
    return free


def _leftovers(root: Path) -> list[Path]:
    found = (p for p in root.rglob(".*") if LEFTOVER.fullmatch(p.name) and _is_old_file(p))
    return sorted(path for path in found if SET_ASIDE not in path.relative_to(root).parts)


def _is_old_file(path: Path) -> bool:
    """Whether no run can be writing it; one that has just been renamed is gone."""
    try:
        return path.is_file() and time.time() - path.stat().st_mtime >= LEFTOVER_AGE_S
    except FileNotFoundError:
        return False


def _check_file(path: Path, more: MoreChecks | None, known: _KnownIds) -> Iterator[FileFinding]:
    try:
        info = read_info(path)
        try:
            table = read_table(path)
            text = (table.schema.metadata or {}).get(METADATA_KEY, b"")
            damaged = info.version > 1 and info.checksum != checksum_of(text, table)
            grasps = grasps_of(info, table)
            ids = column_of_ids(table) if "grasp_id" in table.column_names else None
        except UNREADABLE as error:
            raise unreadable(path, error) from error
    except GdgError as error:
        yield _damage(path, str(error).removeprefix(f"{path}: "))
        return
    if damaged:
        yield _damage(path, "its content does not have the checksum that it was written with.")
        return
    yield from _check_place(info)
    yield from _check_values(info, grasps)
    right = grasp_ids(info.hand_hash, info.object_hash, grasps.poses, grasps.joints)
    if ids is not None and ids != right:
        wrong = [row for row, (a, b) in enumerate(zip(ids, right, strict=True)) if a != b]
        yield _damage(path, f"{_of(wrong, len(ids))} grasp_ids are not those of their grasps.")
    known.add(path, right)
    if more is not None:
        yield from more(info, grasps)


def _damage(path: Path, text: str) -> FileFinding:
    return FileFinding("error", path, text, damaged=True)


def _check_place(info: ShardInfo) -> Iterator[FileFinding]:
    hand, object_name = names_of_folders(info.path)
    for what, stored, named in (
        ("hand", info.hand, hand),
        ("object", info.object_name, object_name),
    ):
        if stored != named:
            where = f"'{named}'" if named else f"none (there is no folder {what}=…)"
            yield _damage(
                info.path, f"it holds grasps of the {what} '{stored}', but its folder says {where}."
            )
    if info.path.name != f"part-{info.key}.parquet":
        yield _damage(
            info.path, f"it was written as part-{info.key}.parquet; its name was changed."
        )


def _check_values(info: ShardInfo, grasps: GraspSet) -> Iterator[FileFinding]:
    for text, wrong in (
        ("poses are not rigid (rotation, translation and a last row of 0 0 0 1)", ~_rigid(grasps)),
        ("rows of joint values hold a number that is not finite", ~_finite(grasps.joints)),
        ("rows of joint targets hold a number that is not finite", ~_finite(grasps.targets)),
    ):
        rows = wrong.nonzero().flatten().tolist()
        if rows:
            yield _damage(info.path, f"{_of(rows, len(grasps))} {text}.")


def _of(rows: list[int], count: int) -> str:
    return f"{len(rows)} of {count} (the first is row {rows[0]})"


def _finite(values: Tensor | None) -> Tensor:
    return torch.ones(0, dtype=torch.bool) if values is None else values.isfinite().all(-1)


def _rigid(grasps: GraspSet) -> Tensor:
    rotation = grasps.poses[:, :3, :3]
    fine = grasps.poses.isfinite().flatten(1).all(-1)
    fine &= (rotation @ rotation.mT - torch.eye(3)).abs().amax((1, 2)) < RIGID
    fine &= torch.linalg.det(rotation.nan_to_num(0.0, 0.0, 0.0)) > 0
    return fine & ((grasps.poses[:, 3] - torch.tensor([0.0, 0.0, 0.0, 1.0])).abs().amax(1) < 1e-6)


class _KnownIds:
    """Ids of all grasps so far, as pairs of integers: 16 bytes each."""

    def __init__(self) -> None:
        self._paths: list[Path] = []
        self._ids: list[np.ndarray] = []

    def add(self, path: Path, ids: list[str]) -> None:
        """Adds the grasps of a shard."""
        self._paths.append(path)
        halves = np.frombuffer(bytes.fromhex("".join(ids)), "<u8").reshape(-1, 2)
        self._ids.append(halves)

    def duplicates(self) -> Iterator[FileFinding]:
        """One finding per shard that holds a grasp a second time."""
        if not self._ids:
            return
        ids = np.concatenate(self._ids)
        shard = np.repeat(np.arange(len(self._ids)), [len(part) for part in self._ids])
        # stable: among equal ids the first stays first
        order = np.lexsort((ids[:, 1], ids[:, 0]))
        again = np.flatnonzero((ids[order][1:] == ids[order][:-1]).all(-1)) + 1
        first: dict[int, int] = {}
        origins: dict[int, list[int]] = {}
        for pair in np.stack((order[again - 1], order[again]), axis=1):
            before, row = int(pair[0]), int(pair[1])
            origin = first.get(before, before)
            first[row] = origin
            origins.setdefault(int(shard[row]), []).append(int(shard[origin]))
        for number, others in sorted(origins.items()):
            where = f"in {self._paths[others[0]]}" if others[0] != number else "in the same file"
            yield FileFinding(
                "error",
                self._paths[number],
                f"{len(others)} of its {len(self._ids[number])} grasps stand {where} already; gdg "
                f"data merge drops them.",
            )
