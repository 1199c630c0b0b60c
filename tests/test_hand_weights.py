"""Weights belong to one hand: found by its body, refused by others."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from gripper import write_gripper
from safetensors.torch import load_file
from torch import nn

from gdg.errors import GdgError
from gdg.hand_weights import HandWeights, load_network
from gdg.hands.hand import Hand, find_hand, load_hand

METADATA = {"distance": "aligned/release", "train_objects": ["mug"]}


def store(folder: Path) -> HandWeights:
    return HandWeights(folder, "graspcvae", "test-1")


def network(width: int = 3) -> nn.Module:
    made = nn.Sequential(nn.Linear(2, width), nn.BatchNorm1d(width))
    with torch.no_grad():
        made[0].weight.fill_(0.25)
    return made


@pytest.fixture
def saved(tmp_path: Path, gripper: Hand) -> Path:
    path = tmp_path / "weights" / "jaws.safetensors"
    store(path.parent).save(path, network(), gripper, METADATA)
    return path


def test_a_hand_finds_its_weights_whatever_the_hand_and_the_file_are_called(
    saved: Path, tmp_path: Path
):
    folder = write_gripper(tmp_path / "other")
    manifest = folder / "hand.yaml"
    manifest.write_text(manifest.read_text().replace("name: two_jaws", "name: my_jaws"))
    found = store(saved.parent).load("", load_hand(folder))
    assert found.path == saved
    assert found.metadata["train_objects"] == ["mug"]
    assert found.metadata["hand"] == "two_jaws"


def test_weights_come_back_in_single_precision_from_half(saved: Path, gripper: Hand):
    assert load_file(saved)["0.weight"].dtype == torch.float16
    made = network()
    with torch.no_grad():
        made[0].weight.zero_()
    load_network(store(saved.parent).load("jaws", gripper), made)
    assert made[0].weight.dtype == torch.float32
    assert (made[0].weight == 0.25).all()
    assert not made.training


def test_without_weights_the_command_that_trains_them_is_named(tmp_path: Path, gripper: Hand):
    with pytest.raises(GdgError, match="gdg train planner=graspcvae hand=two_jaws data="):
        store(tmp_path / "missing").load("", gripper)


@pytest.mark.parametrize("given", ["jaws", "path"])
def test_weights_of_another_hand_are_refused(saved: Path, given: str):
    with pytest.raises(GdgError, match="for the hand 'two_jaws', not for 'barrett'"):
        store(saved.parent).load(str(saved) if given == "path" else given, find_hand("barrett"))


def test_a_changed_body_of_the_same_name_is_refused(saved: Path, tmp_path: Path):
    folder = write_gripper(tmp_path / "longer")
    urdf = folder / "two_jaws.urdf"
    urdf.write_text(urdf.read_text().replace("0.03 0.01 0.06", "0.03 0.01 0.08"))
    with pytest.raises(GdgError, match="one with other joints or shapes"):
        store(saved.parent).load(str(saved), load_hand(folder))


def test_weights_that_do_not_fit_the_network_are_refused(saved: Path, gripper: Hand):
    with pytest.raises(GdgError, match="doesn't fit the network"):
        load_network(store(saved.parent).load("", gripper), network(4))
