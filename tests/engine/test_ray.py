"""``engine=ray`` on a cluster of two nodes, started by the ordinary commands, one of which dies."""

from __future__ import annotations

import contextlib
import os
import random
import secrets
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from disturbed_synth import (
    Synth,
    command_of,
    contents,
    descendants_of,
    kill,
    wait_for_shards,
    write_plugin,
)
from gripper import write_gripper

pytest.importorskip("ray", reason="ray is not installed")
pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc"),
    pytest.mark.timeout(600),
]

RAY = Path(sys.executable).with_name("ray")
WORDS = (
    "object=cube_small,cube_medium", "planner=quick", "simulator=quick", "n=60", "shard=12",
    "max_shards=40", "hand_model.surface_points=60",
)  # fmt: skip
#: Deaths in every run of the tests, and with ``--every-moment``.
DEATHS = (1, 4)


class Node:
    """A Ray node that ends with the test."""

    def __init__(self, environment: dict[str, str], *words: str):
        quiet = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_health_check_period_ms": "500"}
        self._process = subprocess.Popen(
            [RAY, "start", *words, "--num-cpus=1", "--object-store-memory=80000000", "--block"],
            env={**environment, **quiet},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def workers(self) -> list[int]:
        """All processes of the node: Ray's own, and gdg's workers."""
        return descendants_of(self._process.pid)

    def kill(self) -> None:
        """Kills every process of the node at once."""
        kill(self._process.pid, *self.workers())
        self._process.wait()


class Cluster:
    """A head node and a second one."""

    def __init__(self, environment: dict[str, str]):
        self._environment = environment
        with contextlib.closing(socket.socket()) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.address = f"127.0.0.1:{port}"
        self.head = Node(environment, "--head", f"--port={port}", "--include-dashboard=false")
        self._wait_for_head()
        self.second = self.add()

    def add(self) -> Node:
        """A further node."""
        return Node(self._environment, f"--address={self.address}")

    def _wait_for_head(self) -> None:
        host, _, port = self.address.partition(":")
        deadline = time.monotonic() + 60
        while True:
            with contextlib.suppress(OSError), socket.create_connection((host, int(port)), 1):
                return
            assert time.monotonic() < deadline, "the head node does not start"
            time.sleep(0.1)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """With a token of the tests' own, so that nobody else on the machine can use their cluster."""
    folder = tmp_path_factory.mktemp("ray")
    token = folder / "token"
    token.touch(0o600)
    token.write_text(secrets.token_hex(32))
    secured = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": str(token)}
    return {**write_plugin(folder), **secured}


@pytest.fixture
def cluster(environment: dict[str, str]) -> Iterator[Cluster]:
    started = Cluster(environment)
    yield started
    started.second.kill()
    started.head.kill()


def wait_until_it_works(node: Node) -> None:
    """Returns when a task runs on a node."""
    deadline = time.monotonic() + 90
    while not any("ray::_Actor.call" in command_of(pid) for pid in node.workers()):
        assert time.monotonic() < deadline, "the node gets no work"
        time.sleep(0.02)


def test_a_node_that_dies_loses_nothing(
    cluster: Cluster, environment: dict[str, str], request: pytest.FixtureRequest, tmp_path: Path
):
    deaths = DEATHS[bool(request.config.getoption("--every-moment"))]
    folder, moments = write_gripper(tmp_path / "hands"), random.Random(3)
    # slow enough that nodes come and go while it runs
    words = (f"hand={folder}", *WORDS, f"planner.seconds={0.4 * deaths}")
    undisturbed, out = tmp_path / "undisturbed", tmp_path / "out"
    Synth(environment, *words, f"out={undisturbed}", "workers=1").wait()

    by_ray = ("engine=ray", f"ray_address={cluster.address}", f"out={out}")
    run = Synth(environment, *words, *by_ray)
    for _ in range(deaths):
        wait_until_it_works(cluster.second)
        time.sleep(moments.uniform(0.0, 0.8 * deaths))
        assert not run.ended, "over before the node could die"
        cluster.second.kill()
        assert set(contents(out).items()) <= set(contents(undisturbed).items())
        cluster.second = cluster.add()
    run.wait()
    assert contents(out) == contents(undisturbed)


def test_a_driver_that_dies_is_resumed_and_other_mistakes_are_told(
    cluster: Cluster, environment: dict[str, str], tmp_path: Path
):
    folder, out = write_gripper(tmp_path / "hands"), tmp_path / "out"
    words = (f"hand={folder}", *WORDS, "engine=ray", f"ray_address={cluster.address}")
    run = Synth(environment, *words, f"out={out}")
    wait_for_shards(run, out, 3)
    run.kill()
    left = contents(out)
    said = Synth(environment, *words, f"out={out}").wait()
    again = contents(out)
    assert left.items() <= again.items()
    assert len(left) < len(again)
    assert "ray" not in said.lower().replace(str(tmp_path).lower(), "")
    lost = Synth(environment, *words, f"out={out}", "ray_address=127.0.0.1:1", "n=61").wait(2)
    assert "Error: ray_address=127.0.0.1:1: no connection to Ray" in lost
    assert "Traceback" not in lost
    assert os.path.isdir(out)
