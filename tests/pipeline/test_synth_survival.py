"""Whatever is killed with kill -9, and whenever: the grasps are those of an undisturbed run.

Six random moments in every run of the tests, all twenty with ``--every-moment`` (two minutes);
those of Ray nodes are in ``tests/engine/test_ray.py``.
"""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from disturbed_synth import Synth, contents, kill, wait_for_shards, write_plugin

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc")

#: Some 60 shards of three pairs; one grasp in three passes.
SHARDS = 60
WORDS = (
    "object=cube_small,cube_medium,apple", "planner=quick", "simulator=quick", "n=80", "shard=12",
    "max_shards=40", "hand_model.surface_points=60",
)  # fmt: skip
#: Kills in every run of the tests, and in a full one: of workers, of drivers.
WORKER_KILLS, DRIVER_KILLS = (3, 8), (2, 8)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return write_plugin(tmp_path_factory.mktemp("plugin"))


@pytest.fixture(scope="module")
def start(environment: dict[str, str], hand_folder: Path) -> Callable[..., Synth]:
    def begin(out: Path, *words: str) -> Synth:
        return Synth(environment, f"hand={hand_folder}", *WORDS, f"out={out}", *words)

    return begin


@pytest.fixture(scope="module")
def undisturbed(start, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    out = tmp_path_factory.mktemp("undisturbed")
    start(out, "workers=1").wait()
    found = contents(out)
    assert 0.7 * SHARDS < len(found) < 1.4 * SHARDS
    assert len(set(found.values())) == len(found)
    return found


@pytest.fixture
def kills(request: pytest.FixtureRequest) -> Callable[[tuple[int, int]], int]:
    return lambda few_all: few_all[bool(request.config.getoption("--every-moment"))]


def test_killed_workers_lose_nothing(start, undisturbed, kills, tmp_path: Path):
    moments, run = random.Random(1), start(tmp_path, "workers=2")
    for _ in range(kills(WORKER_KILLS)):
        done = len(list(tmp_path.rglob("part-*.parquet")))
        wait_for_shards(run, tmp_path, done + 2)
        time.sleep(moments.uniform(0.0, 0.15))
        assert not run.ended, "over before a worker could die"
        kill(moments.choice(run.workers()))
    run.wait()
    assert contents(tmp_path) == undisturbed


def test_a_killed_driver_loses_only_shards_in_flight(start, undisturbed, kills, tmp_path: Path):
    moments, count = random.Random(2), kills(DRIVER_KILLS)
    for number in range(count):
        before = set(contents(tmp_path).items())
        run = start(tmp_path, "workers=2")
        wait_for_shards(run, tmp_path, len(before) + 3)
        time.sleep(moments.uniform(0.0, 0.15))
        assert not run.ended, "over before the driver could die"
        run.kill()
        found = contents(tmp_path)
        # what was there stays, and is of the one dataset
        assert before <= set(found.items()) <= set(undisturbed.items()), number
    start(tmp_path, "workers=2").wait()
    assert contents(tmp_path) == undisturbed
