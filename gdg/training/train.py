"""``gdg train``: from a grasp dataset to weights with a model card."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import LightningModule
from lightning.pytorch.utilities import rank_zero_only

from gdg.cache import content_hash
from gdg.config import ComponentChoice, RunConfig
from gdg.data.atomic import write_text_atomically
from gdg.data.shards import ShardInfo
from gdg.errors import GdgError, raise_if_any
from gdg.hands.hand import find_hand
from gdg.kinds.fitter import Progress
from gdg.kinds.hand_model import HandModel
from gdg.kinds.trainable import Trainable
from gdg.objects.model import SURFACE_POINTS
from gdg.training.card import model_card
from gdg.training.data import TrainingData
from gdg.training.fit import Fitted, fit
from gdg.training.items import ItemGroup
from gdg.training.job import TrainJob
from gdg.training.source import ItemSource
from gdg.training.split import Split, choose_shards
from gdg.yaml_files import dump_yaml

#: Kinds of components that can be trained.
LEARNERS = ("generator", "planner")
#: What a resumed run must share with the run that it goes on from.
RUN_FILE = "run.json"
WEIGHTS_FILE, CARD_FILE, CONFIG_FILE = "model.safetensors", "model_card.md", "config.yaml"


def run_training(
    job: TrainJob,
    choices: Mapping[str, ComponentChoice],
    stage: Callable[[str], Progress] | None = None,
) -> Path:
    """Trains the chosen generator or planner and writes its weights and model card.

    Writes into ``job.out``: ``model.safetensors``, ``model_card.md``, ``config.yaml``,
    ``run.json``, ``curves.csv``, ``curves.png``, checkpoints and logs.

    Args:
        job: the run's settings.
        choices: config key of a kind -> component, for ``distance``, ``hand_model`` and what is
            trained: ``generator`` or ``planner``.
        stage: begins a stage of that name and gives what its progress is told.

    Returns:
        The path of the weights.

    Raises:
        GdgError: unusable or leaking data, a component that does not learn, settings that don't
            fit it, or a folder that holds another run.
    """
    kind, out = _kind_of(choices), Path(job.out).expanduser()
    if (out / RUN_FILE).is_file() and not job.resume and is_first_process():
        raise GdgError(f"out: {out} holds a training run; write resume=true, or another out=….")
    learner = _learner(kind, choices[kind])
    hand = _hand(kind, learner, job, choices["hand_model"])
    _refuse_unfit(f"{kind} '{choices[kind].record.name}'", learner, job)
    module = learner.trainable(choices[kind].options, job.learning_rate, job.seed, hand)
    split = choose_shards(job, hand.hand if hand is not None else None)
    source = ItemSource(
        choices["distance"], choices["hand_model"], learner.batch_kind, job.maps == "computed"
    )
    report = stage("contact maps") if stage else None
    groups = source.groups((*split.train, *split.validation), report)
    validating = set(split.objects("validation"))
    train = [group for group in groups if group.object_name not in validating]
    validation = [group for group in groups if group.object_name in validating]
    if not train or (split.validation and not validation):
        raise GdgError("data: none of its grasps passed the simulation.")
    data = TrainingData(train, validation, job, learner.batch_kind, source.maker())
    name = hand.hand.name if hand is not None else ""
    facts = {"kind": kind, "hand": name, **_facts(job, choices, source, split), "batch": data.batch}
    if learner.follows_epochs:
        facts["epochs"] = job.epochs
    if is_first_process():
        _claim(out, facts)
        config = RunConfig(job=job, components=dict(choices)).as_tree()
        write_text_atomically(out / CONFIG_FILE, dump_yaml(config))
    fitted = fit(module, data, job, out)
    path = out / WEIGHTS_FILE
    if fitted.is_first:
        known = {**facts, **_counts(train, validation), **_outcome(job, fitted)}
        learner.export(fitted.module, path, known)
        write_text_atomically(out / CARD_FILE, model_card(out.name, known))
    return path


def _kind_of(choices: Mapping[str, ComponentChoice]) -> str:
    """The kind that is trained.

    Raises:
        GdgError: none or both are configured.
    """
    chosen = [kind for kind in LEARNERS if kind in choices]
    if len(chosen) != 1:
        given = "both are given" if chosen else "none is given"
        raise GdgError(f"one of generator=… and planner=… is trained, but {given}.")
    return chosen[0]


def is_first_process() -> bool:
    """Whether this process writes; Lightning starts the others by running the command again."""
    return getattr(rank_zero_only, "rank", None) in (None, 0)


def _learner(kind: str, choice: ComponentChoice) -> type[Trainable]:
    found = choice.record.load()
    if not issubclass(found, Trainable):
        raise GdgError(
            f"{kind} '{choice.record.name}' has nothing to train; choose another {kind}=…."
        )
    return found


def _hand(
    kind: str, learner: type[Trainable], job: TrainJob, hand_model: ComponentChoice
) -> HandModel | None:
    """The hand that is trained for; None where all hands are learned from."""
    if learner.batch_kind == "maps":
        if job.hand:
            raise GdgError(
                f"hand: this {kind} learns from the contact maps of all hands; leave hand= out, "
                f"or hold hands out with exclude_hand=…."
            )
        return None
    if not job.hand:
        raise GdgError(f"hand: this {kind} is trained for one hand; write hand=…, e.g. allegro.")
    model = hand_model.record.load()
    return model(hand_model.options, find_hand(job.hand), torch.device("cpu"))


def _refuse_unfit(name: str, learner: type[Trainable], job: TrainJob) -> None:
    """Raises where items would no longer show what is to be learned from them.

    Args:
        name: of the learner, for messages.
        learner: what is trained.
        job: how items are thinned out and varied.

    Raises:
        GdgError: naming every such setting.
    """
    augment, of_grasps = job.augment, learner.batch_kind == "grasps"
    mistakes = []
    if of_grasps and augment.scale != (1.0, 1.0):
        mistakes.append(
            "augment.scale: grasps can't be scaled with their object, since no joint angles fit "
            "the new size; leave it out."
        )
    if of_grasps and augment.partial:
        mistakes.append(
            "augment.partial: a grasp's contacts on the hidden side would be taken for contacts "
            "with what is seen; leave it out."
        )
    if learner.whole_surfaces and augment.partial:
        mistakes.append(
            f"augment.partial: {name} learns from whole surfaces, since it can't tell a partial "
            f"one from another object; leave it out."
        )
    if learner.whole_surfaces and job.points < SURFACE_POINTS:
        mistakes.append(
            f"points: {name} learns from all {SURFACE_POINTS} points of a surface, since that is "
            f"what it sees when it is used; leave it out."
        )
    raise_if_any(mistakes)


def _facts(
    job: TrainJob, choices: Mapping[str, ComponentChoice], source: ItemSource, split: Split
) -> dict[str, Any]:
    """What decides the outcome, known before training: it goes into the weights' metadata."""
    infos = (*split.train, *split.validation)
    choice = choices[_kind_of(choices)]
    record = choice.record
    return {
        "component": record.name,
        "component_version": f"{record.distribution} {record.version}".strip(),
        "component_options": choice.options.model_dump(mode="json"),
        "gdg_version": metadata.version("gdg"),
        "distance": source.distance.label,
        "recipe": _recipe(infos),
        "hands": sorted({info.hand for info in infos}),
        "held_out_hands": sorted({*job.exclude_hand, *split.held_out_hands()}),
        "held_out_objects": sorted(job.exclude_object),
        **split.record(),
        "train_objects": split.objects("train"),
        "validation_objects": split.objects("validation"),
        "hand_hashes": {info.hand: info.hand_hash for info in infos},
        "object_hashes": {info.object_name: info.object_hash for info in infos},
        "data_sha256": content_hash(*sorted(source.shard_hashes.values())),
        **job.model_dump(
            mode="json",
            include={
                "learning_rate", "points", "seed", "augment", "balance", "ema_decay",
                "gradient_clip", "precision", "maps",
            },
        ),
    }  # fmt: skip


def _recipe(infos: Sequence[ShardInfo]) -> str:
    """Which programs made the grasps, as far as the shards say so."""
    made = set()
    for info in infos:
        used, version = info.provenance.get("components"), info.provenance.get("gdg")
        parts = [f"gdg {version}"] if isinstance(version, str) else []
        for kind in ("planner", "simulator"):
            entry = used.get(kind) if isinstance(used, Mapping) else None
            parts += [f"{kind} {entry.get('name')}"] if isinstance(entry, Mapping) else []
        source = info.provenance.get("source")
        parts += [source] if isinstance(source, str) else []
        made.add(", ".join(parts) or "unknown")
    return "; ".join(sorted(made))


def _counts(train: Sequence[ItemGroup], validation: Sequence[ItemGroup]) -> dict[str, Any]:
    hands: dict[str, list[int]] = {}
    objects: dict[str, list[int]] = {}
    for column, groups in enumerate((train, validation)):
        for group in groups:
            hands.setdefault(group.hand, [0, 0])[column] += group.count
            objects.setdefault(group.object_name, [0, 0])[column] += group.count
    return {
        "train_items": sum(group.count for group in train),
        "validation_items": sum(group.count for group in validation),
        "hand_items": hands,
        "object_items": objects,
    }


def _outcome(job: TrainJob, fitted: Fitted) -> dict[str, Any]:
    return {
        "parameters": _parameters(fitted.module),
        "epochs": fitted.epochs,
        "exported_epoch": fitted.epoch,
        "keep": job.keep,
        "patience": job.patience,
        "batch": fitted.batch,
        "figures": fitted.figures,
        "val_recon": fitted.val_recon,
        "seconds": round(fitted.seconds, 1),
        "device": fitted.device,
    }


def _parameters(module: LightningModule) -> int:
    return sum(parameter.numel() for parameter in module.parameters())


def _claim(out: Path, facts: dict[str, Any]) -> None:
    """Marks ``out`` as this run's.

    Raises:
        GdgError: the run to resume there saw other data or was set otherwise.
    """
    path = out / RUN_FILE
    if not path.is_file():
        write_text_atomically(path, json.dumps(facts, indent=1) + "\n")
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
        changed = [key for key in facts if before.get(key) != facts[key]]
    except (OSError, ValueError, AttributeError) as error:
        raise GdgError(f"{path}: cannot be read: {error}") from error
    if changed:
        raise GdgError(
            f"resume=true: {out} was begun with other values of {', '.join(changed)}; resume with "
            f"the same, or write another out=…."
        )
