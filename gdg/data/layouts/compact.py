"""gdg's compact layout: every valid grasp of a dataset in one small Parquet file.

A row is a grasp: hand and object (by name; their content hashes stand once in the file's
metadata), the table that the object rests on if there is one, the root's position and unit
quaternion, the joints, a summary of the verdict, and what made it. Single precision, split into
byte planes and compressed: about 80 bytes a grasp. What follows from the grasp is left out
(contacts, metrics, drive targets; ``gdg.pipeline.rebuild`` computes it anew), and so are the
planner's energies. Of a verdict, what single pushes and the lift did and what the engine left out
are not kept: they are unknown until ``gdg.pipeline.rebuild`` simulates the grasps again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch

import gdg
from gdg.cache import content_hash
from gdg.data.atomic import atomic_path
from gdg.data.dataset import ShardInfo
from gdg.data.grasps import GraspSet
from gdg.data.hashes import checksum_of
from gdg.data.layouts.rotations import (
    poses_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from gdg.data.scene import TableScene
from gdg.data.verdict import DIRECTIONS, Verdict
from gdg.errors import GdgError, raise_if_any

SCHEMA = "gdg-compact-1"
METADATA_KEY, CHECKSUM_KEY = b"gdg", b"gdg-checksum"
POSITION = ("x", "y", "z")
QUATERNION = ("qw", "qx", "qy", "qz")
#: Verdict fields that are kept as they are; ``shifts`` holds the bits of ``shift_successes``.
FLOATS = ("penetration_start_mm", "penetration_end_mm", "drift_m", "free_displacement_m")
TEXTS = ("failure", "protocol", "engine")
#: Provenance that stands once per file; seeds stand in the rows.
RECIPE = ("gdg", "device", "components", "imported")
#: Bits of one integer.
MAX_SHIFTS = 62

#: A rotation's quaternion may be this far from length 1.
UNIT_TOLERANCE = 1e-3

#: What reading a file that is none may raise.
UNREADABLE = (
    pa.ArrowException, OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError,
    MemoryError, RecursionError,
)  # fmt: skip

_TEXT = pa.dictionary(pa.int32(), pa.string())
#: Column -> type; those of ``_ALWAYS`` hold no null, those of ``_TESTED`` none where a protocol is.
_COLUMNS: dict[str, pa.DataType] = {
    "hand": _TEXT,
    "object": _TEXT,
    **dict.fromkeys((*POSITION, *QUATERNION), pa.float32()),
    "joints": pa.list_(pa.float32()),
    **dict.fromkeys(TEXTS, _TEXT),
    **dict.fromkeys(FLOATS, pa.float32()),
    **dict.fromkeys(("success", "refined"), pa.bool_()),
    "shifts": pa.int64(),
    "trials_run": pa.int8(),
    "trials": pa.int16(),
    "seed": pa.int64(),
    "recipe": _TEXT,
}
#: The column that says which of the header's scenes a grasp is in, null in free air. Files of
#: grasps in free air have neither.
SCENE = "scene"
_ALWAYS = ("hand", "object", *POSITION, *QUATERNION, "joints", "recipe")
_TESTED = ("failure", "engine", "success", "refined", "shifts", "trials_run", "trials")


@dataclass(frozen=True)
class CompactHand:
    """A hand of the file: its content hash, joints (columns of the values) and root link."""

    content_hash: str
    joint_names: tuple[str, ...]
    root_link: str


@dataclass(frozen=True)
class CompactObject:
    """An object of the file: its content hash, factor from its mesh to metres, and split."""

    content_hash: str
    scale: float
    split: str


@dataclass(frozen=True)
class Group:
    """Rows of a file that belong together: one hand, one object in one scene, tested in one way."""

    hand: str
    object_name: str
    protocol: str
    refined: bool
    scene: str = ""


@dataclass(frozen=True)
class CompactFile:
    """A compact file.

    Attributes:
        path: the file.
        hands: by name.
        objects: by name.
        recipes: hash -> versions and components that made grasps.
        scenes: hash -> what an object rests on.
        table: the rows.
    """

    path: Path
    hands: Mapping[str, CompactHand]
    objects: Mapping[str, CompactObject]
    recipes: Mapping[str, Any]
    scenes: Mapping[str, TableScene]
    table: pa.Table

    def groups(self) -> dict[Group, np.ndarray]:
        """Group -> its rows, groups in the file's order."""
        names = ("hand", "object", "protocol", "refined", SCENE)
        found: dict[Group, list[int]] = {}
        columns = (self.table[name].to_pylist() for name in names)
        for row, (hand, obj, protocol, refined, scene) in enumerate(zip(*columns, strict=True)):
            group = Group(hand, obj, protocol or "", bool(refined), scene or "")
            found.setdefault(group, []).append(row)
        return {group: np.array(rows) for group, rows in found.items()}

    def grasps(self, group: Group, rows: np.ndarray) -> GraspSet:
        """The grasps of a group; verdicts hold what the file has of them, pushes are NaN.

        Raises:
            GdgError: a row has another number of joints than its hand.
        """
        hand = self.hands[group.hand]
        table = self.table.take(pa.array(rows))
        count, width = len(rows), len(hand.joint_names)
        joints = table["joints"].to_pylist()
        if any(len(row) != width for row in joints):
            raise GdgError(f"{self.path}: rows of '{group.hand}' lack joint values.")
        recipes = sorted(set(table["recipe"].to_pylist()))
        return GraspSet(
            hand=group.hand,
            object_name=group.object_name,
            joint_names=hand.joint_names,
            root_link=hand.root_link,
            poses=_poses(table),
            joints=torch.tensor(joints, dtype=torch.float32).reshape(count, width),
            verdicts=_verdicts(table) if group.protocol else (),
            scene=self.scenes.get(group.scene),
            provenance={
                **(self.recipes.get(recipes[0], {}) if len(recipes) == 1 else {}),
                "recipes": recipes,
                "seeds": sorted({seed for seed in table["seed"].to_pylist() if seed is not None}),
            },
        )


def write_compact(
    path: Path, sets: Iterable[tuple[ShardInfo, GraspSet]], compression_level: int = 19
) -> int:
    """Writes the given grasps into one file and returns how many they are.

    Args:
        path: the file.
        sets: shard facts and the grasps to keep of them.
        compression_level: of zstd.

    Raises:
        GdgError: one name stands for two versions of a hand or object.
    """
    contents = _Contents()
    for info, grasps in sets:
        if len(grasps):
            contents.add(info, grasps)
    raise_if_any(list(contents.mistakes))
    if not contents.tables:
        raise GdgError("no grasp of the dataset passed its test, so there is nothing to export.")
    table = contents.table()
    floats = [*POSITION, *QUATERNION, "joints.list.element", *FLOATS]
    texts = [name for name, kind in zip(table.column_names, table.schema.types) if kind == _TEXT]
    with atomic_path(path) as temporary:
        pq.write_table(
            table, temporary, compression="zstd", compression_level=compression_level,
            use_dictionary=[*texts, "seed"],  # type: ignore[arg-type]
            use_byte_stream_split=floats,  # type: ignore[arg-type]
            write_statistics=False, write_page_checksum=True,
        )  # fmt: skip
    return table.num_rows


class _Contents:
    """What goes into a file."""

    def __init__(self) -> None:
        self.hands: dict[str, CompactHand] = {}
        self.objects: dict[str, CompactObject] = {}
        self.recipes: dict[str, Any] = {}
        self.scenes: dict[str, dict[str, Any]] = {}
        self.mistakes: dict[str, None] = {}
        self.tables: dict[tuple[str, str], list[pa.Table]] = {}

    def add(self, info: ShardInfo, grasps: GraspSet) -> None:
        """Adds the grasps of a shard; notes a mistake where a name has two meanings."""
        hand = CompactHand(info.hand_hash, info.joint_names, info.root_link)
        obj = CompactObject(info.object_hash, info.object_scale, info.split)
        if self.hands.setdefault(info.hand, hand) != hand:
            self._complain(info, f"hand '{info.hand}'")
        if self.objects.setdefault(info.object_name, obj) != obj:
            self._complain(info, f"object '{info.object_name}'")
        recipe = {key: info.provenance[key] for key in RECIPE if key in info.provenance}
        label = _noted(self.recipes, recipe)
        scene = None if grasps.scene is None else _noted(self.scenes, grasps.scene.as_dict())
        seed = info.provenance.get("shard_seed", info.provenance.get("seed"))
        rows = _rows(grasps, label, seed if isinstance(seed, int) else None, scene)
        self.tables.setdefault((info.hand, info.object_name), []).append(rows)

    def _complain(self, info: ShardInfo, what: str) -> None:
        self.mistakes[
            f"{info.path}: the dataset has two versions of the {what}, which a compact file can't "
            f"hold; export them from two datasets."
        ] = None

    def table(self) -> pa.Table:
        """All rows, pairs sorted, with the header as metadata."""
        header = {
            "schema": SCHEMA,
            "gdg": gdg.__version__,
            "hands": {
                n: [h.content_hash, h.joint_names, h.root_link] for n, h in self.hands.items()
            },
            "objects": {n: [o.content_hash, o.scale, o.split] for n, o in self.objects.items()},
            "recipes": self.recipes,
            **({"scenes": self.scenes} if self.scenes else {}),
        }
        table = pa.concat_tables([t for key in sorted(self.tables) for t in self.tables[key]])
        if not self.scenes:
            table = table.drop_columns(SCENE)
        table = table.unify_dictionaries().combine_chunks()
        return with_checksum(table, json.dumps(header).encode())


def _noted(book: dict[str, Any], entry: dict[str, Any]) -> str:
    """Puts an entry into a book under its hash, and returns that."""
    label = content_hash(json.dumps(entry, sort_keys=True))[:12]
    book[label] = entry
    return label


def with_checksum(table: pa.Table, header: bytes) -> pa.Table:
    """A table with its header and a checksum over both as metadata."""
    checksum = _checksum(table, header).encode()
    return table.replace_schema_metadata({METADATA_KEY: header, CHECKSUM_KEY: checksum})


def _checksum(table: pa.Table, header: bytes) -> str:
    texts = [n for n, t in zip(table.column_names, table.schema.types, strict=True) if t == _TEXT]
    for name in texts:
        place = table.column_names.index(name)
        table = table.set_column(place, name, table[name].cast(pa.string()))
    return checksum_of(header, table)


def read_compact(path: Path) -> CompactFile:
    """Reads a compact file.

    Raises:
        GdgError: it can't be read, is no compact file, is damaged, or has values that are none.
    """
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as stored:
            table = stored.read()
        metadata = table.schema.metadata or {}
        text = metadata.get(METADATA_KEY, b"null")
        header = json.loads(text)
        if not isinstance(header, dict) or header.get("schema") != SCHEMA:
            raise ValueError(f"its schema is not '{SCHEMA}'")
        _check_columns(table)
        if CHECKSUM_KEY not in metadata:
            raise ValueError("it has no checksum; export it anew")
        if metadata[CHECKSUM_KEY] != _checksum(table, text).encode():
            raise ValueError("its content is not what its checksum says, so it is damaged")
        _check_values(table)
        hands = {name: _hand(name, facts) for name, facts in header["hands"].items()}
        objects = {name: _object(name, facts) for name, facts in header["objects"].items()}
        if not all(isinstance(recipe, dict) for recipe in header["recipes"].values()):
            raise TypeError("its 'recipes' are no dictionaries")
        scenes = {n: TableScene.from_dict(tree) for n, tree in header.get("scenes", {}).items()}
        if SCENE not in table.column_names:
            table = table.append_column(SCENE, pa.nulls(len(table), _TEXT))
        unknown = set(table["hand"].to_pylist()) - set(hands)
        unknown |= set(table["object"].to_pylist()) - set(objects)
        unknown |= set(table[SCENE].to_pylist()) - {None, *scenes}
        if unknown:
            raise ValueError(f"'{min(unknown)}' is not in its lists of hands, objects and scenes")
        return CompactFile(path, hands, objects, header["recipes"], scenes, table)
    except UNREADABLE as error:
        reason = " ".join(str(error).split())
        raise GdgError(f"{path}: is no readable compact file: {reason}") from error


def _check_columns(table: pa.Table) -> None:
    """Raises ``TypeError`` where a column is missing or of another type."""
    optional = {SCENE: _TEXT} if SCENE in table.column_names else {}
    for name, kind in {**_COLUMNS, **optional}.items():
        found = table.schema.field(name).type if name in table.column_names else None
        if found != kind:
            raise TypeError(f"its column '{name}' is {found or 'missing'}, not {kind}")


def _check_values(table: pa.Table) -> None:
    """Raises ``ValueError`` where values are missing or not finite, or a rotation is none."""
    tested = table.filter(table["protocol"].is_valid())
    for part, names in ((table, _ALWAYS), (tested, _TESTED)):
        for name in names:
            if part[name].null_count:
                raise ValueError(f"its column '{name}' lacks values")
    joints = table["joints"].combine_chunks().flatten()
    numbers = {**{name: table[name] for name in (*POSITION, *QUATERNION)}, "joints": joints}
    for name, column in numbers.items():
        if column.null_count or not np.isfinite(column.to_numpy(zero_copy_only=False)).all():
            raise ValueError(f"its column '{name}' has values that are not finite")
    quaternions = np.stack([table[name].to_numpy() for name in QUATERNION], axis=-1)
    lengths = np.linalg.norm(quaternions.astype(np.float64), axis=-1)
    if (np.abs(lengths - 1.0) > UNIT_TOLERANCE).any():
        raise ValueError("it has quaternions that are not of length 1")


def _hand(name: str, facts: Any) -> CompactHand:
    key, joints, root = facts
    if not isinstance(joints, list) or not all(isinstance(t, str) for t in (key, root, *joints)):
        raise TypeError(f"hand '{name}': its facts are no hash, joint names and root link")
    return CompactHand(key, tuple(joints), root)


def _object(name: str, facts: Any) -> CompactObject:
    key, scale, split = facts
    is_scale = isinstance(scale, (int, float)) and not isinstance(scale, bool)
    if not isinstance(key, str) or not is_scale or split not in ("", "train", "test"):
        raise TypeError(f"object '{name}': its facts are no hash, scale and split")
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f"object '{name}': its scale is not positive")
    return CompactObject(key, float(scale), split)


def _rows(grasps: GraspSet, recipe: str, seed: int | None, scene: str | None) -> pa.Table:
    count, verdicts = len(grasps), grasps.verdicts
    poses = grasps.poses.double().numpy()
    quaternions = quaternion_from_rotation(poses[:, :3, :3])
    joints = grasps.joints.float().numpy()
    columns: dict[str, Any] = {
        "hand": _texts([grasps.hand] * count),
        "object": _texts([grasps.object_name] * count),
        **{name: pa.array(poses[:, i, 3], pa.float32()) for i, name in enumerate(POSITION)},
        **{name: pa.array(quaternions[:, i], pa.float32()) for i, name in enumerate(QUATERNION)},
        "joints": pa.ListArray.from_arrays(
            pa.array(np.arange(count + 1, dtype=np.int32) * joints.shape[1]),
            pa.array(joints.reshape(-1), pa.float32()),
        ),
    }
    blank: list[None] = [None] * count
    for name in TEXTS:
        columns[name] = _texts([getattr(v, name) for v in verdicts] or blank)
    for name in FLOATS:
        columns[name] = pa.array([getattr(v, name) for v in verdicts] or blank, pa.float32())
    for name in ("success", "refined"):
        columns[name] = pa.array([getattr(v, name) for v in verdicts] or blank, pa.bool_())
    shifts = [v.shift_successes[:MAX_SHIFTS] for v in verdicts]
    columns["shifts"] = pa.array([_bits(s) for s in shifts] or blank, pa.int64())
    columns["trials_run"] = pa.array([len(s) for s in shifts] or blank, pa.int8())
    columns["trials"] = pa.array([v.trials for v in verdicts] or blank, pa.int16())
    columns["seed"] = pa.array([seed] * count, pa.int64())
    columns["recipe"] = _texts([recipe] * count)
    columns[SCENE] = _texts([scene] * count)
    return pa.table(columns)


def _texts(values: Sequence[str | None]) -> pa.Array:
    return pa.array(values, pa.string()).dictionary_encode().cast(_TEXT)


def _bits(shifts: Sequence[bool]) -> int:
    return sum(1 << place for place, passed in enumerate(shifts) if passed)


def _poses(table: pa.Table) -> torch.Tensor:
    def columns(names: Sequence[str]) -> np.ndarray:
        return np.stack([table[name].to_numpy() for name in names], axis=-1).astype(np.float64)

    poses = poses_from(columns(POSITION), rotation_from_quaternion(columns(QUATERNION)))
    return torch.from_numpy(poses.astype(np.float32))


def _verdicts(table: pa.Table) -> tuple[Verdict, ...]:
    def number(value: float | None) -> float:
        return math.nan if value is None else value

    return tuple(
        Verdict(
            success=row["success"],
            displacement_m=(math.nan,) * len(DIRECTIONS),
            rotation_rad=(math.nan,) * len(DIRECTIONS),
            contact_kept=(False,) * len(DIRECTIONS),
            shift_successes=tuple(bool(row["shifts"] >> i & 1) for i in range(row["trials_run"])),
            refined=row["refined"],
            trials=row["trials"],
            seconds=math.nan,
            **{name: number(row[name]) for name in FLOATS},
            **{name: row[name] for name in TEXTS},
        )
        for row in table.select(
            ["success", "refined", "shifts", "trials_run", "trials", *FLOATS, *TEXTS]
        ).to_pylist()
    )
