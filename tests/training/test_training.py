"""Whole runs: what a run folder holds, what is refused, what is recorded."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from gdg_plugins.generator_cvae.weights import load_weights
from pydantic import ValidationError
from safetensors import safe_open
from training_samples import TINY, choices, choices_with, component, some_grasps

from gdg.config import ComponentChoice
from gdg.data.dataset import write_shard
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.objects.model import find_object
from gdg.registry import get_registry
from gdg.splits import load_split
from gdg.training.job import AugmentOptions, TrainJob
from gdg.training.train import run_training

SMALL = {**TINY, "val_fraction": 0.34, "batch": 8}


def test_run_writes_weights_card_and_logs_and_refuses_to_overwrite(
    dataset: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    job = TrainJob(data=str(dataset), out=str(out), **SMALL)
    weights = load_weights(str(run_training(job, choices())))
    weights.network()
    known = weights.provenance
    assert weights.distance == "aligned/release"
    assert (known["kind"], known["component"], known["hand"]) == ("generator", "cvae", "")
    assert known["hands"] == ["barrett"]
    assert sorted(known["train_objects"] + known["validation_objects"]) == [
        "cube_small",
        "lemon",
        "orange",
    ]
    assert len(known["validation_objects"]) == 1
    assert (known["train_items"], known["validation_items"]) == (24, 12)
    assert 0 < known["val_recon"] < 1
    assert (known["split"], known["split_sha256"]) == ("none", "")
    card = (out / "model_card.md").read_text()
    assert f"| {known['validation_objects'][0]} | 0 / 12 |" in card
    assert f"| `val_recon` | {known['val_recon']:.4f} |" in card
    parameters = sum(p.numel() for p in weights.network().parameters())
    assert f"| parameters | {parameters:,} |" in card
    assert "jitter_m=0.001" in card
    assert "another hand" not in card
    for name in ("checkpoints/last.ckpt", "checkpoints/best.ckpt", "curves.png", "run.json"):
        assert (out / name).is_file()
    assert "val_recon" in (out / "logs" / "version_0" / "metrics.csv").read_text()
    config = yaml.safe_load((out / "config.yaml").read_text())
    assert (config["augment"]["jitter_m"], config["generator"]["name"]) == (0.001, "cvae")
    with pytest.raises(GdgError, match="holds a training run"):
        run_training(job, choices())
    changed = {"resume": True, "learning_rate": 0.1, "augment": {"rotation": "full"}}
    other = TrainJob(**{**job.model_dump(), **changed})
    with pytest.raises(GdgError, match="begun with other values of learning_rate, augment"):
        run_training(other, choices())


def test_a_planner_is_trained_on_the_grasps_of_its_hand(dataset: Path, tmp_path: Path) -> None:
    job = TrainJob(data=str(dataset), out=str(tmp_path / "run"), hand="barrett", **SMALL)
    picked = choices_with("planner", "TinyPlanner")
    with safe_open(run_training(job, picked), framework="np") as stored:
        assert stored.get_tensor("last.weight").shape == (13, 16)
    card = (tmp_path / "run" / "model_card.md").read_text()
    assert "Planner `tiny`" in card
    assert "for the hand `barrett`" in card
    assert "planner.weights=" in card


def test_what_does_not_fit_what_is_trained_is_refused(dataset: Path, tmp_path: Path) -> None:
    job = TrainJob(data=str(dataset), out=str(tmp_path / "run"), **SMALL)
    planner, generator = choices_with("planner", "TinyPlanner"), choices()

    def refused(picked: dict[str, ComponentChoice], **changes: object) -> str:
        with pytest.raises(GdgError) as caught:
            run_training(TrainJob(**{**job.model_dump(), **changes}), picked)
        return str(caught.value)

    assert "trained for one hand; write hand=" in refused(planner)
    varied = {"hand": "barrett", "augment": {"scale": [0.9, 1.1], "partial": 0.5}}
    assert "augment.scale: grasps can't be scaled" in refused(planner, **varied)
    assert "augment.partial: a grasp's contacts on the hidden side" in refused(planner, **varied)
    flow = {**generator, "generator": component("generator", "flow")}
    whole = {"points": 2048, "augment": {}}
    assert "points: generator 'flow' learns from all 2048 points" in refused(flow)
    partial = refused(flow, **{**whole, "augment": {"partial": 0.1}})
    assert partial.startswith("augment.partial: generator 'flow' learns from whole surfaces")
    assert "\n" not in partial
    assert "learns from the contact maps of all hands" in refused(generator, hand="barrett")
    assert "no grasps of hand 'allegro'; it has: barrett" in refused(planner, hand="allegro")
    assert "but both are given" in refused({**planner, **generator})
    nothing = {key: choice for key, choice in generator.items() if key != "generator"}
    assert "but none is given" in refused(nothing)
    record = get_registry().find("generator", "oracle")
    oracle = ComponentChoice(record=record, options=record.options(grasps="x"))
    assert "generator 'oracle' has nothing to train" in refused({**nothing, "generator": oracle})
    dfc = {**nothing, "planner": component("planner", "dfc")}
    assert "planner 'dfc' has nothing to train" in refused(dfc, hand="barrett")
    assert "keep=best needs validation" in refused(generator, val_fraction=0)
    assert not (tmp_path / "run").exists()


def test_run_with_a_lock_takes_its_validation_objects_and_records_it(tmp_path: Path) -> None:
    data, hand = tmp_path / "data", find_hand("barrett")
    for name in ("lemon", "mustard_bottle"):
        facts = {"hand_hash": hand.content_hash, "split": "train"}
        content = find_object(name).content_hash
        write_shard(data, "k", some_grasps("barrett", name, 8), {**facts, "object_hash": content})
    tiny = {**TINY, "epochs": 1}
    job = TrainJob(
        data=str(data), out=str(tmp_path / "run"), split="paper-without-allegro", batch=4, **tiny
    )
    known = load_weights(str(run_training(job, choices()))).provenance
    assert (known["train_objects"], known["validation_objects"]) == (["lemon"], ["mustard_bottle"])
    assert known["held_out_hands"] == ["allegro", "allegro_right"]
    assert known["split"] == "paper-without-allegro-v1"
    assert known["split_sha256"] == load_split("paper-without-allegro").content_hash
    card = (tmp_path / "run" / "model_card.md").read_text()
    assert f"| split | paper-without-allegro-v1 (`{known['split_sha256']}`) |" in card
    assert "With 1 validation object(s) the figures above say little" in card


def test_all_options_together_run_and_resume(dataset: Path, tmp_path: Path) -> None:
    settings = {
        **SMALL,
        "maps": "computed",
        "balance": "pairs",
        "ema_decay": 0.9,
        "patience": 5,
        "keep": "last",
        "checkpoint_steps": 1,
        "augment": {"rotation": "full", "partial": 0.5, "scale": [0.9, 1.1], "jitter_m": 0.002},
    }
    picked = choices_with("generator", "TinyGenerator")
    whole = TrainJob(data=str(dataset), out=str(tmp_path / "whole"), **settings)
    parts = TrainJob(data=str(dataset), out=str(tmp_path / "parts"), **{**settings, "epochs": 1})
    run_training(whole, picked)
    run_training(parts, picked)
    resumed = parts.model_copy(update={"resume": True, "epochs": 2})
    weights = []
    for path in (tmp_path / "whole" / "model.safetensors", run_training(resumed, picked)):
        with safe_open(path, framework="np") as stored:
            weights.append({name: stored.get_tensor(name) for name in stored.keys()})  # noqa: SIM118
    for name in weights[0]:
        np.testing.assert_array_equal(weights[0][name], weights[1][name])
    card = (tmp_path / "parts" / "model_card.md").read_text()
    assert "| average of the weights | exponential, decay 0.9 |" in card
    assert "| points per item, balance | 64, pairs |" in card


def test_a_schedule_over_the_epochs_is_resumed_with_the_same_number_only(
    dataset: Path, tmp_path: Path
) -> None:
    options = {"width": 16, "layers": 1, "heads": 2, "draws": 1}
    record = get_registry().find("generator", "flow")
    flow = ComponentChoice(record=record, options=record.options(**options))
    picked = {**choices(), "generator": flow}
    job = TrainJob(data=str(dataset), out=str(tmp_path), **{**SMALL, "points": 2048, "epochs": 1})
    run_training(job, picked)
    for changed in ("epochs", "batch"):
        longer = job.model_copy(update={"resume": True, changed: 4})
        with pytest.raises(GdgError, match=f"begun with other values of {changed}; resume with"):
            run_training(longer, picked)
    run_training(job.model_copy(update={"resume": True}), picked)


def test_job_reads_one_name_or_a_list_and_refuses_typos() -> None:
    assert TrainJob(data="x", exclude_hand="a").exclude_hand == ("a",)
    assert TrainJob(data="x", exclude_object=["a", "b"]).exclude_object == ("a", "b")
    assert json.loads(TrainJob(data="x").model_dump_json())["exclude_hand"] == []
    with pytest.raises(ValidationError):
        TrainJob(data="x", epoch=3)  # type: ignore[call-arg]


def test_the_page_on_training_has_every_option() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "training.md").read_text()
    names = {*TrainJob.model_fields} - {"augment"}
    names |= {f"augment.{name}" for name in AugmentOptions.model_fields}
    assert [name for name in sorted(names) if f"`{name}`" not in page] == []
