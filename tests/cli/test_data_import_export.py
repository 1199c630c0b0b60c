"""``gdg data export`` and ``gdg data import``, from the command line."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from command_line import Outcome, refused
from layout_datasets import assert_same_grasps, grasps_in, write_dataset

from gdg.hands.hand import Hand
from gdg.objects.model import find_object

Run = Callable[..., Outcome]


@pytest.fixture
def dataset(gripper: Hand, tmp_path: Path) -> Path:
    """Grasps of two objects, one of five of each failed."""
    hashes = {name: find_object(name).content_hash for name in ("cube_small", "banana")}
    return write_dataset(tmp_path / "dataset", gripper, hashes, 5)


@pytest.mark.parametrize("layout", ["multidex", "cmap", "dexgraspnet"])
def test_grasps_go_out_and_come_back(run: Run, dataset: Path, gripper: Hand, layout: str) -> None:
    out = run("data", "export", dataset, "--layout", layout, "--out", "there")
    assert out.code == 0, out.err
    assert out.out.startswith("8 grasps in ")
    assert "left out: verdicts, drive targets" in out.out
    assert "Poses of 'two_jaws' are of its root link 'base'." in out.out
    back = run("data", "import", "there", "--out", "back", "--hand", gripper.folder)
    assert back.code == 0, back.err
    assert back.out.endswith("8 grasps of 2 pairs imported: back\n")
    before, after = grasps_in(dataset), grasps_in(Path("back"))
    assert len(after) == 2
    for key, grasps in before.items():
        assert_same_grasps(after[key], grasps.select(grasps.passed))


def test_a_compact_file_goes_out_and_comes_back(run: Run, dataset: Path, gripper: Hand) -> None:
    out = run("data", "export", dataset, "--out", "all.parquet")
    assert out.code == 0, out.err
    assert out.out.startswith("8 grasps, 0.0")
    words = ("data", "import", "all.parquet", "--out", "back", "--hand", gripper.folder)
    assert run(*words).out.endswith("8 grasps of 2 pairs rebuilt: back\n")
    assert "2 of them there already" in run(*words).out
    before, after = grasps_in(dataset), grasps_in(Path("back"))
    for key, grasps in before.items():
        assert_same_grasps(after[key], grasps.select(grasps.passed))


def test_what_is_not_found_is_listed_last_with_exit_code_2(
    run: Run, dataset: Path, gripper: Hand
) -> None:
    assert run("data", "export", dataset, "--layout", "multidex", "--out", "there").code == 0
    file = Path("there/two_jaws/two_jaws.pt")
    tree = torch.load(file, weights_only=True)
    tree["metadata"].append((tree["metadata"][0][0], "no_such_thing", "two_jaws"))
    torch.save(tree, file)
    out = run("data", "import", file, "--out", "back", "--hand", f"two_jaws={gripper.folder}")
    assert out.code == 2
    assert "8 grasps of 2 pairs imported" in out.out
    assert len(out.errors) == 1
    assert "Unknown object 'no_such_thing'" in out.errors[0]


def test_objects_can_be_given_by_name_or_by_a_pattern(
    run: Run, dataset: Path, gripper: Hand
) -> None:
    run("data", "export", dataset, "--layout", "multidex", "--out", "there")
    file = Path("there/two_jaws/two_jaws.pt")
    tree = torch.load(file, weights_only=True)
    renamed = {"cube_small": "contactdb+cube", "banana": "ycb+banana"}
    tree["metadata"] = [(q, renamed[name], hand) for q, name, hand in tree["metadata"]]
    torch.save(tree, file)
    words = ("data", "import", file, "--out", "back", "--hand", gripper.folder)
    given = [f"--object={new}={old}" for old, new in renamed.items()]
    assert run(*words, *given).code == 0
    assert sorted(name for _, name in grasps_in(Path("back"))) == sorted(renamed.values())
    for old, new in renamed.items():
        Path("meshes").mkdir(exist_ok=True)
        find_object(old).mesh.export(f"meshes/{new}.stl")
    words = ("data", "import", file, "--out", "again", "--hand", gripper.folder)
    assert run(*words, "--meshes", "meshes/{object}.stl").code == 0
    out = run(*words, "--meshes", "elsewhere/{object}.stl")
    assert "there is no mesh elsewhere/" in out.err
    refused(run(*words, "--meshes", "meshes"), "has no {object}")


def test_a_file_with_code_is_refused(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "hand.pt"
    file.write_bytes(pickle.dumps(print))
    refused(run("data", "import", file, "--out", "back"), "hand.pt", "never code")
    assert not Path("back").exists()


def test_mistakes_are_told_in_one_sentence(run: Run, dataset: Path) -> None:
    refused(run("data", "export", dataset, "--out", "there"), "Write --layout multidex")
    refused(run("data", "export", "nowhere", "--layout", "cmap", "--out", "x"), "no such folder")
    refused(
        run("data", "export", dataset, "--layout", "compact", "--out", "x"), "--out NAME.parquet"
    )
    refused(
        run("data", "export", dataset, "--layout", "cmap", "--out", "x", "--only-hand", "two_jaw"),
        "Did you mean 'two_jaws'?",
    )
    refused(
        run("data", "export", dataset, "--layout", "cmap", "--out", "x", "--distance", "aligned/x"),
        "--distance aligned/x",
    )
    Path("a.npy").touch()
    refused(run("data", "import", "a.npy", "--out", "x", "--simulate"), "of the layout compact")
    refused(run("data", "import", "a.npy", "--out", "x", "--object", "y"), "NAME=")
    Path("a.txt").touch()
    refused(run("data", "import", "a.txt", "--out", "x"), "write --layout multidex or")


def test_an_export_never_overwrites_grasps(run: Run, dataset: Path) -> None:
    shard = next(dataset.rglob("*.parquet"))
    before = shard.read_bytes()
    for words in (("--out", dataset / "grasps.parquet"), ("--out", shard),
                  ("--layout", "multidex", "--out", dataset / "there")):  # fmt: skip
        refused(run("data", "export", dataset, *words), "is inside of the dataset")
    Path("notes.parquet").write_text("mine")
    Path("copy.parquet").write_bytes(before)
    for name in ("notes.parquet", "copy.parquet"):
        refused(run("data", "export", dataset, "--out", name), "is there already and no compact")
    assert (shard.read_bytes(), Path("notes.parquet").read_text()) == (before, "mine")
    for _ in range(2):
        assert run("data", "export", dataset, "--out", "all.parquet").code == 0


@pytest.mark.parametrize("command", ["import", "export"])
def test_help_explains_every_layout(run: Run, command: str) -> None:
    out = run("data", command, "--help")
    assert out.code == 0
    for word in ("MultiDex", "CMapDataset", "DexGraspNet", "Parquet", "verdict"):
        assert word in out.out
