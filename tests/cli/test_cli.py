"""A user's mistake is a clear line on stderr and exit code 2; every command explains itself."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import torch
import trimesh
from command_line import refused
from gripper import write_gripper

import gdg
from gdg.cli import COMMANDS


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_gripper(tmp_path_factory.mktemp("hands"))


# -- mistakes ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["hand=alegro", "object=mug"], ["Unknown hand 'alegro'", "Did you mean 'allegro'?"]),
        (["hand=allegro", "object=mugg"], ["Unknown object 'mugg'", "Did you mean 'mug'?"]),
        (["object=mug"], ["hand: must be given"]),
        (["hand=allegro", "object=mug", "fitter=adm"], ["fitter", "Did you mean 'adam'?"]),
        (["hand=allegro", "object=mug", "fiter=adam"], ["fiter", "Did you mean 'fitter'?"]),
        (["hand=allegro", "object=mug", "fitter.particels=3"], ["fitter.particels", "'particles'"]),
        (["hand=allegro", "object=mug", "fitter.particles=few"], ["fitter.particles", "'few'"]),
        (["hand=allegro", "object=mug", "n=0"], ["n:", "greater than or equal to 1"]),
        (["hand=allegro", "object=mug", "device=gpu"], ["device", "'gpu'"]),
        (["hand=allegro", "object=mug", "protocol=dro2024"], ["Did you mean 'dro-2024'?"]),
        (["hand=allegro", "object=mug", "n"], ["'n'", "key=value"]),
        (["hand=allegro", "object=mug", "seed=1,2"], ["sweep with gdg eval"]),
        (["hand=allegro", "object=test"], ["sweep with gdg eval"]),
        (["hand=./nowhere", "object=mug"], ["./nowhere", "no such file or folder"]),
        (["hand=allegro", "object=lost.stl"], ["lost.stl", "no such file or folder"]),
        (["hand=allegro", "object=mug", "object_scale=0"], ["object_scale", "greater than 0"]),
        (["-c", "lost.yaml"], ["lost.yaml"]),
    ],
)
def test_what_is_misspelt_or_missing_is_told(run, words: list[str], parts: list[str]):
    refused(run("grasp", *words), *parts)


def test_all_mistakes_are_told_at_once(run):
    outcome = run("grasp", "hand=allegro", "object=mug", "n=0", "fitter=adm", "sed=1")
    assert outcome.code == 2
    assert len(outcome.errors) == 3


def test_unknown_hands_are_told_by_every_command(run):
    for command in ("grasp", "eval", "synth"):
        outcome = run(command, "hand=alegro", "object=mug")
        assert outcome.code == 2, command
        assert outcome.errors == [
            error for error in outcome.errors if "Did you mean 'allegro'?" in error
        ]
        assert len(outcome.errors) == 1
    refused(run("hands", "show", "alegro"), "Did you mean 'allegro'?")
    refused(run("objects", "show", "mugg"), "Did you mean 'mug'?")


def test_an_unknown_command_or_flag_is_told(run):
    refused(run("grap"), "No such command 'grap'")
    refused(run("grasp", "--fast"), "--fast")
    refused(run("hands", "shw"), "shw")


def test_a_cuda_device_where_there_is_none(run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    outcome = run("grasp", "hand=allegro", "object=mug", "device=cuda")
    refused(outcome, "device=cuda", "write device=cpu")


def test_a_cuda_device_with_too_high_a_number(run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    refused(
        run("grasp", "hand=allegro", "object=mug", "device=cuda:7"), "device=cuda:7", "finds 1 CUDA"
    )


# -- broken files ------------------------------------------------------------------------------


def test_a_malformed_urdf_is_told_with_its_path(run, tmp_path: Path):
    folder = write_gripper(tmp_path)
    (folder / "two_jaws.urdf").write_text("<robot><link name='base'></robot>")
    refused(run("grasp", f"hand={folder}", "object=mug"), "two_jaws.urdf")


def test_a_malformed_manifest_is_told_with_its_path(run, tmp_path: Path):
    folder = write_gripper(tmp_path)
    manifest = folder / "hand.yaml"
    text = manifest.read_text()
    manifest.write_text("name: [unclosed\n")
    refused(run("hands", "show", folder), "hand.yaml")
    manifest.write_text(text.replace("  left:\n", "  lefft:\n"))
    refused(run("hands", "show", folder), "hand.yaml", "Did you mean 'left'?")


def test_a_malformed_config_file_is_told(run, tmp_path: Path):
    (tmp_path / "run.yaml").write_text("hand: [a\n")
    refused(run("grasp", "-c", "run.yaml"), "run.yaml")
    (tmp_path / "run.yaml").write_text("- 1\n- 2\n")
    refused(run("grasp", "-c", "run.yaml"), "run.yaml")


def test_a_malformed_protocol_file_is_told(run, hand: Path, tmp_path: Path):
    (tmp_path / "mine.yaml").write_text("name: mine\nversion: zero\n")
    outcome = run("grasp", f"hand={hand}", "object=mug", "protocol=mine.yaml")
    assert outcome.code == 2
    assert "Traceback" not in outcome.err
    assert all(error.startswith("Error: mine.yaml: ") for error in outcome.errors)
    assert any("version" in error for error in outcome.errors)


def test_a_mesh_that_is_not_watertight_is_refused(run, hand: Path, tmp_path: Path):
    mesh = trimesh.creation.box((0.05, 0.05, 0.05))
    mesh.update_faces([face < 6 for face in range(12)])
    mesh.export(tmp_path / "open.stl")
    refused(run("grasp", f"hand={hand}", "object=open.stl"), "open.stl", "not watertight")


def test_a_mesh_in_millimetres_is_recognised(run, hand: Path, tmp_path: Path):
    trimesh.creation.box((50, 50, 50)).export(tmp_path / "part.stl")
    outcome = run("grasp", f"hand={hand}", "object=part.stl")
    refused(outcome, "part.stl", "millimetres", "object_scale=0.001")
    assert run("objects", "show", "part.stl", "--scale", "0.001").code == 0


def test_a_file_that_is_no_mesh_is_refused(run, hand: Path, tmp_path: Path):
    (tmp_path / "part.stl").write_bytes(b"no mesh at all")
    refused(run("grasp", f"hand={hand}", "object=part.stl"), "part.stl")


def test_weights_that_do_not_fit_are_refused(run, hand: Path, tmp_path: Path):
    from safetensors.torch import save_file

    words = ("grasp", f"hand={hand}", "object=cube_small", "generator.weights=w.safetensors")
    refused(run(*words), "w.safetensors")
    save_file({"encoder.weight": torch.zeros(3, 3)}, tmp_path / "w.safetensors")
    refused(run(*words), "w.safetensors")
    (tmp_path / "w.safetensors").write_bytes(b"junk")
    refused(run(*words), "w.safetensors")


def test_a_folder_that_cannot_be_written_is_told(run, hand: Path, tmp_path: Path):
    (tmp_path / "taken").write_text("a file")
    refused(run("grasp", f"hand={hand}", "object=cube_small", "out=taken"), "taken")


def test_an_interrupt_says_what_is_kept(run, hand: Path, monkeypatch: pytest.MonkeyPatch):
    def interrupted(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gdg.pipeline.grasp.run_grasp", interrupted)
    outcome = run("grasp", f"hand={hand}", "object=cube_small")
    assert outcome.code == 130
    assert "Interrupted" in outcome.err
    assert "Traceback" not in outcome.err


# -- runs --------------------------------------------------------------------------------------

QUICK = (
    "planner=dfc", "planner.steps=1", "planner.batch=4", "planner.max_batches=1",
    "planner.contacts=2", "planner.max_force_closure=1000", "planner.max_penetration_m=1000",
    "planner.max_self_m=1000", "picture=false", "report=false",
)  # fmt: skip


def test_no_grasp_found_is_no_error_and_says_why(run, hand: Path):
    outcome = run(
        "grasp", f"hand={hand}", "object=cube_small", *QUICK, "planner.max_distance_m=1e-9"
    )
    assert outcome.code == 0
    assert "No grasp found (4 × contact off the surface)." in outcome.out
    assert Path("runs/grasp/two_jaws-cube_small-seed0/grasps.json").is_file()


def test_a_run_prints_its_verdicts_and_files(run, hand: Path):
    outcome = run(
        "grasp", f"hand={hand}", "object=cube_small", "n=1", "out=here", *QUICK,
        "planner.max_distance_m=1000",
    )  # fmt: skip
    assert outcome.code == 0
    assert "here/grasps.json" in outcome.out
    assert "here/config.yaml" in outcome.out
    assert "grasps.png" not in outcome.out


def test_eval_prints_a_table(run, hand: Path):
    outcome = run(
        "eval",
        f"hand={hand}",
        "object=cube_small",
        "n=1",
        *QUICK[:-2],
        "planner.max_distance_m=1000",
    )
    assert outcome.code == 0
    assert "success %" in outcome.out
    assert "two_jaws" in outcome.out
    assert Path("runs/eval/summary.md").is_file()


# -- lists and help ----------------------------------------------------------------------------


@pytest.mark.parametrize("command", [(), *((name,) for name in COMMANDS)])
def test_every_command_has_help(run, command: tuple[str, ...]):
    outcome = run(*command, "--help")
    assert outcome.code == 0
    assert "Usage: " in outcome.out
    assert outcome.err == ""
    if command and command[0] in ("grasp", "eval", "synth"):
        for word in ("hand", "object", "protocol", "planner", "n"):
            assert f"\n    {word} " in outcome.out


def test_settings_are_explained_in_help(run):
    out = run("grasp", "--help").out
    assert "name of a stability protocol, or a YAML file with one" in out
    assert "[dro-2024]" in out
    assert "[contact-map]" in out


def test_the_version_is_told(run):
    assert gdg.__version__ in run("--version").out


def test_python_runs_it_as_a_module():
    command = [sys.executable, "-m", "gdg", "--version"]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert told == f"gdg, version {gdg.__version__}\n"


def test_components_are_listed_with_their_options(run):
    out = run("plugins").out
    for name in (
        "pytorch-kinematics",
        "aligned",
        "euclidean",
        "adam",
        "dfc",
        "contact-map",
        "sapien",
        "mujoco",
        "flow",
        "graspcvae",
        "unigrasp",
    ):
        assert name in out
    assert "particles = 32" not in out
    assert "particles = 32" in run("plugins", "--options").out


def test_hands_are_listed_and_shown(run, hand: Path):
    listed = run("hands", "list").out
    assert "allegro" in listed
    assert "barrett" in listed
    shown = run("hands", "show", hand).out
    for part in ("two_jaws", "close", "prismatic", "0.050", "close_right follows close", "left 1"):
        assert part in shown


def test_hands_are_listed_with_their_joints_and_tier(run):
    (line,) = [line for line in run("hands", "list").out.splitlines() if line.startswith("barrett")]
    assert line.split()[1:4] == ["bundled", "4", "joints"]
    assert line.endswith("Barrett BH8-282")


def test_a_hand_is_shown_with_drives_terms_and_picture(run, hand: Path):
    shown = run("hands", "show", hand).out
    for part in (
        "tier path",
        "2000 / 100 / 20",
        "normal (0 0 1)",
        "licence: Apache-2.0",
        "none in",
    ):
        assert part in shown
    assert str(Path("barrett/picture.png")) in run("hands", "show", "barrett").out
    outcome = run("hands", "show", hand, "--picture", "mine.png")
    assert "picture: mine.png" in outcome.out
    assert Path("mine.png").stat().st_size > 10_000


def test_checking_a_good_hand_writes_pictures_beside_and_ends_with_zero(run, hand: Path):
    before = sorted(hand.iterdir())
    outcome = run("hands", "check", hand)
    assert outcome.code == 0
    assert outcome.err == ""
    assert f"{hand}: 2 warnings" in outcome.out
    assert "warning: " in outcome.out
    assert sorted(hand.iterdir()) == before
    assert sorted(path.name for path in Path("two_jaws-check").iterdir()) == [
        "hand.png", "report.html"
    ]  # fmt: skip
    run("hands", "check", hand, "--out", "there")
    assert Path("there/two_jaws-check/hand.png").is_file()


def test_checking_bad_hands_tells_every_mistake_of_each_and_ends_with_two(run, tmp_path: Path):
    folder, broken = write_gripper(tmp_path / "a"), write_gripper(tmp_path / "b")
    manifest = folder / "hand.yaml"
    text = manifest.read_text()
    manifest.write_text(
        text.replace("normal: [0, 0, 1]", "normal: [0, 0, -1]").replace("Apache-2.0", '""')
    )
    (broken / "hand.yaml").write_text(text.replace("  left:\n", "  lefft:\n"))
    outcome = run("hands", "check", folder, broken, "alegro", "--no-pictures")
    assert outcome.code == 2
    assert "Traceback" not in outcome.err
    for part in (
        f"error: {manifest}: palm.normal: ", f"error: {manifest}: provenance.licence: ",
        f"{folder}: 2 errors and 2 warnings", "Did you mean 'left'?", f"{broken}: 1 error",
        "Did you mean 'allegro'?",
    ):  # fmt: skip
        assert part in outcome.out
    assert not list(Path().glob("*-check"))


def test_a_broken_hand_is_listed_as_broken(run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    folder = write_gripper(tmp_path / "mine")
    (folder / "hand.yaml").write_text("name: two_jaws\n")
    monkeypatch.setenv("GDG_HANDS_PATH", str(tmp_path / "mine"))
    outcome = run("hands", "list")
    assert outcome.code == 0
    (line,) = [line for line in outcome.out.splitlines() if line.startswith("two_jaws")]
    assert "BROKEN: " in line
    assert "allegro" in outcome.out


def test_objects_are_listed_and_shown(run):
    listed = run("objects", "list").out
    assert "cube_small" in listed
    shown = run("objects", "show", "cube_small").out
    assert "40 × 40 × 40 mm" in shown
    # its edges are rounded
    assert "volume 63.5 cm³" in shown


def test_the_installed_command_ends_with_code_two():
    done = subprocess.run(
        [sys.executable, "-c", "from gdg.cli import main; main()", "hands", "show", "alegro"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("Error: Unknown hand 'alegro'.")
    assert "Traceback" not in done.stderr
