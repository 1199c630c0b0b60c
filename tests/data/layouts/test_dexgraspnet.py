"""DexGraspNet files: joints by name, Euler angles, scales; read without being run."""

from __future__ import annotations

import math
import os
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from layout_datasets import assert_same_grasps, grasps_in, random_grasps
from scipy.spatial.transform import Rotation

from gdg.data.dataset import shards
from gdg.data.layouts.dexgraspnet import read_dexgraspnet, write_dexgraspnet
from gdg.data.layouts.exporting import chosen_shards, pairs_to_export
from gdg.data.layouts.foreign import PairToExport
from gdg.data.layouts.importing import import_grasps
from gdg.data.layouts.lookup import Lookup
from gdg.data.layouts.rotations import rotation_from_sxyz
from gdg.errors import GdgError
from gdg.folders import OBJECTS
from gdg.hands.hand import Hand, find_hand
from gdg.objects.spec import read_object_spec


def entry(angles: tuple[float, float, float], scale: float, **joints: float) -> dict[str, Any]:
    """One grasp as DexGraspNet's scripts write it."""
    qpos = {f"robot0:{name}": value for name, value in joints.items()}
    qpos |= dict(zip(("WRJRx", "WRJRy", "WRJRz"), angles, strict=True))
    qpos |= {"WRJTx": 0.1, "WRJTy": 0.2, "WRJTz": 0.3}
    start = {**qpos, "WRJTx": 9.0}
    return {"scale": scale, "qpos": qpos, "qpos_st": start, "energy": 1.5, "E_fc": np.float64(0.5)}


def save(path: Path, entries: list[Any]) -> Path:
    np.save(path, entries, allow_pickle=True)  # type: ignore[arg-type]
    return path


def test_a_published_file_is_read_as_it_is_meant(tmp_path: Path) -> None:
    entries = [entry((0.1, 0.2, 0.3), 0.06, close=0.01), entry((1.0, 0.0, 0.0), 0.08, close=0.02)]
    path = save(tmp_path / "core-mug-1.npy", [*entries, entries[0]])
    small, large = read_dexgraspnet(path)
    assert (small.object_name, small.object_lookup) == ("core-mug-1@0.06", "core-mug-1")
    assert (large.object_name, large.object_scale) == ("core-mug-1@0.08", 0.08)
    assert (len(small.poses), len(large.poses)) == (2, 1)
    assert small.joint_names == ("robot0:close",)
    assert small.joints.tolist() == [[0.01], [0.01]]
    expected = Rotation.from_euler("xyz", (0.1, 0.2, 0.3)).as_matrix()
    np.testing.assert_allclose(small.poses[0, :3, :3], expected, atol=1e-12)
    assert small.poses[0, :3, 3].tolist() == [0.1, 0.2, 0.3]
    assert {name: list(values) for name, values in large.energies.items()} == {
        "total": [1.5], "fc": [0.5],
    }  # fmt: skip


def test_a_published_file_is_imported_at_its_scale(
    gripper: Hand, lookup: Lookup, tmp_path: Path
) -> None:
    save(tmp_path / "cube_small.npy", [entry((0.1, 0.2, 0.3), 0.5, close=0.01)])
    lookup = replace(lookup, hands={"": str(gripper.folder)})
    report = import_grasps("dexgraspnet", read_dexgraspnet(tmp_path), lookup, tmp_path / "out")
    assert (report.grasps, report.skipped) == (1, [])
    (info,) = shards(tmp_path / "out")
    assert (info.object_name, info.object_path) == ("cube_small@0.5", "cube_small")
    assert info.object_scale == 0.5
    assert info.object_hash != lookup.object("cube_small").content_hash


def test_grasps_and_energies_come_back_from_an_export(
    dataset: Callable[..., Path], lookup: Lookup, gripper: Hand, tmp_path: Path
) -> None:
    root = dataset("cube_small", "mug")
    written = write_dexgraspnet(pairs_to_export(chosen_shards(root), lookup), tmp_path / "dgn")
    assert sorted(path.name for path in written) == ["cube_small.npy", "mug.npy"]
    lookup = replace(lookup, hands={"": str(gripper.folder)})
    report = import_grasps(
        "dexgraspnet", read_dexgraspnet(tmp_path / "dgn"), lookup, tmp_path / "again"
    )
    assert (report.pairs, report.grasps, report.skipped) == (2, 8, [])
    before, after = grasps_in(root), grasps_in(tmp_path / "again")
    for key, grasps in before.items():
        passed = grasps.select(grasps.passed)
        assert_same_grasps(after[key], passed)
        for name, values in passed.energies.items():
            torch.testing.assert_close(after[key].energies[name], values)


@pytest.mark.parametrize(
    ("name", "scale"), [("cube_small", 1.0), ("cube_small@0.5", 0.5), ("part", 0.5)]
)
def test_names_and_scales_come_back(name: str, scale: float, gripper: Hand, tmp_path: Path) -> None:
    pair = PairToExport(gripper, random_grasps(gripper, name, 2), "cube_small", scale, "", "")
    write_dexgraspnet([pair], tmp_path)
    (read,) = read_dexgraspnet(tmp_path)
    assert (read.object_name, read.object_scale) == (name, scale)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2, math.pi / 2 - 1e-6])
def test_poses_at_the_poles_come_back(gripper: Hand, tmp_path: Path, pitch: float) -> None:
    grasps = random_grasps(gripper, "cube_small", 8)
    angles = np.random.default_rng(0).uniform(-3, 3, (8, 3))
    angles[:, 1] = pitch
    grasps.poses[:, :3, :3] = torch.from_numpy(rotation_from_sxyz(angles)).float()
    write_dexgraspnet([PairToExport(gripper, grasps, "cube_small", 1.0, "", "")], tmp_path)
    (read,) = read_dexgraspnet(tmp_path)
    np.testing.assert_allclose(read.poses, grasps.poses.double().numpy(), atol=1e-6)


def test_a_hand_of_many_joints_comes_back(tmp_path: Path) -> None:
    hand = find_hand("shadowhand")
    grasps = random_grasps(hand, "cube_small", 3)
    write_dexgraspnet([PairToExport(hand, grasps, "cube_small", 1.0, "", "")], tmp_path / "dgn")
    lookup = Lookup(hands={"": "shadowhand"})
    import_grasps("dexgraspnet", read_dexgraspnet(tmp_path / "dgn"), lookup, tmp_path / "out")
    assert_same_grasps(grasps_in(tmp_path / "out")["shadowhand", "cube_small"], grasps)


def test_several_hands_in_one_export_are_refused(gripper: Hand, tmp_path: Path) -> None:
    pairs = [
        PairToExport(hand, random_grasps(hand, "mug", 1), "mug", 1.0, "", "")
        for hand in (gripper, find_hand("barrett"))
    ]
    with pytest.raises(GdgError, match=r"does not name the hand.*--only-hand barrett"):
        write_dexgraspnet(pairs, tmp_path)


def test_the_hand_must_be_given(tmp_path: Path) -> None:
    save(tmp_path / "cube_small.npy", [entry((0, 0, 0), 1.0, close=0.01)])
    report = import_grasps("dexgraspnet", read_dexgraspnet(tmp_path), Lookup(), tmp_path / "out")
    assert report.skipped == [
        "the files do not name the hand; give it: --hand NAME or --hand FOLDER"
    ]


class Calls:
    """Pickles into a call of ``os.system``."""

    def __init__(self, command: str):
        self.command = command

    def __reduce__(self) -> Any:
        return os.system, (self.command,)


def test_a_file_with_code_is_refused_and_not_run(tmp_path: Path) -> None:
    made = tmp_path / "made"
    path = save(tmp_path / "mug.npy", [{"qpos": {"x": Calls(f"touch {made}")}, "scale": 1.0}])
    with pytest.raises(GdgError, match=r"mug.npy: is refused: .* never code"):
        read_dexgraspnet(path)
    assert not made.exists()


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ([1, 2], "holds no list of grasps"),
        (np.zeros((3, 3)), "holds no list of grasps"),
        ([{"scale": 1.0}], "KeyError: 'qpos'"),
        ([{"qpos": {"WRJTx": "far"}, "scale": 1.0}], "KeyError|TypeError"),
        ([{"qpos": {"close": 0.1}, "scale": 1.0}], "KeyError: 'WRJTx'"),
        ([{"qpos": [1], "scale": 1.0}], "is no DexGraspNet file"),
        ([entry((0, 0, 0), 1.0, a=1.0), entry((0, 0, 0), 1.0, b=1.0)], "other joints"),
        ([{**entry((0, 0, 0), 1.0, a=1.0), "scale": None}], "a NoneType is no number"),
    ],
)
def test_what_is_no_such_file_is_told(tmp_path: Path, entries: Any, words: str) -> None:
    with pytest.raises(GdgError, match=words):
        read_dexgraspnet(save(tmp_path / "mug.npy", entries))


@pytest.mark.parametrize(
    "content",
    [
        b"", b"PK", b"\x93NUMPY\x01\x00v\x00{'descr'",
        b"\x93NUMPY\x01\x00\x20\x00" + b"{'descr': '<f8', (((".ljust(31) + b"\n",
    ],
)  # fmt: skip
def test_what_is_no_npy_file_is_told(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "mug.npy").write_bytes(content)
    with pytest.raises(GdgError, match=r"is no .npy file"):
        read_dexgraspnet(tmp_path / "mug.npy")


def save_pickle(path: Path, data: bytes) -> Path:
    """A ``.npy`` file of objects with a pickle of one's own."""
    header = b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }".ljust(117) + b"\n"
    path.write_bytes(b"\x93NUMPY\x01\x00\x76\x00" + header + data)
    return path


def bomb(levels: int = 60) -> list[Any]:
    """A small list whose text has 2 ** levels parts."""
    value: list[Any] = []
    for _ in range(levels):
        value = [value, value]
    return value


@pytest.mark.parametrize("where", ["joint", "scale", "object", "energy"])
def test_a_list_that_explodes_in_print_is_refused_at_once(tmp_path: Path, where: str) -> None:
    grasp = entry((0, 0, 0), 1.0, close=0.01)
    target, key = (grasp["qpos"], "robot0:close") if where == "joint" else (grasp, where)
    target[key] = bomb()
    path = save_pickle(tmp_path / "mug.npy", pickle.dumps([grasp], 4))
    with pytest.raises(GdgError, match=r"a list is no (number|name)"):
        read_dexgraspnet(path)


def test_values_nested_without_end_are_refused(tmp_path: Path) -> None:
    nested = b"\x80\x04)" + b"\x85" * 200_000
    for data in (nested + b".", b"\x80\x04]}(X\x04\x00\x00\x00qpos" + nested[2:] + b"uea."):
        with pytest.raises(GdgError, match=r"mug.npy: is "):
            read_dexgraspnet(save_pickle(tmp_path / "mug.npy", data))


def test_an_integer_beyond_every_float_is_infinite(tmp_path: Path) -> None:
    grasp = entry((0, 0, 0), 1.0, close=0.01)
    grasp["qpos"]["robot0:close"] = 10**400
    (read,) = read_dexgraspnet(save(tmp_path / "mug.npy", [grasp]))
    assert math.isinf(read.joints[0, 0])


def test_scales_of_a_test_object_are_test_objects(
    gripper: Hand, lookup: Lookup, tmp_path: Path
) -> None:
    apple = OBJECTS.all()["apple"].path
    shutil.copy(apple / read_object_spec(apple).mesh, tmp_path / "innocent.stl")
    lookup = replace(
        lookup,
        hands={"": str(gripper.folder)},
        objects={name: str(tmp_path / "innocent.stl") for name in ("innocent", "innocent@0.9")},
    )
    (tmp_path / "in").mkdir()
    grasps = [entry((0.1, 0.2, 0.3), scale, close=0.01) for scale in (0.9, 1.0)]
    for name in ("apple", "innocent"):
        save(tmp_path / "in" / f"{name}.npy", grasps)
    import_grasps("dexgraspnet", read_dexgraspnet(tmp_path / "in"), lookup, tmp_path / "out")
    found = {info.object_name: info.split for info in shards(tmp_path / "out")}
    assert found == dict.fromkeys(("apple", "apple@0.9", "innocent", "innocent@0.9"), "test")


def test_paths_are_stored_so_that_they_hold_in_any_folder(
    gripper: Hand, lookup: Lookup, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cube = OBJECTS.all()["cube_small"].path
    mesh = cube / read_object_spec(cube).mesh
    shutil.copy(mesh, tmp_path / f"mesh{mesh.suffix}")
    monkeypatch.chdir(tmp_path)
    save(tmp_path / "thing.npy", [entry((0.1, 0.2, 0.3), 1.0, close=0.01)])
    lookup = Lookup(
        hands={"": os.path.relpath(gripper.folder)}, objects={"thing": f"./mesh{mesh.suffix}"}
    )
    import_grasps("dexgraspnet", read_dexgraspnet(Path("thing.npy")), lookup, Path("out"))
    (info,) = shards(tmp_path / "out")
    assert info.object_path == str((tmp_path / f"mesh{mesh.suffix}").resolve())
    assert info.hand_path == str(gripper.folder.resolve())
