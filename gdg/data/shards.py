"""Shards of a grasp dataset by their footers: what is there, without reading a grasp. Light.

A shard is a Parquet file of grasps of one hand-object pair, complete or absent, never half::

    <root>/hand=allegro/object=mug/part-<key>.parquet

Its metadata holds, under ``gdg``, what is the same for all its rows. Folders and files whose name
begins with a dot (temporary files, ``.corrupt``) are no part of the dataset.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import pyarrow as pa
import pyarrow.parquet as pq

from gdg.data.header import SCHEMA, check_key, parse_header
from gdg.data.scene import TableScene
from gdg.errors import GdgError

METADATA_KEY, CHECKSUM_KEY = b"gdg", b"gdg_checksum"
#: Facts of a shard's hand and object that its writer must give.
REQUIRED = ("hand_hash", "object_hash", "split")
#: Facts that it may give.
OPTIONAL = ("hand_path", "object_path", "object_scale", "reason")
#: Folder names of a shard, by what they tell.
HAND_FOLDER, OBJECT_FOLDER = "hand=", "object="
#: What a file that was cut off or damaged raises when it is read.
UNREADABLE = (
    pa.ArrowException, OSError, ValueError, LookupError, TypeError, AttributeError, MemoryError,
    OverflowError, RuntimeError,
)  # fmt: skip


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
        reason: why the pair gave no grasps, or "".
        count: grasps in the file.
        provenance: of the grasps.
        version: of the schema: 1 or 2; what follows is only known of 2.
        parts: which of ``targets``, ``status``, ``contacts``, ``verdicts`` the grasps have.
        content: hash of which grasps these are and which of them passed; not of timings and
            measurements, which differ between two runs that make the same grasps.
        checksum: hash of the whole content, to find damage.
        passed: grasps that passed their test; None where none was run or the version is 1.
        measured: column -> (count, sum) of its finite values, over the grasps that passed (over
            all where none was tested): metrics, and penetrations of the verdicts in millimetres.
        scene: what the object stands on; None: it floats in free air.
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
    reason: str = ""
    count: int = 0
    provenance: dict[str, Any] = field(default_factory=dict)
    version: int = 1
    parts: tuple[str, ...] = ()
    content: str = ""
    checksum: str = ""
    passed: int | None = None
    measured: Mapping[str, tuple[int, float]] = field(default_factory=dict)
    scene: TableScene | None = None

    @property
    def pair(self) -> tuple[str, str]:
        """Hand and object, by name."""
        return self.hand, self.object_name

    def facts(self) -> dict[str, Any]:
        """What ``write_shard`` takes beside the grasps to write the same shard again."""
        given = {name: getattr(self, name) for name in OPTIONAL if getattr(self, name)}
        return {**given, **{name: getattr(self, name) for name in REQUIRED}}


def shard_path(root: Path, hand: str, object_name: str, key: str) -> Path:
    """Where the shard of a key lies; names are percent-encoded as Hive-style readers expect."""
    folder = f"{HAND_FOLDER}{quote(hand, safe='+')}"
    return root / folder / f"{OBJECT_FOLDER}{quote(object_name, safe='+')}" / f"part-{key}.parquet"


def names_of_folders(path: Path) -> tuple[str, str]:
    """Hand and object as the two folders of a shard name them; "" where a folder names none."""
    hand, object_name = path.parent.parent.name, path.parent.name
    return (
        unquote(hand.removeprefix(HAND_FOLDER)) if hand.startswith(HAND_FOLDER) else "",
        unquote(object_name.removeprefix(OBJECT_FOLDER))
        if object_name.startswith(OBJECT_FOLDER)
        else "",
    )


def shard_files(root: Path) -> list[Path]:
    """The Parquet files below a folder, sorted; hidden ones are left out.

    Raises:
        GdgError: there is no such folder.
    """
    if not root.is_dir():
        raise GdgError(f"{root}: there is no such folder of grasps; 'gdg synth' writes one.")
    found = (path for path in root.rglob("*.parquet") if path.is_file())
    return sorted(path for path in found if not is_hidden(path.relative_to(root)))


def is_hidden(path: Path) -> bool:
    """Whether a name in a relative path begins with a dot."""
    return any(part.startswith(".") for part in path.parts)


def iterate_shards(root: Path) -> Iterator[ShardInfo]:
    """Every shard below a folder, sorted by path, as its footer is read.

    Raises:
        GdgError: there is no such folder, or a Parquet file in it is no shard.
    """
    yield from map(read_info, shard_files(root))


def shards(root: Path) -> list[ShardInfo]:
    """Every shard below a folder, sorted by path; only file footers are read.

    Raises:
        GdgError: there is no such folder, or a Parquet file in it is no shard.
    """
    return list(iterate_shards(root))


def read_info(path: Path) -> ShardInfo:
    """What the footer of one shard says.

    Raises:
        GdgError: the file can't be read or is no shard.
    """
    try:
        return _info(path, pq.read_metadata(path))
    except UNREADABLE as error:
        raise unreadable(path, error) from error


def unreadable(path: Path, error: Exception) -> GdgError:
    """The error of a file that is no shard."""
    reason = " ".join(str(error).split()) or type(error).__name__
    return GdgError(f"{path}: is no readable dataset shard: {reason}")


def _info(path: Path, footer: pq.FileMetaData) -> ShardInfo:
    stored = footer.metadata or {}
    header = parse_header(stored.get(METADATA_KEY, b"null"))
    return ShardInfo(
        path=path,
        key=header.key or check_key(path.stem.removeprefix("part-")),
        hand=header.hand,
        object_name=header.object_name,
        joint_names=header.joint_names,
        root_link=header.root_link,
        count=footer.num_rows,
        provenance=header.provenance,
        version=2 if header.version == SCHEMA else 1,
        parts=header.parts,
        content=header.content,
        checksum=stored.get(CHECKSUM_KEY, b"").decode("ascii"),
        passed=header.summary.passed,
        measured=header.summary.measured,
        scene=None if header.scene is None else TableScene.from_dict(header.scene),
        **{name: getattr(header, name) for name in (*REQUIRED, *OPTIONAL)},
    )
