"""Workers give what one process gives; those that die are replaced, tasks that kill are given up.

The functions are the standard library's, since workers can't import test modules.
"""

from __future__ import annotations

import math
import operator
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from gdg.engine import Engine, Outcome, TaskTimedOut, WorkersKilled, make_engine
from gdg.engine.local import LocalEngine
from gdg.errors import GdgError


def each(tasks: Iterable) -> Callable:
    waiting = iter(list(tasks))
    return lambda last: next(waiting, None)


def results(engine: Engine, function: Callable, tasks: Iterable) -> dict:
    return {outcome.task: outcome.result for outcome in engine.run(function, each(tasks))}


@pytest.mark.parametrize("workers", [1, 2])
def test_every_task_comes_back_with_its_result(workers: int):
    assert results(LocalEngine(workers), operator.neg, range(1, 6)) == {i: -i for i in range(1, 6)}


@pytest.mark.parametrize("workers", [1, 2])
def test_what_runs_next_may_depend_on_what_came_back(workers: int):
    waiting = [2]
    seen = []
    for outcome in LocalEngine(workers).run(
        operator.neg, lambda _: waiting.pop() if waiting else None
    ):
        seen.append(outcome.result)
        if len(seen) < 3:
            waiting.append(outcome.task + 1)
    assert seen == [-2, -3, -4]


def test_a_free_worker_is_known_by_its_last_task():
    waiting, asked = [1, 2], []

    def take(last: int | None) -> int | None:
        asked.append(last)
        return waiting.pop(0) if waiting else None

    list(LocalEngine(1).run(operator.neg, take))
    assert asked == [None, 1, 2]


@pytest.mark.parametrize("workers", [1, 2])
def test_what_a_task_raises_leaves_the_others_alone(workers: int):
    found = {o.task: o for o in LocalEngine(workers).run(math.sqrt, each([4.0, -1.0, 9.0]))}
    assert (found[4.0].result, found[9.0].result) == (2.0, 3.0)
    assert isinstance(found[-1.0].error, ValueError)


def test_a_task_that_kills_its_workers_is_given_up_and_the_others_go_on():
    tasks = ["__import__('os')._exit(3)", "-5", "-6"]
    outcomes = list(LocalEngine(2).run(eval, each(tasks)))
    killed = [o for o in outcomes if o.error is not None]
    assert sorted(o.result for o in outcomes if o.error is None) == [-6, -5]
    assert len(killed) == 1
    assert isinstance(killed[0].error, WorkersKilled)
    assert isinstance(killed[0].error, GdgError)
    assert "killed 3 times" in str(killed[0].error)
    assert "exit code 3" in str(killed[0].error)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_task_that_takes_too_long_is_stopped(workers: int):
    started = time.monotonic()
    found = {o.task: o for o in LocalEngine(workers, timeout_s=1.0).run(time.sleep, each([0, 300]))}
    assert time.monotonic() - started < 60
    assert found[0].error is None
    assert isinstance(found[300].error, TaskTimedOut)
    assert str(found[300].error) == "took longer than 1 s"


@pytest.mark.parametrize("workers", [1, 2])
def test_a_larger_task_may_take_longer(workers: int):
    engine = make_engine("local", workers, timeout_s=0.25, size=lambda seconds: 1 + 100 * seconds)
    outcomes = list(engine.run(time.sleep, each([0.5, 0.4])))
    assert [outcome.error for outcome in outcomes] == [None, None]


def test_leaving_early_stops_the_workers():
    outcomes = LocalEngine(2).run(time.sleep, each([0, 300, 300]))
    assert next(outcomes) == Outcome(0, None)
    started = time.monotonic()
    outcomes.close()
    assert time.monotonic() - started < 10


def test_a_ray_address_where_nobody_answers_is_told_at_once():
    pytest.importorskip("ray", reason="ray is not installed")
    started = time.monotonic()
    with pytest.raises(GdgError, match=r"ray_address=127\.0\.0\.1:1: no connection to Ray"):
        list(make_engine("ray", address="127.0.0.1:1").run(operator.neg, each([1])))
    assert time.monotonic() - started < 15


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's /proc")
def test_ctrl_c_is_held_back_from_the_first_process_too():
    code = """
        import multiprocessing, pathlib, signal
        from gdg.engine.process import WorkerProcess
        worker = WorkerProcess(threads=1)
        pid = multiprocessing.active_children()[0].pid
        status = pathlib.Path(f"/proc/{pid}/status").read_text()
        blocked = int(status.split("SigBlk:")[1].split()[0], 16)
        worker.kill()
        assert blocked >> (signal.SIGINT - 1) & 1
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True)
