"""The checks of what learns: a sound learner passes, and each breach is told."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import torch
from gdg_plugins.generator_cvae.generator import CvaeGenerator
from gdg_plugins.generator_cvae.options import CvaeOptions
from safetensors.torch import save_file
from training_samples import TinyGenerator, TinyModule

from gdg.components import NoOptions
from gdg.errors import GdgError
from gdg.kinds.hand_model import HandModel
from gdg.objects.model import ObjectModel
from gdg.testing.fixtures import model_of, small_cube, two_jaws
from gdg.testing.trainable import training_problems


@pytest.fixture(scope="module")
def scene() -> tuple[HandModel, ObjectModel]:
    return model_of(two_jaws()), small_cube()


def problems(component: Any, scene: tuple[HandModel, ObjectModel]) -> list[str]:
    return list(training_problems(component, *scene))


def test_the_built_in_learner_passes_and_what_does_not_learn_is_left_alone(scene) -> None:
    assert problems(CvaeGenerator(CvaeOptions()), scene) == []
    assert problems(object(), scene) == []


class Unseeded(TinyModule):
    def training_step(self, batch, batch_index):
        return super().training_step(batch, batch_index) * torch.rand((), generator=STREAM)


class Silent(TinyModule):
    def validation_step(self, batch, batch_index):
        self.log("val_loss", self.error(batch, 0.0))


class Uncopied(TinyModule):
    def __deepcopy__(self, memo):
        raise TypeError("no copies")


class Infinite(TinyModule):
    def training_step(self, batch, batch_index):
        return super().training_step(batch, batch_index) / 0


STREAM = torch.Generator().manual_seed(0)


def learner(module: type[TinyModule], **attributes: Any) -> TinyGenerator:
    def trainable(cls, options, learning_rate, seed, hand=None):
        return module(learning_rate, attributes.get("seed", seed))

    def export(cls, module, path: Path, metadata: Mapping[str, Any]):
        save_file(module.state_dict(), path, metadata={"gdg": json.dumps(metadata)})

    members = {"trainable": classmethod(trainable), "export": classmethod(export)}
    return type("Learner", (TinyGenerator,), {**members, **attributes})(NoOptions())


def test_each_breach_is_told(scene) -> None:
    assert problems(learner(TinyModule), scene) == []
    for module, told in (
        (Unseeded, "another loss at the same place"),
        (Silent, "must log 'val_recon'"),
        (Uncopied, "can't be copied"),
        (Infinite, "a finite number with a gradient"),
    ):
        (problem,) = problems(learner(module), scene)
        assert told in problem
    (problem,) = problems(learner(TinyModule, batch_kind="pictures"), scene)
    assert "batch_kind is 'pictures'" in problem
    (problem,) = problems(TinyGenerator(NoOptions()), scene)
    assert "store the metadata as JSON under 'gdg'" in problem


def test_weights_that_no_seed_decides_are_told(scene) -> None:
    class Fresh(TinyModule):
        def __init__(self, learning_rate: float, seed: int):
            super().__init__(learning_rate, int(torch.randint(10**9, (), generator=STREAM)))

    found = problems(learner(Fresh), scene)
    assert "other weights with the same seed" in found[0]


def test_a_refused_hand_is_no_breach(scene) -> None:
    def refuse(cls, options, learning_rate, seed, hand=None):
        raise GdgError("this hand has one finger")

    assert problems(learner(TinyModule, trainable=classmethod(refuse)), scene) == []
