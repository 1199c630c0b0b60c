"""``gdg train``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from gdg.cli.settings import configs_from, single, takes_settings
from gdg.errors import GdgError
from gdg.pipeline.jobs import DEFAULTS
from gdg.training.job import TrainJob
from gdg.yaml_files import read_yaml_mapping

#: Components that training uses; a planner takes the generator's place.
TRAIN_DEFAULTS = {kind: DEFAULTS[kind] for kind in ("generator", "distance", "hand_model")}


@click.command()
@takes_settings(TrainJob, TRAIN_DEFAULTS)
def train(settings: tuple[str, ...], files: tuple[Path, ...]) -> None:
    """Train a contact-map generator, or a planner for one hand, on a dataset of gdg synth.

    generator=… learns from the contact maps of all hands, planner=… hand=… from the grasps of one
    hand. Writes checkpoints, learning curves, model.safetensors and model_card.md into the run
    folder; test objects and excluded hands are never seen. Killed at any time, it goes on with
    resume=true.
    """
    defaults = _defaults(settings, files)
    config = single(configs_from(TrainJob, defaults, files, settings))
    from gdg.cli.progress import BarStages, bars
    from gdg.training.train import is_first_process, run_training

    kind = "planner" if "planner" in config.components else "generator"
    with bars() as progress:
        stages = BarStages(progress)

        def stage(name: str):
            report = stages.stage(name)

            def told(done: int, total: int) -> None:
                report(done, total)
                if done == total:
                    progress.stop()  # Lightning draws its own bars

            return told

        weights = run_training(config.job, config.components, stage)
    if not is_first_process():
        return
    click.echo(f"  {weights}")
    name, hand = config.components[kind].record.name, config.job.hand
    words = f"hand={hand} {kind}={name} " if hand else f"{kind}={name} "
    click.echo(f"Use it: gdg grasp … {words}{kind}.weights={weights}")


def _defaults(settings: Sequence[str], files: Sequence[Path]) -> dict[str, str]:
    """The components to choose among: a generator, or the planner that is named.

    Raises:
        GdgError: both are named.
    """
    named = {word.partition("=")[0].partition(".")[0].strip() for word in settings}
    for path in files:
        named |= read_yaml_mapping(path).keys()
    if {"generator", "planner"} <= named:
        raise GdgError(
            "generator=… and planner=… are both given, but one of them is trained at a time; leave "
            "one out."
        )
    if "planner" not in named:
        return TRAIN_DEFAULTS
    return {"planner": "", **{k: v for k, v in TRAIN_DEFAULTS.items() if k != "generator"}}
