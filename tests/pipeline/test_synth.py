"""Shards are whole, made once, and hold the grasps that passed."""

from __future__ import annotations

import errno
import json
import os
import shutil
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
import torch
from gdg_plugins.planner_dfc.planner import DfcPlanner
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from gripper import write_gripper

from gdg.cli.settings import configs_from
from gdg.data.dataset import read_shard, shards
from gdg.errors import GdgError
from gdg.pipeline.fingerprint import fingerprint
from gdg.pipeline.jobs import SYNTH_DEFAULTS, SynthJob
from gdg.pipeline.schedule import PairState, Schedule
from gdg.pipeline.shard import make_shard, pair_key
from gdg.pipeline.synth import objects_per_batch, run_synth
from gdg.protocols import FOLDER as PRESETS
from gdg.yaml_files import parse_yaml

WORDS = ("object=cube_small", "n=3", "shard=4", "max_shards=3", "workers=1")


@pytest.fixture(autouse=True)
def overlap(monkeypatch: pytest.MonkeyPatch) -> Overlaps:
    """Grasps overlap as the test says; nothing is measured."""
    given = Overlaps()
    monkeypatch.setattr("gdg.quality.exact_overlap", given.of, raising=False)
    monkeypatch.setattr("gdg.quality.measure", lambda hand, obj, grasps: grasps, raising=False)
    return given


@dataclass
class Overlaps:
    """Overlaps in millimetres that grasps get in turn."""

    object_mm: list[float] = field(default_factory=lambda: [0.0])
    self_mm: list[float] = field(default_factory=lambda: [0.0])

    def of(self, hand, obj, grasps) -> Overlaps:
        def column(values: list[float]) -> torch.Tensor:
            return torch.tensor((values * len(grasps))[: len(grasps)])

        return Overlaps(column(self.object_mm), column(self.self_mm))  # type: ignore[arg-type]


def made(result) -> tuple[int, int, int, str]:
    return result.passed, result.made.tested, result.made.candidates, result.reason


def test_shards_hold_what_passed_until_there_are_enough(configs, calls, tmp_path: Path):
    (result,), folder = run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    # two of four candidates pass
    assert made(result) == (4, 8, 8, "")
    assert folder == tmp_path
    found = shards(tmp_path)
    assert len(found) == 2
    for info in found:
        assert (info.hand, info.object_name, info.count) == ("two_jaws", "cube_small", 2)
        assert info.split in ("train", "test")
        assert info.provenance["tested"] == 4
        assert info.provenance["passed"] == 2
        grasps = read_shard(info.path)
        assert grasps.passed == [0, 1]
        assert grasps.targets is not None
    first, second = (read_shard(info.path) for info in found)
    assert not (first.poses == second.poses).all()


def test_failed_grasps_are_kept_on_request(configs, calls, tmp_path: Path):
    (result,), _ = run_synth(configs(SynthJob, *WORDS, "keep_failed=true", f"out={tmp_path}"))
    assert result.passed == 4
    assert [info.count for info in shards(tmp_path)] == [4, 4]
    assert read_shard(shards(tmp_path)[0].path).passed == [0, 2]


def test_nothing_is_made_twice(configs, calls, tmp_path: Path):
    run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    before = len(calls.planned)
    (again,), _ = run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert len(calls.planned) == before
    assert made(again) == (4, 0, 0, "")
    # more grasps: only what is missing is made
    (more,), _ = run_synth(configs(SynthJob, *WORDS, "n=5", f"out={tmp_path}"))
    assert len(calls.planned) == before + 1
    assert made(more) == (6, 4, 4, "")


@pytest.mark.parametrize(
    "word", ["seed=1", "refine=false", "planner.steps=2", "protocol=gendexgrasp-2022", "shard=5"]
)
def test_other_settings_make_other_shards(configs, calls, tmp_path: Path, word: str):
    run_synth(configs(SynthJob, *WORDS, "n=1", f"out={tmp_path}"))
    run_synth(configs(SynthJob, *WORDS, "n=1", word, f"out={tmp_path}"))
    assert len(calls.planned) == 2
    assert len(shards(tmp_path)) == 2


@pytest.mark.parametrize(("planner", "count"), [("contact-map", 2), ("dfc", 1)])
def test_the_fitters_options_name_the_shard_where_the_planner_fits(
    configs, hand_folder: Path, planner: str, count: int
):
    keys = set()
    for steps in (1, 2):
        words = (f"hand={hand_folder}", *WORDS, f"planner={planner}", f"fitter.steps={steps}")
        (config,) = configs_from(SynthJob, SYNTH_DEFAULTS, (), words)
        keys.add(fingerprint(config))
    assert len(keys) == count


@pytest.mark.parametrize("change", ["hand.yaml", "protocol.yaml"])
def test_editing_the_hand_or_the_protocol_changes_the_fingerprint(
    hand_folder: Path, tmp_path: Path, change: str
):
    folder, protocol = tmp_path / hand_folder.name, tmp_path / "protocol.yaml"
    shutil.copytree(hand_folder, folder)
    protocol.write_text((PRESETS / "dro-2024.yaml").read_text())
    words = (f"hand={folder}", *WORDS, f"protocol={protocol}")
    (config,) = configs_from(SynthJob, SYNTH_DEFAULTS, (), words)
    before = fingerprint(config)
    assert fingerprint(config) == before
    edited = folder / change if change == "hand.yaml" else protocol
    edited.write_text(edited.read_text().replace("0.02", "0.03").replace("title:", "title: new"))
    assert fingerprint(config) != before


def test_a_killed_shard_leaves_no_half_file_and_is_made_again(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    import gdg.data.dataset as dataset

    original, written = dataset.pq.write_table, []

    def killed(table, path, **options):
        written.append(path)
        if len(written) == 2:
            Path(path).write_bytes(b"PAR1 half a file")
            raise KeyboardInterrupt
        original(table, path, **options)

    with monkeypatch.context() as patch:
        patch.setattr(dataset.pq, "write_table", killed)
        with pytest.raises(KeyboardInterrupt):
            run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert [info.count for info in shards(tmp_path)] == [2]
    assert len([path for path in tmp_path.rglob("*.parquet") if path.is_file()]) == 1
    (result,), _ = run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert made(result) == (4, 4, 4, "")


def test_a_pair_without_grasps_is_given_up_with_a_reason(configs, calls, tmp_path: Path):
    words = (*WORDS, "planner.max_distance_m=1e-9", f"out={tmp_path}")
    (result,), _ = run_synth(configs(SynthJob, *words))
    assert made(result)[:3] == (0, 0, 12)
    assert result.reason == (
        "no grasp passed after 3 shards, 12 candidates; mostly 'contact off the surface'"
    )
    # empty shards are remembered
    planned = len(calls.planned)
    run_synth(configs(SynthJob, *words))
    assert len(calls.planned) == planned
    assert all(info.count == 0 for info in shards(tmp_path))
    assert "contact off the surface" in shards(tmp_path)[0].reason
    # on request it is tried again, that many times more
    run_synth(configs(SynthJob, *words, "max_shards=9", "retry=true"))
    assert len(calls.planned) == 2 * planned


def test_a_mistake_in_one_pair_leaves_the_others(configs, calls, tmp_path: Path):
    folder = write_gripper(tmp_path)
    manifest = (folder / "hand.yaml").read_text()
    head, _, tail = manifest.partition("contact_regions:")
    (folder / "hand.yaml").write_text(
        f"{head}contact_regions: {{}}\n{tail[tail.index('drives:') :]}"
    )
    out = tmp_path / "out"
    for words, message in (
        (("object=cube_smal,cube_small",), "Did you mean 'cube_small'"),
        (
            (f"hand={folder},{write_gripper(tmp_path / 'good')}", "object=cube_medium"),
            "contact_regions",
        ),
    ):
        calls.planned.clear()
        with pytest.raises(GdgError, match=message):
            run_synth(configs(SynthJob, *WORDS, *words, f"out={out}"))
        assert len(calls.planned) >= 2
    assert {info.object_name for info in shards(out)} == {"cube_small", "cube_medium"}


def test_an_interrupt_keeps_the_shards_before(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    original, seen = SapienSimulator.simulate, []

    def interrupted(*args, **kwargs):
        seen.append(1)
        if len(seen) == 2:
            raise KeyboardInterrupt
        return original(*args, **kwargs)

    monkeypatch.setattr(SapienSimulator, "simulate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert len(shards(tmp_path)) == 1


# -- stages ------------------------------------------------------------------------------------


def test_overlapping_grasps_are_not_simulated(configs, calls, overlap, tmp_path: Path):
    overlap.object_mm, overlap.self_mm = [0.9, 1.1, float("nan"), 0.0], [0.0, 5.0, 0.0, 1.1]
    words = (*WORDS, "n=1", f"out={tmp_path}")
    (result,), _ = run_synth(configs(SynthJob, *words))
    assert calls.simulated == [("cube_small", 1)]
    assert made(result) == (1, 1, 4, "")
    (info,) = shards(tmp_path)
    told = info.provenance
    assert told["rejected"] == {"penetration": 2, "self-penetration": 1}
    assert (told["candidates"], told["planned"], told["tested"], told["passed"]) == (4, 4, 1, 1)
    assert set(told["seconds"]) == {"plan", "filter", "simulate", "measure"}
    assert told["yield_rate"] == 0.25
    # other limits, other shards
    run_synth(configs(SynthJob, *words, "max_penetration_mm=2"))
    assert len(shards(tmp_path)) == 2


def test_grasps_are_measured_before_they_are_stored(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    def measure(hand, obj, grasps):
        return replace(grasps, metrics={"epsilon": torch.full((len(grasps),), 0.25)})

    monkeypatch.setattr("gdg.quality.measure", measure, raising=False)
    run_synth(configs(SynthJob, *WORDS, "n=1", f"out={tmp_path}"))
    assert read_shard(shards(tmp_path)[0].path).metrics["epsilon"].tolist() == [0.25, 0.25]


# -- the end of a pair -------------------------------------------------------------------------


def test_a_pair_with_few_grasps_is_given_up_sooner_on_request(configs, calls, tmp_path: Path):
    words = ("give_up_after=1", "give_up_below=3", f"out={tmp_path}")
    (result,), _ = run_synth(configs(SynthJob, *WORDS, *words))
    assert result.reason == (
        "2 of 3 grasps after 1 shard, 4 candidates; mostly 'drifted in simulation'"
    )
    (again,), _ = run_synth(configs(SynthJob, *WORDS, *words, "retry=true"))
    assert made(again) == (4, 4, 4, "")


def test_a_shard_that_takes_too_long_ends_its_pair_and_is_remembered(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    words = (*WORDS, "object=cube_small,cube_medium", f"out={tmp_path}")
    answers = SapienSimulator.simulate

    def hang(self, hand, obj, grasps, protocol, progress=None):
        if obj.name == "cube_small":
            time.sleep(300)
        return answers(self, hand, obj, grasps, protocol, progress)

    with monkeypatch.context() as patch:
        patch.setattr(SapienSimulator, "simulate", hang)
        first, second = run_synth(configs(SynthJob, *words, "shard_timeout_s=2"))[0]
    assert first.reason == (
        "shard 0 took longer than 2 s (shard_timeout_s); retry=true tries it again"
    )
    assert made(second) == (4, 8, 8, "")
    planned = len(calls.planned)
    first, _ = run_synth(configs(SynthJob, *words, "shard_timeout_s=2"))[0]
    assert "took longer than 2 s" in first.reason
    assert len(calls.planned) == planned
    for word in ("retry=true", "shard_timeout_s=60"):
        first, _ = run_synth(configs(SynthJob, *words, "shard_timeout_s=2", word))[0]
        assert first.reason == ""


def test_a_bug_in_one_pair_is_raised_once_the_others_are_done(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    answers = SapienSimulator.simulate

    def broken(self, hand, obj, grasps, protocol, progress=None):
        if obj.name == "cube_small":
            raise ZeroDivisionError("a bug")
        return answers(self, hand, obj, grasps, protocol, progress)

    monkeypatch.setattr(SapienSimulator, "simulate", broken)
    with pytest.raises(ZeroDivisionError, match="a bug"):
        run_synth(configs(SynthJob, *WORDS, "object=cube_small,cube_medium", f"out={tmp_path}"))
    assert {info.object_name for info in shards(tmp_path)} == {"cube_medium"}


# -- the folder --------------------------------------------------------------------------------


def test_the_folder_tells_what_was_made_and_how(configs, calls, tmp_path: Path):
    words = ("object=cube_small,cube_medium", "seed=0,1", f"out={tmp_path}")
    run_synth(configs(SynthJob, *WORDS, *words))
    record = json.loads((tmp_path / "synth.json").read_text())
    assert record["schema"] == "gdg-synth-1"
    assert [(p["object"], p["passed"], p["tested"], p["ended"]) for p in record["pairs"]] == [
        ("cube_medium", 4, 8, True), ("cube_medium", 4, 8, True),
        ("cube_small", 4, 8, True), ("cube_small", 4, 8, True),
    ]  # fmt: skip
    for number, name in enumerate(["config.yaml", "config-2.yaml"]):
        tree = parse_yaml((tmp_path / name).read_text(), name)
        assert tree["object"] == ["cube_small", "cube_medium"]
        assert tree["seed"] == number
    # pairs of other runs stay in the record
    run_synth(configs(SynthJob, *WORDS, "object=apple", f"out={tmp_path}"))
    assert len(json.loads((tmp_path / "synth.json").read_text())["pairs"]) == 5


def test_a_damaged_shard_is_made_again(configs, calls, tmp_path: Path):
    run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    before = {info.path: info.content for info in shards(tmp_path)}
    damaged = next(iter(before))
    damaged.write_bytes(damaged.read_bytes()[:100])
    (result,), _ = run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert result.notes == (f"{damaged}: is no readable shard; made again",)
    assert made(result) == (4, 4, 4, "")
    assert {info.path: info.content for info in shards(tmp_path)} == before


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_told_and_leaves_no_half_file(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, code: int
):
    written = []

    def full(descriptor: int) -> None:
        written.append(descriptor)
        if len(written) == 2:
            raise OSError(code, os.strerror(code))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(GdgError, match=r"the disk is full.*make room and run the same") as told:
            run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert "\n" not in str(told.value)
    assert [info.count for info in shards(tmp_path)] == [2]
    assert len(list(tmp_path.rglob("*.parquet"))) == 1
    assert [p.name for p in tmp_path.rglob(".*")] == []
    assert json.loads((tmp_path / "synth.json").read_text())["pairs"][0]["passed"] == 2
    (result,), _ = run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert made(result) == (4, 4, 4, "")


def test_a_shard_ahead_of_its_turn_waits_unseen_and_is_used_later(configs, calls, tmp_path: Path):
    (config,) = configs(SynthJob, *WORDS, "n=3", f"out={tmp_path}")
    pair = PairState.open(config)
    first, second, third = pair.start(), pair.start(), pair.start()
    assert [task.number for task in (first, second, third)] == [0, 1, 2]
    for task in (third, second):
        shard = make_shard(task)
        pair.finish(task.number, shard.data, shard.counts)
        assert shards(tmp_path) == []
    shard = make_shard(first)
    pair.finish(0, shard.data, shard.counts)
    # two shards have the grasps; the third was finished for nothing, until more are wanted
    assert (pair.ended, pair.passed) == (True, 4)
    assert [info.key for info in shards(tmp_path)] == sorted([first.key, second.key])
    calls.planned.clear()
    (result,), _ = run_synth(configs(SynthJob, *WORDS, "n=6", f"out={tmp_path}"))
    assert result.passed == 6
    assert calls.planned == []
    assert third.key in [info.key for info in shards(tmp_path)]
    assert list(tmp_path.rglob(".*")) == []


def test_files_are_hashed_once_however_many_pairs_share_them(
    configs, calls, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    read, original = [], Path.read_bytes

    def counted(path: Path) -> bytes:
        read.append(path)
        return original(path)

    monkeypatch.setattr(Path, "read_bytes", counted)
    (config,) = configs(SynthJob, *WORDS, f"out={tmp_path}")
    key = pair_key(config)
    seen = len(read)
    assert pair_key(config) == key
    assert len(read) == seen


# -- batches of many objects -------------------------------------------------------------------

THREE = (
    *WORDS, "object=cube_small,cube_medium,apple", "planner.batch=8", "planner.steps=2",
)  # fmt: skip


@pytest.fixture
def batches(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Names of the objects of each joint call of the planner."""
    seen, original = [], DfcPlanner.plan_many

    def plan_many(self, hand, objects, count, generators, progress=None):
        seen.append([obj.name for obj in objects])
        return original(self, hand, objects, count, generators, progress)

    monkeypatch.setattr(DfcPlanner, "plan_many", plan_many)
    return seen


def test_a_batch_of_objects_makes_the_shards_that_each_makes_alone(
    configs, calls, batches, tmp_path: Path
):
    results = {}
    for size in (1, 3):
        out = tmp_path / str(size)
        found, _ = run_synth(configs(SynthJob, *THREE, f"objects_per_batch={size}", f"out={out}"))
        results[size] = [made(result) for result in found]
    assert results[1] == results[3] == [(4, 8, 16, "")] * 3
    # two shards of three objects: one by one, then three at a time
    names = ["cube_small", "cube_medium", "apple"]
    assert sorted(map(len, batches)) == [1] * 6 + [3] * 2
    assert [sorted(batch) for batch in batches if len(batch) == 3] == [sorted(names)] * 2
    alone, together = shards(tmp_path / "1"), shards(tmp_path / "3")
    assert [info.key for info in alone] == [info.key for info in together]
    for one, other in zip(alone, together):
        grasps, same = read_shard(one.path), read_shard(other.path)
        torch.testing.assert_close(grasps.poses, same.poses, rtol=0, atol=1e-6)
        torch.testing.assert_close(grasps.joints, same.joints, rtol=0, atol=1e-6)
        assert grasps.object_name == same.object_name
        assert other.provenance["object_hash"] == one.provenance["object_hash"]
        assert set(other.provenance["seconds"]) == set(one.provenance["seconds"])


def test_a_run_in_batches_goes_on_where_it_stopped(
    configs, calls, batches, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    words = (*THREE, "objects_per_batch=2", f"out={tmp_path}")
    original, written = PairState.finish, []

    def finish(self, *what):
        if len(written) == 3:
            raise KeyboardInterrupt
        written.append(self.object_name)
        original(self, *what)

    with monkeypatch.context() as patch:
        patch.setattr(PairState, "finish", finish)
        with pytest.raises(KeyboardInterrupt):
            run_synth(configs(SynthJob, *words))
    assert len(shards(tmp_path)) == 3
    batches.clear()
    found, _ = run_synth(configs(SynthJob, *words))
    assert [result.passed for result in found] == [4, 4, 4]
    # nothing is made twice: three of six shards are missing
    assert sum(map(len, batches)) == 3
    assert len(shards(tmp_path)) == 6


def test_a_batch_has_one_hand_and_one_set_of_options(configs, tmp_path: Path):
    words = ("hand=barrett,ezgripper", "planner.steps=1,2", "seed=0,1", "n=3", f"out={tmp_path}")
    pairs = [PairState.open(config) for config in configs(SynthJob, *THREE, *words)]
    schedule, sizes, taken = Schedule(pairs, 5), [], []
    while (group := schedule.take(None)) is not None:
        configs_of = [task.pair.config for task in group.tasks]
        assert len({config.job.hand for config in configs_of}) == 1
        assert len({config.components["planner"].options.steps for config in configs_of}) == 1
        sizes.append((len(group), len({task.pair for task in group.tasks})))
        taken += [task.key for task in group.tasks]
    # of each hand and option, six pairs (object, seed) want two shards each
    assert sorted(sizes) == [(2, 2)] * 4 + [(5, 5)] * 8
    assert len(set(taken)) == len(taken) == 2 * len(pairs)
    assert {pair.wanted() for pair in pairs} == {0}


def test_a_batch_that_fails_is_made_again_one_by_one(
    configs, calls, batches, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    answers = SapienSimulator.simulate

    def broken(self, hand, obj, grasps, protocol, progress=None):
        if obj.name == "cube_small":
            raise GdgError("cube_small can't be simulated.")
        return answers(self, hand, obj, grasps, protocol, progress)

    words = (*THREE, "objects_per_batch=3", f"out={tmp_path}")
    with monkeypatch.context() as patch:
        patch.setattr(SapienSimulator, "simulate", broken)
        with pytest.raises(GdgError, match=r"^cube_small can't be simulated\.$"):
            run_synth(configs(SynthJob, *words))
    assert {info.object_name for info in shards(tmp_path)} == {"cube_medium", "apple"}
    record = json.loads((tmp_path / "synth.json").read_text())
    assert record["objects_per_batch"] == 3
    assert {p["object"]: p["passed"] for p in record["pairs"]} == {
        "cube_small": 0, "cube_medium": 4, "apple": 4
    }  # fmt: skip
    found, _ = run_synth(configs(SynthJob, *words))
    assert [result.passed for result in found] == [4, 4, 4]


def test_gpus_get_batches_by_themselves(configs):
    for words, size in (
        ((), 1), (("device=cuda",), 16), (("device=cuda:1", "objects_per_batch=3"), 3),
    ):  # fmt: skip
        (config,) = configs(SynthJob, *WORDS, *words)
        assert objects_per_batch(config.job) == size
