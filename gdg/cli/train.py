"""``gdg train``."""

from __future__ import annotations

from pathlib import Path

import click

from gdg.cli.settings import configs_from, single, takes_settings
from gdg.training.job import TrainJob

#: Components that training uses.
TRAIN_DEFAULTS = {
    "generator": "cvae",
    "distance": "aligned",
    "hand_model": "pytorch-kinematics",
}


@click.command()
@takes_settings(TrainJob, TRAIN_DEFAULTS)
def train(settings: tuple[str, ...], files: tuple[Path, ...]) -> None:
    """Train a contact-map generator on a dataset of gdg synth.

    Writes checkpoints, logs, model.safetensors and model_card.md into the run folder; test
    objects and excluded hands are never seen.
    """
    config = single(configs_from(TrainJob, TRAIN_DEFAULTS, files, settings))
    from gdg.training.train import run_training

    weights = run_training(config.job, config.components)
    click.echo(f"  {weights}")
    click.echo(f"Use it: gdg grasp … generator.weights={weights}")
