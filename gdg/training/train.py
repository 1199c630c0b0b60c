"""``gdg train``: from a grasp dataset to weights with a model card."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from gdg.cache import content_hash
from gdg.config import ComponentChoice
from gdg.data.atomic import write_text_atomically
from gdg.data.dataset import ShardInfo
from gdg.errors import GdgError
from gdg.kinds.generator import Generator
from gdg.training.card import model_card
from gdg.training.fit import Fitted, fit
from gdg.training.job import TrainJob
from gdg.training.maps import MapGroup
from gdg.training.source import MapSource, Split, choose_shards

#: What a resumed run must share with the run that it goes on from.
RUN_FILE = "run.json"
WEIGHTS_FILE, CARD_FILE = "model.safetensors", "model_card.md"


def run_training(job: TrainJob, choices: Mapping[str, ComponentChoice]) -> Path:
    """Trains the chosen generator and writes its weights and model card.

    Writes into ``job.out``: ``model.safetensors``, ``model_card.md``, ``run.json``, checkpoints
    and logs.

    Args:
        job: the run's settings.
        choices: config key of a kind -> component, for ``generator``, ``distance`` and
            ``hand_model``.

    Returns:
        The path of the weights.

    Raises:
        GdgError: unusable or leaking data, a generator that does not learn, or a folder that
            holds another run.
    """
    choice, out = choices["generator"], Path(job.out).expanduser()
    if (out / RUN_FILE).is_file() and not job.resume:
        raise GdgError(f"out: {out} holds a training run; write resume=true, or another out=….")
    generator: type[Generator] = choice.record.load()
    module = generator.trainable(choice.options, job.learning_rate, job.seed)
    split = choose_shards(job)
    source = MapSource(choices["distance"], choices["hand_model"])
    train, validation = _groups(source, split.train), _groups(source, split.validation)
    facts = _facts(job, choices, source, split)
    _claim(out, facts)
    fitted = fit(module, train, validation, job, out)
    known = {**facts, **_outcome(job, fitted, train, validation)}
    path = out / WEIGHTS_FILE
    generator.export(fitted.module, path, known)
    write_text_atomically(out / CARD_FILE, model_card(out.name, known))
    return path


def _groups(source: MapSource, infos: Iterable[ShardInfo]) -> list[MapGroup]:
    groups = [group for group in map(source.group, infos) if group is not None]
    if infos and not groups:
        raise GdgError("data: none of its grasps passed the simulation.")
    return groups


def _facts(
    job: TrainJob, choices: Mapping[str, ComponentChoice], source: MapSource, split: Split
) -> dict[str, Any]:
    """What decides the outcome, known before training: it goes into the weights' metadata."""
    infos = (*split.train, *split.validation)
    record = choices["generator"].record
    return {
        "generator": record.name,
        "generator_version": f"{record.distribution} {record.version}".strip(),
        "gdg_version": metadata.version("gdg"),
        "distance": source.distance.label,
        "hands": sorted({info.hand for info in infos}),
        "held_out_hands": sorted({*job.exclude_hand, *split.held_out_hands()}),
        **split.record(),
        "train_objects": split.objects("train"),
        "validation_objects": split.objects("validation"),
        "hand_hashes": {info.hand: info.hand_hash for info in infos},
        "object_hashes": {info.object_name: info.object_hash for info in infos},
        "data_sha256": content_hash(*sorted(source.shard_hashes.values())),
        "learning_rate": job.learning_rate,
        "points": job.points,
        "seed": job.seed,
    }


def _outcome(
    job: TrainJob, fitted: Fitted, train: list[MapGroup], validation: list[MapGroup]
) -> dict[str, Any]:
    return {
        "train_maps": sum(group.count for group in train),
        "validation_maps": sum(group.count for group in validation),
        "epochs": job.epochs,
        "exported_epoch": fitted.epoch,
        "keep": job.keep,
        "batch": fitted.batch,
        "val_recon": fitted.val_recon,
        "seconds": round(fitted.seconds, 1),
        "device": fitted.device,
    }


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
