"""DexGraspNet: one ``OBJECT.npy`` per object, a list of grasps with joints by name.

Wang et al., ICRA 2023. Each grasp has ``qpos`` (joint name -> value; the root as translation WRJTx,
WRJTy, WRJTz and angles WRJRx, WRJRy, WRJRz about fixed axes), ``scale`` (the grasp is on the mesh
times that) and energies. The file does not name the hand. Files are pickles inside: they are read
by ``gdg.data.layouts.plain_pickle``, which runs nothing.
"""

from __future__ import annotations

import io
import math
import tokenize
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gdg.data.atomic import atomic_path
from gdg.data.layouts.chain import chain_joints, chain_values
from gdg.data.layouts.foreign import ForeignGrasps, PairToExport, file_name
from gdg.data.layouts.plain_pickle import read_plain_pickle
from gdg.data.layouts.rotations import poses_from, rotation_from_sxyz, sxyz_from_rotation
from gdg.errors import GdgError

TRANSLATION = ("WRJTx", "WRJTy", "WRJTz")
ANGLES = ("WRJRx", "WRJRy", "WRJRz")
#: The layout's name of the energy that gdg calls ``total``, and the prefix of the others.
TOTAL, PREFIX = "energy", "E_"
#: The largest published file has 0.5 MB.
MAX_BYTES = 200_000_000
MAX_JOINTS = 500
#: What numpy raises on headers that are none.
BAD_HEADER = (
    ValueError, TypeError, KeyError, AttributeError, OverflowError, SyntaxError,
    tokenize.TokenError, RecursionError, MemoryError,
)  # fmt: skip
#: Name of the object, which gdg adds where it doesn't follow from code and scale.
NAME = "object"
#: Between an object's code and its scale.
SCALE_SIGN = "@"


def read_dexgraspnet(path: Path) -> list[ForeignGrasps]:
    """The grasps of an ``OBJECT.npy``, or of every one in a folder, one set per scale.

    Each scale of a code is an object of its own, named ``CODE@SCALE``; at scale 1, ``CODE``.

    Raises:
        GdgError: no such file, or one that isn't of this layout.
    """
    files = sorted(path.glob("*.npy")) if path.is_dir() else [path]
    if not files:
        raise GdgError(f"{path}: holds no OBJECT.npy.")
    return [grasps for file in files for grasps in _read_file(file)]


def _read_file(path: Path) -> list[ForeignGrasps]:
    entries = _entries(path)
    try:
        objects: dict[tuple[str, float], list[dict[str, Any]]] = {}
        for entry in entries:
            scale = _number(entry.get("scale", 1.0))
            name = entry.get(NAME, _name(path.stem, scale))
            if not isinstance(name, str):
                raise TypeError(f"a {type(name).__name__} is no name")
            objects.setdefault((name, scale), []).append(entry)
        return [_grasps(path, name, scale, members) for (name, scale), members in objects.items()]
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise GdgError(
            f"{path}: is no DexGraspNet file: {type(error).__name__}: {error}"
        ) from error


def _entries(path: Path) -> list[dict[str, Any]]:
    """The list of dictionaries that a ``.npy`` file holds."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise GdgError(f"{path}: larger than {MAX_BYTES // 10**6} MB, no plausible file.")
        stream = io.BytesIO(path.read_bytes())
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else None
        if read is None:
            read = np.lib.format.read_array_header_2_0
        _, _, dtype = read(stream)
    except OSError as error:
        raise GdgError(f"{path}: cannot be read: {error.strerror or error}.") from error
    except BAD_HEADER as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise GdgError(f"{path}: is no .npy file: {reason}.") from error
    entries = read_plain_pickle(stream.read(), str(path)) if dtype.hasobject else None
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise GdgError(f"{path}: is no DexGraspNet file: it holds no list of grasps.")
    return entries


def _name(code: str, scale: float) -> str:
    """The name of a code's mesh at a scale."""
    return code if scale == 1.0 else f"{code}{SCALE_SIGN}{scale:.10g}"


def _grasps(path: Path, name: str, scale: float, entries: list[dict[str, Any]]) -> ForeignGrasps:
    first = entries[0]["qpos"]
    joints = tuple(key for key in first if key not in (*TRANSLATION, *ANGLES))
    if len(joints) > MAX_JOINTS:
        raise ValueError(f"{len(joints)} joints")
    for index, entry in enumerate(entries):
        if entry["qpos"].keys() != first.keys():
            raise ValueError(f"grasp {index} has other joints than the first")

    def columns(keys: Sequence[str]) -> np.ndarray:
        rows = [[_number(entry["qpos"][key]) for key in keys] for entry in entries]
        return np.array(rows, np.float64).reshape(len(entries), len(keys))

    energies = {
        "total" if key == TOTAL else key.removeprefix(PREFIX): np.array(
            [_number(entry[key]) for entry in entries]
        )
        for key in entries[0]
        if (key == TOTAL or key.startswith(PREFIX)) and all(key in entry for entry in entries)
    }
    return ForeignGrasps(
        source=str(path),
        hand="",
        object_name=name,
        poses=poses_from(columns(TRANSLATION), rotation_from_sxyz(columns(ANGLES))),
        joints=columns(joints),
        joint_names=joints,
        object_lookup=path.stem,
        object_scale=scale,
        energies=energies,
    )


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"a {type(value).__name__} is no number")
    try:
        return float(value)
    except OverflowError:
        return math.inf  # no float is as large; such grasps are left out


def write_dexgraspnet(pairs: Sequence[PairToExport], out: Path) -> list[Path]:
    """Writes one file per object; returns them.

    Raises:
        GdgError: there are several hands, which the layout can't tell apart.
    """
    hands = sorted({pair.grasps.hand for pair in pairs})
    if len(hands) > 1:
        raise GdgError(
            f"the DexGraspNet layout does not name the hand, but there are {', '.join(hands)}; "
            f"choose one: --only-hand {hands[0]}"
        )
    files: dict[str, list[dict[str, Any]]] = {}
    for pair in pairs:
        code = pair.grasps.object_name.partition(SCALE_SIGN)[0]
        files.setdefault(code, []).extend(_dictionaries(pair))
    written = []
    for code, entries in files.items():
        array = np.empty(len(entries), dtype=object)
        array[:] = entries
        path = out / f"{file_name('object', code)}.npy"
        with atomic_path(path) as temporary, temporary.open("wb") as stream:
            np.save(stream, array, allow_pickle=True)
        written.append(path)
    return written


def _dictionaries(pair: PairToExport) -> list[dict[str, Any]]:
    poses = pair.grasps.poses.double().numpy()
    order = [pair.grasps.joint_names.index(name) for name in pair.hand.spec.joints]
    joints = chain_values(pair.hand, pair.grasps.joints.double().numpy()[:, order])
    values = np.concatenate(
        (joints, poses[:, :3, 3], sxyz_from_rotation(poses[:, :3, :3])), axis=1
    ).tolist()
    names = (*chain_joints(pair.hand), *TRANSLATION, *ANGLES)
    energies = {
        TOTAL if name == "total" else f"{PREFIX}{name}": column.tolist()
        for name, column in pair.grasps.energies.items()
    }
    name, scale = pair.grasps.object_name, pair.object_scale
    own = {} if name == _name(name.partition(SCALE_SIGN)[0], scale) else {NAME: name}
    return [
        {
            "qpos": dict(zip(names, row, strict=True)),
            "scale": scale,
            **own,
            **{name: column[index] for name, column in energies.items()},
        }
        for index, row in enumerate(values)
    ]
