"""Checks of what ``gdg train`` can train: repeatable steps, a figure to choose by, weights."""

from __future__ import annotations

import copy
import json
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from gdg.errors import GdgError
from gdg.kinds.hand_model import HandModel
from gdg.kinds.trainable import BatchKind, Trainable
from gdg.objects.model import ObjectModel
from gdg.rotations import q_from_pose, random_rotations
from gdg.testing.checks import seeded
from gdg.training.batches import AnyBatch, GraspBatch, MapBatch

#: Items of the batch, and points of each: enough for batch norm, quick for any network.
ITEMS, POINTS = 4, 256
LEARNING_RATE = 1e-3
METADATA = {"distance": "aligned/release", "hands": ["two_jaws"]}


def training_problems(component: Any, hand: HandModel, obj: ObjectModel) -> Iterator[str]:
    """What is wrong with how a component is trained; nothing where it does not learn.

    Args:
        component: any component.
        hand: to train for, where the component is trained for one hand; it may be refused.
        obj: gives the points.
    """
    if not isinstance(component, Trainable):
        return
    learner: Any = type(component)
    kind = getattr(learner, "batch_kind", None)
    if kind not in get_args(BatchKind):
        yield f"batch_kind is {kind!r}, not one of {', '.join(get_args(BatchKind))}."
        return
    batch = _batch(learner.batch_kind, hand, obj)
    options, own = getattr(component, "options", None), hand if kind == "grasps" else None
    try:
        yield from _module_problems(learner, options, own, batch)
    except GdgError:  # the gripper, or an object with so few points, is refused
        return


def _module_problems(
    learner: type[Trainable], options: Any, hand: HandModel | None, batch: AnyBatch
) -> Iterator[str]:
    first, second = (learner.trainable(options, LEARNING_RATE, 0, hand) for _ in range(2))
    if not _equal(first.state_dict(), second.state_dict()):
        yield "trainable gave other weights with the same seed: draw them from a seeded generator."
    try:
        copy.deepcopy(first)
    except Exception as error:  # foreign code
        yield f"the module can't be copied, as ema_decay needs it to be: {error}"
    steps = [_step(module, batch) for module in (first, second)]
    if steps[0].ndim or not steps[0].requires_grad or not bool(steps[0].isfinite()):
        yield "training_step must give a finite number with a gradient."
        return
    if not torch.equal(*steps):
        yield (
            "training_step gave another loss at the same place of a run: draw random numbers from "
            "gdg.training.randomness.step_generator."
        )
    with _logged(first.eval()) as figures, torch.no_grad():
        first.validation_step(batch, 0)
    figure = figures.get("val_recon")
    if figure is None or not bool(torch.as_tensor(figure).isfinite()):
        yield "validation_step must log 'val_recon', a finite number."
    yield from _export_problems(learner, first)


def _export_problems(learner: type[Trainable], module: Any) -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        learner.export(module, path, METADATA)
        try:
            with safe_open(path, framework="pt") as stored:
                text = (stored.metadata() or {}).get("gdg", "")
        except (SafetensorError, OSError) as error:
            yield f"export wrote no readable safetensors file: {error}"
            return
    known = _mapping_in(text)
    if any(known.get(name) != value for name, value in METADATA.items()):
        yield "export must store the metadata as JSON under 'gdg'; see gdg.weights_files."


def _mapping_in(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _step(module: Any, batch: AnyBatch) -> Tensor:
    """The loss of a step as ``gdg train`` makes it: with the global stream seeded."""
    with torch.random.fork_rng(devices=[]), _logged(module.train()):
        torch.manual_seed(0)
        return module.training_step(batch, 0)


@contextmanager
def _logged(module: Any) -> Iterator[dict[str, Any]]:
    """What a module logs, which has no trainer to log to."""
    figures: dict[str, Any] = {}
    module.log = lambda name, value, **how: figures.update({name: value})
    module.log_dict = lambda values, **how: figures.update(values)
    try:
        yield figures
    finally:
        del module.log, module.log_dict


def _batch(kind: BatchKind, hand: HandModel, obj: ObjectModel) -> AnyBatch:
    random = seeded()
    points, normals = (x[:POINTS].expand(ITEMS, -1, -1) for x in (obj.points, obj.normals))
    values = torch.rand(points.shape[:2], generator=random)
    if kind == "maps":
        return MapBatch(points, values, normals)
    poses = torch.eye(4).repeat(ITEMS, 1, 1)
    poses[:, :3, :3] = random_rotations(ITEMS, random)
    poses[:, :3, 3] = 0.1 * torch.randn(ITEMS, 3, generator=random)
    share = torch.rand(ITEMS, len(hand.joint_names), generator=random)
    joints = hand.lower + share * (hand.upper - hand.lower)
    return GraspBatch(points, normals, values, q_from_pose(poses, joints))


def _equal(a: Mapping[str, Tensor], b: Mapping[str, Tensor]) -> bool:
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)
