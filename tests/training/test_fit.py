"""Fitting: resume to the bit wherever a run was killed, averages, stopping, the best epoch."""

from __future__ import annotations

import csv
import multiprocessing
import signal
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from training_samples import TinyModule, data_of, same_weights, synthetic_groups, tiny_job

from gdg.errors import GdgError
from gdg.training.callbacks import place_of
from gdg.training.fit import Fitted, fit, read_checkpoint
from gdg.training.job import TrainJob
from gdg.training.order import Place

TRAIN, VALIDATION = synthetic_groups(40), synthetic_groups(12)  # five steps per epoch
WITH_VALIDATION = {"keep": "best", "val_fraction": 0.5}


def run(job: TrainJob, out: Path, die_at: int | None = None) -> Fitted:
    validation = VALIDATION if job.val_fraction else []
    module = TinyModule(0.01, seed=3, die_at=die_at)
    return fit(module, data_of(job, TRAIN, validation), job, out)


def run_until_killed(job: TrainJob, out: Path, step: int) -> None:
    """The run in a process of its own, killed as it begins a step (counted from 0)."""
    child = multiprocessing.get_context("fork").Process(target=run, args=(job, out, step))
    child.start()
    child.join(60)
    assert child.exitcode == -signal.SIGKILL


@pytest.mark.parametrize(
    ("killed_at", "settings", "goes_on_at"),
    [
        (8, {}, Place(1, 2)),  # in mid-epoch, after a checkpoint of step 7
        (6, {}, Place(1)),  # between the epoch's checkpoint and the next
        (9, {"checkpoint_steps": 4}, Place(1, 4)),  # the epoch's last step is all that is left
        (8, {"ema_decay": 0.8, "augment": {"rotation": "full", "partial": 0.5}}, Place(1, 2)),
        (13, {**WITH_VALIDATION, "ema_decay": 0.5, "patience": 2}, Place(2, 2)),
    ],
)
def test_a_killed_run_goes_on_to_the_same_bits(
    killed_at: int, settings: dict, goes_on_at: Place, tmp_path: Path
) -> None:
    job = tiny_job(**{"epochs": 3, "checkpoint_steps": 2, **settings})
    whole = run(job, tmp_path / "whole")
    run_until_killed(job, tmp_path / "killed", killed_at)
    last = tmp_path / "killed" / "checkpoints" / "last.ckpt"
    assert place_of(read_checkpoint(last)) == goes_on_at
    resumed = run(job.model_copy(update={"resume": True}), tmp_path / "killed")
    assert same_weights(resumed.module.state_dict(), whole.module.state_dict())
    assert (resumed.epoch, resumed.epochs) == (whole.epoch, whole.epochs)
    assert resumed.val_recon == whole.val_recon


def test_a_run_of_more_epochs_goes_on_from_one_of_fewer(tmp_path: Path) -> None:
    whole = run(tiny_job(epochs=3), tmp_path / "whole")
    run(tiny_job(epochs=2), tmp_path / "parts")
    resumed = run(tiny_job(epochs=3, resume=True), tmp_path / "parts")
    assert same_weights(resumed.module.state_dict(), whole.module.state_dict())
    again = run(tiny_job(epochs=3, resume=True), tmp_path / "other")  # nothing there: begins
    assert same_weights(again.module.state_dict(), whole.module.state_dict())


def test_another_seed_gives_other_weights_and_the_global_stream_is_left_alone(
    tmp_path: Path,
) -> None:
    before = torch.random.get_rng_state()
    first = run(tiny_job(epochs=1), tmp_path / "a").module.state_dict()
    assert torch.equal(torch.random.get_rng_state(), before)
    other = run(tiny_job(epochs=1, seed=1), tmp_path / "b").module.state_dict()
    assert not same_weights(first, other)


def test_best_epoch_is_kept_and_its_error_reported(tmp_path: Path) -> None:
    fitted = run(tiny_job(epochs=3, **WITH_VALIDATION), tmp_path)
    rows = list(csv.DictReader((tmp_path / "curves.csv").open()))
    errors = [float(row["val_recon"]) for row in rows]
    assert [row["steps"] for row in rows] == ["5", "10", "15"]
    assert fitted.val_recon == pytest.approx(min(errors), rel=1e-4)
    assert fitted.epoch == int(np.argmin(errors))
    assert fitted.figures["val_recon"] == fitted.val_recon
    with Image.open(tmp_path / "curves.png") as picture:
        assert picture.width > 300


class Recording(TinyModule):
    """Keeps a layer's weights as they are after every step."""

    def on_train_start(self) -> None:
        self.seen: list[torch.Tensor] = []

    def on_train_batch_end(self, outputs, batch, batch_idx) -> None:
        self.seen.append(self.first.weight.detach().clone())


def test_average_is_what_is_kept_and_validated(tmp_path: Path) -> None:
    module, job = Recording(0.01, seed=3), tiny_job(ema_decay=0.9, **WITH_VALIDATION)
    fitted = fit(module, data_of(job, TRAIN, VALIDATION), job, tmp_path)
    expected = module.seen[0]
    for weights in module.seen[1 : 5 * (fitted.epoch + 1)]:
        expected = 0.9 * expected + 0.1 * weights
    torch.testing.assert_close(fitted.module.first.weight, expected)
    plain = run(tiny_job(), tmp_path / "plain").module.state_dict()
    last = read_checkpoint(tmp_path / "checkpoints" / "last.ckpt")
    assert same_weights(last["current_model_state"], plain), "training itself is the same"
    batch = data_of(job, VALIDATION)._train[0].items
    whole = [data_of(job, VALIDATION)._train[number].items for number in range(12)]
    stacked = type(batch)(*(torch.cat(parts) for parts in zip(*whole, strict=True)))
    with torch.no_grad():
        assert module.eval().error(stacked, 0.0).item() == pytest.approx(fitted.val_recon, rel=1e-4)


def test_training_stops_when_validation_gets_no_better(tmp_path: Path) -> None:
    job = tiny_job(epochs=30, patience=2, learning_rate=1, **WITH_VALIDATION)
    module = TinyModule(1.0, seed=3)  # far too fast to get better for long
    fitted = fit(module, data_of(job, TRAIN, VALIDATION), job, tmp_path)
    assert fitted.epochs < 30
    assert fitted.epochs == fitted.epoch + 1 + 2
    again = fit(
        TinyModule(1.0, seed=3),
        data_of(job, TRAIN, VALIDATION),
        job.model_copy(update={"resume": True}),
        tmp_path,
    )
    assert (again.epochs, again.val_recon) == (fitted.epochs, fitted.val_recon)
    assert same_weights(again.module.state_dict(), fitted.module.state_dict())


def test_stopping_early_needs_validation(tmp_path: Path) -> None:
    with pytest.raises(GdgError, match="patience: stopping early needs validation"):
        run(tiny_job(patience=1), tmp_path)


class NeverFinite(TinyModule):
    def error(self, batch, noise):
        return super().error(batch, noise) * float("nan")


def test_a_diverged_training_is_told(tmp_path: Path) -> None:
    job = tiny_job(epochs=1)
    with pytest.raises(GdgError, match="training diverged"):
        fit(NeverFinite(0.01, 3), data_of(job, TRAIN), job, tmp_path)


def test_checkpoint_with_code_is_refused(tmp_path: Path) -> None:
    torch.save({"state_dict": {}, "hook": Path("x")}, tmp_path / "last.ckpt")
    with pytest.raises(GdgError, match="more than plain values"):
        read_checkpoint(tmp_path / "last.ckpt")


def test_one_item_is_refused() -> None:
    with pytest.raises(GdgError, match="one grasp to train on"):
        data_of(tiny_job(), synthetic_groups(1))
