"""``gdg train`` from the command line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from command_line import Outcome, refused
from training_samples import some_grasps

from gdg.data.dataset import write_shard
from gdg.hands.hand import find_hand
from gdg.objects.model import find_object

Run = Callable[..., Outcome]
TINY = ("points=32", "epochs=1", "progress=false", "accelerator=cpu", "batch=4")


@pytest.fixture
def data(tmp_path: Path) -> Path:
    root, hand = tmp_path / "data", find_hand("barrett")
    for name in ("lemon", "orange"):
        obj = find_object(name)
        facts = {"hand_hash": hand.content_hash, "object_hash": obj.content_hash, "split": "train"}
        write_shard(root, "k", some_grasps("barrett", name, 6), facts)
    return root


def test_run_of_one_line_can_be_repeated_and_resumed(run: Run, data: Path, tmp_path: Path) -> None:
    words = (f"data={data}", "generator=cvae", "val_fraction=0.5")
    augmented = ("augment.rotation=yaw", "augment.jitter_m=0.002")
    done = run("train", *words, *augmented, "out=a", *TINY)
    assert done.code == 0, done.err
    assert "Use it: gdg grasp … generator=cvae generator.weights=a/model.safetensors" in done.out
    config = yaml.safe_load((tmp_path / "a" / "config.yaml").read_text())
    assert config["augment"] == {
        "jitter_m": 0.002, "rotation": "yaw", "scale": [1.0, 1.0], "partial": 0.0,
    }  # fmt: skip
    refused(run("train", "-c", "a/config.yaml"), "holds a training run; write resume=true")
    assert run("train", "-c", "a/config.yaml", "resume=true", "epochs=2").code == 0
    assert "| 2 / " in (tmp_path / "a" / "model_card.md").read_text()


def test_mistakes_are_told_in_a_sentence(run: Run, data: Path) -> None:
    given = (f"data={data}", *TINY)
    refused(run("train", *given, "generator=cvae", "planner=dfc"), "both given, but one of them")
    refused(run("train", *given, "planner.x=1"), "Unknown planner ''. Known:")
    refused(run("train", *given, "planner=dfc", "hand=barrett"), "'dfc' has nothing to train")
    refused(run("train", *given, "hand=barrett"), "learns from the contact maps of all hands")
    refused(run("train", *given, "augment.rotate=yaw"), "augment.rotate", "Did you mean 'rotation'")
    refused(run("train", *given, "augment.scale=[1.1, 0.9]"), "augment.scale: must be [smallest")
    refused(run("train", *given, "balance=hand"), "balance:")
    refused(run("train", "data=no-such-folder"), "no-such-folder: there is no such folder")


def test_help_explains_nested_options(run: Run) -> None:
    told = run("train", "--help").out
    assert "augment.jitter_m standard deviation of the noise" in told
    assert "patience" in told
