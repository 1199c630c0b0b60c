"""A compact file gives the full dataset back: measured anew, resumable, with reasons for gaps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from jaws import grasp_of
from layout_datasets import (
    assert_same_grasps,
    grasps_in,
    random_grasps,
    with_verdicts,
    write_dataset,
)
from table_samples import put

import gdg.quality
from gdg.data.dataset import shards, write_shard
from gdg.data.grasps import GraspSet
from gdg.data.layouts.compact import write_compact
from gdg.data.layouts.exporting import chosen_shards, valid_grasps
from gdg.data.layouts.lookup import Lookup
from gdg.data.scene import TableScene
from gdg.data.table import Table
from gdg.errors import GdgError
from gdg.hands.hand import Hand
from gdg.objects.model import find_object
from gdg.pipeline.rebuild import RebuildResult, rebuild_dataset, skipped
from gdg.protocols import load_protocol
from gdg.scenes.place import on_table


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Stands in for the measuring; holds the objects that were measured."""
    names: list[str] = []

    def measure(hand: object, obj: object, grasps: GraspSet, **options: object) -> GraspSet:
        names.append(grasps.object_name)
        return replace(grasps, metrics={"epsilon": torch.ones(len(grasps))})

    monkeypatch.setattr(gdg.quality, "measure", measure)
    return names


@pytest.fixture
def lookup(gripper: Hand) -> Lookup:
    return Lookup(hands={"two_jaws": str(gripper.folder)})


@pytest.fixture
def compact(gripper: Hand, tmp_path: Path) -> Callable[..., Path]:
    """A compact file of random grasps on the given objects."""

    def write(*objects: str, tested: bool = True) -> Path:
        hashes = {name: find_object(name).content_hash for name in objects}
        root = write_dataset(tmp_path / "dataset", gripper, hashes, 3, tested)
        file = tmp_path / "all.parquet"
        write_compact(file, [(info, valid_grasps(info)) for info in chosen_shards(root)])
        return file

    return write


def test_every_grasp_is_measured_anew(
    compact: Callable[..., Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    results = rebuild_dataset(compact("cube_small", "banana"), tmp_path / "out", lookup)
    assert [(r.object_name, r.count, r.passed, r.reason) for r in results] == [
        ("banana", 2, 2, ""), ("cube_small", 2, 2, ""),
    ]  # fmt: skip
    assert measured == ["banana", "cube_small"]
    before, after = grasps_in(tmp_path / "dataset"), grasps_in(tmp_path / "out")
    for key, grasps in before.items():
        assert_same_grasps(after[key], grasps.select(grasps.passed))
        assert after[key].metrics["epsilon"].tolist() == [1.0, 1.0]
        assert after[key].targets is not None
        assert all(verdict.success for verdict in after[key].verdicts)


def test_rebuilt_grasps_have_every_metric_and_their_contacts(
    compact: Callable[..., Path], lookup: Lookup, tmp_path: Path
) -> None:
    (result,) = rebuild_dataset(compact("cube_small"), tmp_path / "out", lookup)
    assert result.reason == ""
    grasps = grasps_in(tmp_path / "out")["two_jaws", "cube_small"]
    assert set(grasps.metrics) == set(gdg.quality.METRICS)
    assert grasps.contacts is not None
    assert len(grasps.contacts) == 2


def test_facts_are_those_of_the_hand_and_object(
    compact: Callable[..., Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    rebuild_dataset(compact("cube_small"), tmp_path / "out", lookup)
    (before,), (after,) = shards(tmp_path / "dataset"), shards(tmp_path / "out")
    for name in ("hand_hash", "object_hash", "split", "object_scale", "root_link"):
        assert getattr(after, name) == getattr(before, name)
    assert after.provenance["rebuilt_from"] == "all.parquet"


def test_a_second_run_finds_what_is_there(
    compact: Callable[..., Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    file = compact("cube_small", "banana")
    rebuild_dataset(file, tmp_path / "out", lookup)
    next((tmp_path / "out").rglob("object=banana/*.parquet")).unlink()
    seen: list[tuple[int, int]] = []

    def report(done: int, total: int, _: RebuildResult) -> None:
        seen.append((done, total))

    results = rebuild_dataset(file, tmp_path / "out", lookup, report=report)
    assert {r.object_name: r.found for r in results} == {"banana": False, "cube_small": True}
    assert measured == ["banana", "cube_small", "banana"]
    assert seen == [(1, 2), (2, 2)]


def test_what_is_not_found_is_told_and_the_rest_is_rebuilt(
    compact: Callable[..., Path], gripper: Hand, lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    facts = {"hand_hash": gripper.content_hash, "object_hash": "o", "split": ""}
    grasps = with_verdicts(random_grasps(gripper, "no_such_thing", 2), 0)
    write_shard(tmp_path / "dataset", "other", grasps, facts)
    results = rebuild_dataset(compact("cube_small"), tmp_path / "out", lookup)
    assert [r.object_name for r in results if not r.reason] == ["cube_small"]
    (told,) = skipped(results)
    assert told.startswith("Unknown object 'no_such_thing'.")


def test_a_changed_object_is_left_out_unless_accepted(
    compact: Callable[..., Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    file = compact("cube_small")
    lookup.objects["cube_small"] = "cube_medium"
    (result,) = rebuild_dataset(file, tmp_path / "out", lookup)
    assert "object 'cube_small'" in result.reason
    assert "--accept-changed" in result.reason
    assert not (tmp_path / "out").exists()
    (result,) = rebuild_dataset(file, tmp_path / "out", lookup, accept_changed=True)
    assert result.reason == ""
    assert "stored verdicts were dropped" in result.notes[0]
    assert grasps_in(tmp_path / "out")["two_jaws", "cube_small"].verdicts == ()


@pytest.fixture
def on_a_table(gripper: Hand, tmp_path: Path) -> Callable[[str, Table], Path]:
    """A compact file of two grasps on an object that rests on a table."""

    def write(name: str, table: Table) -> Path:
        facts = {
            "hand_hash": gripper.content_hash,
            "object_hash": find_object(name).content_hash,
            "split": "train",
        }
        grasps = replace(random_grasps(gripper, name, 2), scene=TableScene(table, 3, 0.5))
        write_shard(tmp_path / "dataset", "k", grasps, facts)
        file = tmp_path / "all.parquet"
        write_compact(file, [(i, valid_grasps(i)) for i in chosen_shards(tmp_path / "dataset")])
        return file

    return write


def test_a_changed_object_is_put_on_its_table_anew(
    on_a_table: Callable[[str, Table], Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    small, medium = find_object("cube_small"), find_object("cube_medium")
    half_m = medium.mesh.extents[0] / 2
    assert half_m > small.mesh.extents[0] / 2 + 0.005
    file = on_a_table("cube_small", Table((0.0, 1.0, 0.0), -0.02))
    lookup.objects["cube_small"] = "cube_medium"
    (result,) = rebuild_dataset(file, tmp_path / "out", lookup, accept_changed=True)
    assert result.reason == ""
    scene = grasps_in(tmp_path / "out")["two_jaws", "cube_small"].scene
    assert scene is not None
    assert scene.table.normal == pytest.approx((0, 1, 0), abs=1e-6)
    assert scene.table.offset == pytest.approx(-half_m, abs=1e-5)
    assert scene == on_table(medium, scene.pose).scene


def test_a_changed_object_that_rests_on_other_sides_is_left_out(
    on_a_table: Callable[[str, Table], Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    file = on_a_table("cube_small", Table((0.0, 0.6, 0.8), -0.02))
    lookup.objects["cube_small"] = "cube_medium"
    (result,) = rebuild_dataset(file, tmp_path / "out", lookup, accept_changed=True)
    assert "doesn't rest on a table as the version did" in result.reason
    assert not (tmp_path / "out").exists()


def test_a_hand_with_other_joints_is_never_accepted(
    compact: Callable[..., Path], measured: list[str], tmp_path: Path
) -> None:
    file = compact("cube_small")
    other = Lookup(hands={"two_jaws": "barrett"})
    (result,) = rebuild_dataset(file, tmp_path / "out", other, accept_changed=True)
    assert "other joints" in result.reason


def test_grasps_are_simulated_again_on_demand(
    compact: Callable[..., Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    (result,) = rebuild_dataset(compact("cube_small"), tmp_path / "out", lookup, simulate=True)
    assert result.reason == ""
    grasps = grasps_in(tmp_path / "out")["two_jaws", "cube_small"]
    assert result.passed == len(grasps.passed)
    assert grasps.verdicts[0].protocol == "dro-2024-v1"
    assert grasps.verdicts[0].displacement_m[0] == grasps.verdicts[0].displacement_m[0]


def test_grasps_on_a_table_are_tested_again_in_their_scene(
    gripper: Hand, lookup: Lookup, tmp_path: Path
) -> None:
    scene = put(find_object("cube_small")).scene
    firm = grasp_of(find_object("cube_small"), below=0.05, from_above=True)
    firm = replace(firm, targets=None, scene=scene)
    loose = replace(firm, joints=firm.joints - 0.02)
    facts = {
        "hand_hash": gripper.content_hash,
        "object_hash": find_object("cube_small").content_hash,
        "split": "train",
    }
    protocol = f"tabletop-lift-v{load_protocol('tabletop-lift').version}"
    for key, grasps in (("firm", firm), ("loose", loose)):
        write_shard(tmp_path / key, key, with_verdicts(grasps, 0, protocol), facts)
        file = tmp_path / f"{key}.parquet"
        write_compact(file, [(i, valid_grasps(i)) for i in chosen_shards(tmp_path / key)])
        out = tmp_path / f"{key}-again"
        (result,) = rebuild_dataset(file, out, lookup, simulate=True)
        assert result.reason == ""
        again = grasps_in(out)["two_jaws", "cube_small"]
        assert again.scene == scene
        assert again.metrics["table_penetration_mm"].item() == 0.0
        (verdict,) = again.verdicts
        assert verdict.success == (key == "firm")
        assert verdict.free_displacement_m == pytest.approx(0.1, abs=0.002)
        assert verdict.lift_contact == verdict.success


def test_untested_grasps_are_rebuilt_but_not_simulated(
    compact: Callable[..., Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    file = compact("cube_small", tested=False)
    (result,) = rebuild_dataset(file, tmp_path / "out", lookup, simulate=True)
    assert "never tested" in result.reason
    (result,) = rebuild_dataset(file, tmp_path / "out", lookup)
    assert (result.count, result.reason) == (3, "")


def test_a_protocol_that_is_gone_gives_no_targets(
    gripper: Hand, lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    facts = {
        "hand_hash": gripper.content_hash,
        "object_hash": find_object("cube_small").content_hash,
        "split": "train",
    }
    grasps = with_verdicts(random_grasps(gripper, "cube_small", 2), 0, "forgotten-2019-v3")
    write_shard(tmp_path / "dataset", "k", grasps, facts)
    file = tmp_path / "all.parquet"
    write_compact(file, [(i, valid_grasps(i)) for i in chosen_shards(tmp_path / "dataset")])
    (result,) = rebuild_dataset(file, tmp_path / "out", lookup, simulate=True)
    assert "forgotten-2019-v3 is no protocol" in result.reason
    (result,) = rebuild_dataset(file, tmp_path / "out", lookup)
    assert "drive targets were not computed" in result.notes[0]


def test_a_file_that_is_no_compact_one_is_refused(lookup: Lookup, tmp_path: Path) -> None:
    (tmp_path / "a.parquet").write_bytes(b"")
    with pytest.raises(GdgError, match="is no readable compact file"):
        rebuild_dataset(tmp_path / "a.parquet", tmp_path / "out", lookup)


def test_a_simulation_replaces_what_was_only_measured(
    compact: Callable[..., Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    file, out = compact("cube_small"), tmp_path / "out"
    rebuild_dataset(file, out, lookup)
    (before,) = shards(out)
    (result,) = rebuild_dataset(file, out, lookup, simulate=True)
    assert not result.found
    (after,) = shards(out)
    assert (after.count, after.path) == (before.count, before.path)
    assert after.provenance["simulated"] is True
    for simulate in (False, True):
        (again,) = rebuild_dataset(file, out, lookup, simulate=simulate)
        assert again.found
        assert (again.count, again.passed) == (result.count, result.passed)
    assert measured == ["cube_small"] * 2


def test_a_test_object_stays_one_under_another_name(
    compact: Callable[..., Path], lookup: Lookup, measured: list[str], tmp_path: Path
) -> None:
    file = compact("apple")
    rebuild_dataset(file, tmp_path / "out", lookup)
    assert [info.split for info in shards(tmp_path / "out")] == ["test"]
