"""Shards are whole, made once, and hold the grasps that passed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from gripper import write_gripper

from gdg.cli.settings import configs_from
from gdg.data.dataset import read_shard, shards
from gdg.errors import GdgError
from gdg.pipeline.fingerprint import fingerprint
from gdg.pipeline.jobs import SYNTH_DEFAULTS, SynthJob
from gdg.pipeline.synth import run_synth
from gdg.protocols import FOLDER as PRESETS

WORDS = ("object=cube_small", "n=3", "shard=4", "max_shards=3")


def test_shards_hold_what_passed_until_there_are_enough(configs, calls, tmp_path: Path):
    (result,), folder = run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    # two of four candidates pass
    assert (result.passed, result.tested, result.candidates, result.reason) == (4, 8, 8, "")
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
    made = len(calls.planned)
    (again,), _ = run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert len(calls.planned) == made
    assert (again.passed, again.tested, again.candidates) == (4, 0, 0)
    # more grasps: only what is missing is made
    (more,), _ = run_synth(configs(SynthJob, *WORDS, "n=5", f"out={tmp_path}"))
    assert len(calls.planned) == made + 1
    assert (more.passed, more.tested) == (6, 4)


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
    assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == 1
    (result,), _ = run_synth(configs(SynthJob, *WORDS, f"out={tmp_path}"))
    assert (result.passed, result.tested) == (4, 4)


def test_a_pair_without_grasps_is_given_up_with_a_reason(configs, calls, tmp_path: Path):
    words = (*WORDS, "planner.max_distance_m=1e-9", f"out={tmp_path}")
    (result,), _ = run_synth(configs(SynthJob, *words))
    assert (result.passed, result.tested, result.candidates) == (0, 0, 12)
    assert "0 of 3 grasps after 3 shards" in result.reason
    # empty shards are remembered
    planned = len(calls.planned)
    run_synth(configs(SynthJob, *words))
    assert len(calls.planned) == planned
    assert all(info.count == 0 for info in shards(tmp_path))


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
