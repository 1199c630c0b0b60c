"""Small items, a small learner of each kind and a small dataset to train on."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from lightning.pytorch import LightningModule
from safetensors.torch import save_file
from torch import Tensor, nn

from gdg.components import Component, NoOptions, Options
from gdg.config import ComponentChoice
from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.hands.hand import find_hand
from gdg.kinds.generator import Generator
from gdg.kinds.hand_model import HandModel
from gdg.kinds.planner import Planner
from gdg.kinds.trainable import BatchKind, Trainable
from gdg.registry import get_registry
from gdg.rotations import random_rotations
from gdg.training.data import TrainingData
from gdg.training.items import ItemGroup
from gdg.training.job import TrainJob
from gdg.training.randomness import step_generator

FACTS = {"hand_hash": "h", "object_hash": "o", "split": "train"}
#: What makes a run tiny.
TINY = {"points": 64, "epochs": 2, "progress": False, "accelerator": "cpu"}
DOF = 13


def component(kind: str, name: str) -> ComponentChoice:
    """A registered component with its default options."""
    record = get_registry().find(kind, name)
    return ComponentChoice(record=record, options=record.options())


def choices() -> dict[str, ComponentChoice]:
    """What ``gdg train`` uses by default."""
    return {
        "generator": component("generator", "cvae"),
        "distance": component("distance", "aligned"),
        "hand_model": component("hand-model", "pytorch-kinematics"),
    }


def choices_with(kind: str, target: str) -> dict[str, ComponentChoice]:
    """A learner of this module in place of the default generator."""
    record = Component(
        kind=kind, name="tiny", target=f"training_samples:{target}", summary="", options=NoOptions
    )
    rest = {key: choice for key, choice in choices().items() if key != "generator"}
    return {kind: ComponentChoice(record=record, options=NoOptions()), **rest}


def some_grasps(hand: str, object_name: str, count: int, seed: int = 0) -> GraspSet:
    """Barrett hands around the object, palm toward it."""
    random = torch.Generator().manual_seed(seed)
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, :3, :3] = random_rotations(count, random)
    poses[:, :3, 3] = -0.08 * poses[:, :3, 2]
    return GraspSet(
        hand=hand,
        object_name=object_name,
        joint_names=find_hand("barrett").spec.joints,
        root_link="palm",
        poses=poses,
        joints=torch.rand(count, 4, generator=random),
    )


def synthetic_groups(*counts: int, hand: str = "hand") -> list[ItemGroup]:
    """Items by formula on random points, one object per count: no hand, no mesh."""
    groups = []
    for number, count in enumerate(counts or (24,)):
        random = torch.Generator().manual_seed(number)
        points = 0.05 * torch.randn(128, 3, generator=random)
        normals = torch.nn.functional.normalize(points, dim=-1)
        directions = torch.randn(count, 3, generator=random)
        directions = torch.nn.functional.normalize(directions, dim=-1)
        q = torch.cat((0.1 * directions, torch.randn(count, DOF - 3, generator=random)), 1)
        groups.append(
            ItemGroup(
                hand,
                f"thing{number}",
                torch.cat((points, normals), 1).numpy(),
                count,
                torch.sigmoid(60 * directions @ points.T - 1).half().numpy(),
                q.numpy(),
            )
        )
    return groups


def data_of(
    job: TrainJob, train: list[ItemGroup], validation: list[ItemGroup] | None = None
) -> TrainingData:
    """The data module of some groups."""
    return TrainingData(train, validation or [], job, "maps")


def tiny_job(**settings: Any) -> TrainJob:
    """A job without validation unless told otherwise."""
    settings = {"data": "-", "keep": "last", "val_fraction": 0, "batch": 8, **TINY, **settings}
    return TrainJob(**settings)


class TinyModule(LightningModule):
    """Fits contact values point by point, with all that a resume may break.

    Batch norm has buffers, dropout draws from the global stream, the noise from the step's.
    """

    def __init__(self, learning_rate: float, seed: int, inputs: int = 6, die_at: int | None = None):
        super().__init__()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.first, self.norm = nn.Linear(inputs, 16), nn.BatchNorm1d(16)
            self.last = nn.Linear(16, 1)
        self.dropout = nn.Dropout(0.3)
        self.learning_rate, self.seed, self.die_at = learning_rate, seed, die_at

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.Adam(self.parameters(), lr=self.learning_rate)

    def forward(self, inputs: Tensor) -> Tensor:
        hidden = self.norm(self.first(inputs).flatten(0, -2)).unflatten(0, inputs.shape[:-1])
        return self.last(self.dropout(hidden.relu()))[..., 0]

    def error(self, batch: Any, noise: Tensor | float) -> Tensor:
        inputs = torch.cat((20 * batch.points, batch.normals), dim=-1) + noise
        return (self(inputs) - batch.values).square().mean()

    def training_step(self, batch: Any, batch_index: int) -> Tensor:
        if self.die_at is not None and self.global_step == self.die_at:
            os.kill(os.getpid(), signal.SIGKILL)
        random = step_generator(self, self.seed, batch_index)
        shape = (*batch.points.shape[:2], 6)
        loss = self.error(batch, 0.01 * torch.randn(shape, generator=random))
        self.log("train_loss", loss, on_step=False, on_epoch=True, batch_size=len(batch.points))
        return loss

    def validation_step(self, batch: Any, batch_index: int) -> None:
        self.log("val_recon", self.error(batch, 0.0), batch_size=len(batch.points))


class TinyGraspModule(TinyModule):
    """Regresses q from the object: what a planner of one hand would learn."""

    def __init__(self, learning_rate: float, seed: int, dof: int):
        super().__init__(learning_rate, seed)
        self.last = nn.Linear(16, dof)

    def error(self, batch: Any, noise: Tensor | float) -> Tensor:
        inputs = torch.cat((20 * batch.points, batch.normals), dim=-1) + noise
        hidden = self.norm(self.first(inputs).flatten(0, 1)).unflatten(0, inputs.shape[:2])
        return (self.last(hidden.relu().amax(1)) - batch.q).square().mean()


class TinyGenerator(Generator, Trainable):
    """A generator of a constant."""

    batch_kind: ClassVar[BatchKind] = "maps"

    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        return ContactMap(obj.name, torch.zeros(count, len(obj.points)), "aligned/release")

    @classmethod
    def trainable(
        cls, options: Options, learning_rate: float, seed: int, hand: HandModel | None = None
    ) -> LightningModule:
        assert hand is None
        return TinyModule(learning_rate, seed)

    @classmethod
    def export(cls, module: LightningModule, path: Path, metadata: Mapping[str, Any]) -> None:
        save_file(dict(module.state_dict()), path, metadata={"gdg": str(metadata)})


class TinyPlanner(Planner, Trainable):
    """A planner that finds nothing."""

    batch_kind: ClassVar[BatchKind] = "grasps"

    def plan(self, *args: Any, **kwargs: Any) -> GraspSet:
        raise GdgError("not here")

    @classmethod
    def trainable(
        cls, options: Options, learning_rate: float, seed: int, hand: HandModel | None = None
    ) -> LightningModule:
        assert hand is not None
        return TinyGraspModule(learning_rate, seed, 9 + len(hand.joint_names))

    @classmethod
    def export(cls, module: LightningModule, path: Path, metadata: Mapping[str, Any]) -> None:
        TinyGenerator.export(module, path, metadata)


def same_weights(a: Mapping[str, Tensor], b: Mapping[str, Tensor]) -> bool:
    """Whether two states are equal to the bit."""
    return a.keys() == b.keys() and all(
        np.array_equal(a[name].cpu().numpy(), b[name].cpu().numpy()) for name in a
    )
