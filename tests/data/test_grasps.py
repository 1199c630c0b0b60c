"""Grasps come back from their file as they were, and a foreign file is refused with a reason."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from grasp_samples import make_verdict
from hypothesis import given
from hypothesis import strategies as st

from gdg.data.grasps import GraspSet, load_grasps
from gdg.errors import GdgError
from gdg.rotations import random_rotations

VERDICT = make_verdict(shift_successes=(True, True, False), engine="sapien 3.0.3")


def make(count: int = 3, joints: int = 2, *, seed: int = 0, full: bool = True) -> GraspSet:
    generator = torch.Generator().manual_seed(seed)
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, :3, :3] = random_rotations(count, generator)
    poses[:, :3, 3] = torch.randn(count, 3, generator=generator)
    extras: dict[str, Any] = {}
    if full:
        extras = {
            "targets": torch.randn(count, joints, generator=generator),
            "energies": {"total": torch.randn(count, generator=generator)},
            "status": tuple(("converged", "hit_limit")[i % 2] for i in range(count)),
            "verdicts": (VERDICT,) * count,
            "provenance": {"seed": 1, "fitter": {"name": "adam"}},
            "contact_values": torch.rand(count, 5, generator=generator),
        }
    names = tuple(f"joint {i}" for i in range(joints))
    values = torch.randn(count, joints, generator=generator)
    return GraspSet("allegro", "mug", names, "palm", poses, values, **extras)


def round_trip(grasps: GraspSet, folder: Path) -> GraspSet:
    grasps.save(folder / "grasps.json")
    return load_grasps(folder / "grasps.json")


def assert_equal(first: GraspSet, second: GraspSet) -> None:
    for name in ("hand", "object_name", "joint_names", "root_link", "status", "verdicts"):
        assert getattr(first, name) == getattr(second, name)
    assert dict(first.provenance) == dict(second.provenance)
    close = {"atol": 1e-6, "rtol": 1e-6}
    torch.testing.assert_close(first.poses, second.poses, **close)
    torch.testing.assert_close(first.joints, second.joints, **close)
    assert (first.targets is None) == (second.targets is None)
    if first.targets is not None:
        torch.testing.assert_close(first.targets, second.targets, **close)
    assert first.energies.keys() == second.energies.keys()
    for name, energy in first.energies.items():
        torch.testing.assert_close(energy, second.energies[name], equal_nan=True, **close)


@pytest.mark.parametrize("full", [True, False])
def test_grasps_come_back_from_their_file(tmp_path: Path, full: bool):
    grasps = make(full=full)
    assert_equal(round_trip(grasps, tmp_path), grasps)


@given(st.integers(0, 4), st.integers(1, 4), st.integers(0, 1000))
def test_grasps_of_any_size_come_back(
    tmp_path_factory: pytest.TempPathFactory, count: int, joints: int, seed: int
):
    grasps = make(count, joints, seed=seed, full=count > 0)
    assert_equal(round_trip(grasps, tmp_path_factory.getbasetemp()), grasps)


def test_the_file_is_strict_json_even_for_diverged_grasps(tmp_path: Path):
    grasps = make(2)
    diverged = replace(VERDICT, displacement_m=(math.inf, math.nan))
    grasps = GraspSet(
        grasps.hand, grasps.object_name, grasps.joint_names, grasps.root_link, grasps.poses,
        grasps.joints, energies={"total": torch.tensor([math.nan, 1.0])},
        verdicts=(diverged, VERDICT), provenance={"loss": math.inf},
    )  # fmt: skip
    path = tmp_path / "grasps.json"
    grasps.save(path)

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    json.loads(path.read_text(), parse_constant=refuse)
    back = load_grasps(path)
    assert back.energies["total"].isnan().tolist() == [True, False]
    assert all(math.isnan(value) for value in back.verdicts[0].displacement_m)


def test_every_value_carries_its_name_and_unit():
    tree = make().as_dict()
    assert tree["units"] == {"length": "m", "angle": "rad"}
    assert list(tree["grasps"][0]["joints"]) == ["joint 0", "joint 1"]
    assert len(tree["grasps"][0]["T_object_root"]) == 4
    assert tree["root_link"] == "palm"


def test_joints_are_matched_by_name_not_by_place(tmp_path: Path):
    grasps = make()
    tree = grasps.as_dict()
    tree["joint_names"].reverse()
    (tmp_path / "g.json").write_text(json.dumps(tree))
    back = load_grasps(str(tmp_path / "g.json"))
    torch.testing.assert_close(back.joints.flip(-1), grasps.joints, atol=1e-6, rtol=0)


def test_selecting_takes_all_that_belongs_to_a_grasp():
    grasps = make(4)
    chosen = grasps.select([2, 0])
    assert len(chosen) == 2
    assert torch.equal(chosen.poses, grasps.poses[[2, 0]])
    assert chosen.targets is not None
    assert grasps.targets is not None
    assert torch.equal(chosen.targets, grasps.targets[[2, 0]])
    assert torch.equal(chosen.energies["total"], grasps.energies["total"][[2, 0]])
    assert chosen.contact_values is not None
    assert grasps.contact_values is not None
    assert torch.equal(chosen.contact_values, grasps.contact_values[[2, 0]])
    assert chosen.status == (grasps.status[2], grasps.status[0])
    assert len(grasps.select([])) == 0


def test_passed_lists_the_successes():
    assert make(3).passed == [0, 1, 2]
    assert make(3, full=False).passed == []


def test_the_share_of_shifts_and_their_agreement():
    assert VERDICT.success_rate == pytest.approx(2 / 3)
    assert not VERDICT.stable


def test_a_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "grasps.json"
    make().save(path)
    old = path.read_bytes()

    def full(*args: object, **kwargs: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space"):
        make(seed=1).save(path)
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]


def _delete(*keys: Any) -> Callable[[dict[str, Any]], None]:
    def change(tree: Any) -> None:
        for key in keys[:-1]:
            tree = tree[key]
        del tree[keys[-1]]

    return change


def _set(value: Any, *keys: Any) -> Callable[[dict[str, Any]], None]:
    def change(tree: Any) -> None:
        for key in keys[:-1]:
            tree = tree[key]
        tree[keys[-1]] = value

    return change


POSE = ("grasps", 1, "T_object_root")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (_set("gdg-grasps-9", "schema"), "schema is 'gdg-grasps-9', expected 'gdg-grasps-1'"),
        (_delete("schema"), "schema is 'None'"),
        (_set({"length": "mm", "angle": "rad"}, "units"), "units are"),
        (_delete("hand"), "'hand' is missing"),
        (_delete("grasps", 1, "joints", "joint 1"), "'joint 1' is missing"),
        (_delete("grasps", 1, "energies"), "'energies' is missing"),
        (_delete("grasps", 1, "status"), "'status' is missing"),
        (_delete("grasps", 1, "verdict"), "'verdict' is missing"),
        (_delete("grasps", 1, "joint_targets"), "'joint_targets' is missing"),
        (_delete("grasps", 1, "verdict", "success"), "success"),
        (_set(1, "grasps", 0, "verdict", "mood"), "mood"),
        (_set([[1.0, 0.0], [0.0, 1.0]], *POSE), "grasp"),
        (_set("up", *POSE), "is no readable grasp file"),
        (_set(5, "grasps"), "is no readable grasp file"),
        (_set(7, *POSE, 0, 0), "grasp 1: T_object_root is no rigid pose"),
        (_set(1, *POSE, 3, 0), "grasp 1: T_object_root is no rigid pose"),
        (_set(math.nan, "grasps", 1, "joints", "joint 0"), "grasp 1: "),
        (_set("wide", "grasps", 1, "joints", "joint 0"), "is no readable grasp file"),
    ],
)
def test_a_file_with_a_mistake_is_refused_with_the_reason(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], reason: str
):
    tree = make().as_dict()
    change(tree)
    (tmp_path / "g.json").write_text(json.dumps(tree))
    with pytest.raises(GdgError) as caught:
        load_grasps(tmp_path / "g.json")
    assert str(tmp_path / "g.json") in str(caught.value)
    assert reason in str(caught.value)


def test_a_mirrored_and_a_transposed_pose_are_refused(tmp_path: Path):
    for spoil in (torch.diag(torch.tensor([-1.0, 1, 1, 1])), None):
        tree = make().as_dict()
        pose = torch.tensor(tree["grasps"][0]["T_object_root"])
        tree["grasps"][0]["T_object_root"] = (
            pose @ spoil if spoil is not None else pose.T
        ).tolist()
        (tmp_path / "g.json").write_text(json.dumps(tree))
        with pytest.raises(GdgError, match="grasp 0: T_object_root is no rigid pose"):
            load_grasps(tmp_path / "g.json")


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"\xff\xfe", b"null", b'"x"', b"{}", b"3"])
def test_what_is_no_grasp_file_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / "g.json").write_bytes(content)
    with pytest.raises(GdgError, match=r"g\.json"):
        load_grasps(tmp_path / "g.json")


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(GdgError, match=r"lost\.json: cannot be read: No such file"):
        load_grasps(tmp_path / "lost.json")


def test_deeply_nested_json_is_refused(tmp_path: Path):
    (tmp_path / "g.json").write_text("[" * 200_000)
    with pytest.raises(GdgError):
        load_grasps(tmp_path / "g.json")
