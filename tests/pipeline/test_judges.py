"""Processes that help with the test: same verdicts, whoever gave them and whatever ends."""

from __future__ import annotations

import pickle
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from grasp_samples import make_verdict
from training_samples import some_grasps

from gdg.components import Options
from gdg.config import RunConfig
from gdg.data.grasps import GraspSet, load_grasps
from gdg.data.verdict import Verdict
from gdg.engine.process import ProcessEnded
from gdg.errors import GdgError
from gdg.pipeline import judges as module
from gdg.pipeline.grasp import run_grasp
from gdg.pipeline.jobs import GraspJob
from gdg.pipeline.judges import Judges
from gdg.pipeline.pair import Pair, generator_for
from gdg.protocols import Protocol, load_protocol
from gdg.report import contact_sheet

PROTOCOL = load_protocol("dro-2024")
GRASPS = some_grasps("barrett", "cube_small", 3)


@pytest.fixture
def config(configs, tmp_path: Path) -> Callable:
    """The one config of some words, with ``out`` in the temporary folder."""
    return lambda *words: configs(
        GraspJob, "object=cube_small", "n=3", f"out={tmp_path / 'run'}", *words
    )[0]


class Answers:
    """In place of a process: has started and is ready, then gives these; None: it ends."""

    def __init__(self, *answers: Verdict | Exception | None):
        self.messages = [b"", b""]
        self.messages += [answer and pickle.dumps(_packed(answer)) for answer in answers]

    def __call__(self, threads: int) -> Answers:
        return self

    def send(self, function: Callable, task: object) -> None:
        """Needs no telling."""

    def receive(self) -> bytes:
        """The next message."""
        message = self.messages.pop(0) if self.messages else None
        if message is None:
            raise ProcessEnded("SIGKILL")
        return message

    def kill(self) -> None:
        """Nothing to end."""


def _packed(answer: Verdict | Exception) -> tuple[Verdict | None, Exception | None, str]:
    return (None, answer, "") if isinstance(answer, Exception) else (answer, None, "")


def judged_here(grasp: GraspSet, protocol: Protocol) -> Verdict:
    assert len(grasp) == 1
    return make_verdict(True)


def verdicts(
    config: RunConfig, monkeypatch: pytest.MonkeyPatch, process: Answers
) -> tuple[list[Verdict], list[int]]:
    """Verdicts of grasps, the first by that process, and how many there were when."""
    monkeypatch.setattr(module, "WorkerProcess", process)
    told: list[int] = []

    def meanwhile() -> None:
        while process.messages:
            time.sleep(0.001)

    with Judges(config, 1) as judges:
        found = judges.verdicts(
            GRASPS, PROTOCOL, judged_here, lambda done, total: told.append(done), meanwhile
        )
    return found, told


def test_verdicts_are_in_the_order_of_the_grasps(config, monkeypatch: pytest.MonkeyPatch):
    given = [make_verdict(False), make_verdict(True), make_verdict(False)]
    found, told = verdicts(config(), monkeypatch, Answers(*given))
    assert _timeless(found) == _timeless(given)
    assert told == [1, 2, 3]


def test_what_a_killed_process_leaves_is_judged_here(config, monkeypatch: pytest.MonkeyPatch):
    found, told = verdicts(config(), monkeypatch, Answers(make_verdict(False), None))
    assert [one.success for one in found] == [False, True, True]
    assert told == [1, 2, 3]


def test_what_a_test_raises_there_is_raised_here(config, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(GdgError, match="no such joint"):
        verdicts(config(), monkeypatch, Answers(make_verdict(True), GdgError("no such joint")))


def test_nobody_waits_for_a_process_that_is_not_ready(config, monkeypatch: pytest.MonkeyPatch):
    class Slow(Answers):
        def receive(self) -> bytes:
            time.sleep(60)
            return b""

    monkeypatch.setattr(module, "WorkerProcess", Slow())
    started = time.monotonic()
    with Judges(config(), 1) as judges:
        found = judges.verdicts(GRASPS, PROTOCOL, judged_here, lambda *_: None, lambda: None)
    assert len(found) == 3
    assert time.monotonic() - started < 30


def test_a_run_is_the_same_with_and_without_help(config):
    alone = run_grasp(config("picture=false", "report=false"))
    with Judges(config(), 1) as judges:
        helped = run_grasp(config(), None, judges)
    assert sorted(path.name for path in helped.folder.iterdir()) == [
        "config.yaml", "grasps.json", "grasps.png", "report.html",
    ]  # fmt: skip
    assert len(alone.grasps) == 3
    assert _timeless(helped.grasps.verdicts) == _timeless(alone.grasps.verdicts)
    assert helped.grasps.provenance["seconds"]["simulate"] > 0


def test_other_processes_give_the_verdicts_that_this_one_gives(config):
    pair = Pair.load(config())
    grasps = pair.plan(3, generator_for(0))
    here = pair.components.get("simulator").simulate(pair.hand, pair.obj, grasps, PROTOCOL)
    done = threading.Event()

    def not_here(grasp: GraspSet, protocol: Protocol) -> Verdict:
        raise AssertionError("the other process was not ready in time")

    def report(count: int, total: int) -> None:
        if count == total:
            done.set()

    with Judges(config(), 1) as judges:
        there = judges.verdicts(grasps, PROTOCOL, not_here, report, lambda: done.wait(120) and None)
    assert _timeless(there) == _timeless(here)


def _timeless(verdicts: Sequence[Verdict]) -> list[str]:
    """Their texts, since nan is not itself."""
    return [repr(replace(one, seconds=0.0)) for one in verdicts]


def test_options_that_cannot_be_sent_are_tested_with_here(config):
    class OfThisTest(Options):
        one_by_one = True

    given = config("n=8", "workers=4")
    mine = given.components["simulator"].model_copy(update={"options": OfThisTest()})
    components = {**given.components, "simulator": mine}
    assert len(Judges.of_job(given.model_copy(update={"components": components}))) == 0


def test_a_picture_that_fails_costs_no_verdict(
    config, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    def no_screen(*args: object) -> None:
        raise GdgError("no screen")

    monkeypatch.setattr(contact_sheet, "grasp_views", no_screen)
    monkeypatch.setattr(module, "WorkerProcess", Answers(*[make_verdict(True)] * 3))
    with Judges(config(), 1) as judges, pytest.raises(GdgError, match="no screen"):
        run_grasp(config(), None, judges)
    assert len(load_grasps(tmp_path / "run" / "grasps.json").verdicts) == 3


@pytest.mark.parametrize(
    ("words", "count"),
    [
        (("n=1", "workers=2"), 1),
        (("n=1", "workers=2", "picture=false"), 0),
        (("n=8", "workers=16"), 2),
        (("n=8", "workers=1"), 0),
        (("n=8", "simulate=false"), 0),
        (("n=8", "workers=4", "verified=true"), 0),
    ],
)
def test_as_many_processes_as_help(
    config, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], count: int
):
    monkeypatch.setattr(module, "WorkerProcess", Answers())
    assert len(Judges.of_job(config(*words))) == count


def test_a_simulator_of_another_make_gets_all_grasps_at_once(
    config, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "WorkerProcess", Answers())
    given = config("n=8", "workers=4")
    other = given.components["simulator"].model_copy(update={"options": Options()})
    components = {**given.components, "simulator": other}
    assert len(Judges.of_job(given.model_copy(update={"components": components}))) == 0
