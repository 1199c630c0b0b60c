"""``gdg synth`` in a process of its own, with quick components, and ways to kill parts of it.

Linux only: processes are found in ``/proc``.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from gdg.data.dataset import read_shard, shards

#: Made of nothing but random numbers, a shard takes 0.1 s; one grasp in three passes.
PLUGIN = """
import time
from dataclasses import dataclass

import torch

import gdg.quality
from gdg.components import Component, Options
from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.hookspecs import hookimpl
from gdg.kinds.planner import Planner
from gdg.kinds.simulator import Simulator


@dataclass
class NoOverlap:
    object_mm: torch.Tensor
    self_mm: torch.Tensor


# the real ones take longer than all the rest
gdg.quality.exact_overlap = lambda hand, obj, g: NoOverlap(torch.zeros(len(g)), torch.zeros(len(g)))
gdg.quality.measure = lambda hand, obj, grasps: grasps


class QuickOptions(Options):
    seconds: float = 0.1


class QuickPlanner(Planner):
    def plan(self, hand, obj, count, generator, progress=None):
        time.sleep(self.options.seconds)
        poses = torch.eye(4).repeat(count, 1, 1)
        poses[:, :3, 3] = torch.randn(count, 3, generator=generator)
        lower, upper = (torch.as_tensor(x, dtype=torch.float32) for x in hand.hand.limits())
        joints = lower + (upper - lower) * torch.rand(count, len(lower), generator=generator)
        return GraspSet(
            hand.hand.name, obj.name, hand.joint_names, hand.hand.spec.root_link, poses, joints,
            provenance={"candidates": 2 * count, "rejected": {"half of them": count}},
        )


class QuickSimulator(Simulator):
    def simulate(self, hand, obj, grasps, protocol, progress=None):
        return tuple(self._verdict(bool(x > 0.43), protocol.label) for x in grasps.poses[:, 0, 3])

    def _verdict(self, success, label):
        return Verdict(
            success, "" if success else "moved", (0.0,) * 6, (0.0,) * 6, 0.0, (True,) * 6,
            0.0, 0.0, 0.03, (success,), label, "quick", True, 0.0,
        )


@hookimpl
def gdg_components():
    return [
        Component("planner", "quick", "quick_plugin:QuickPlanner", "random grasps", QuickOptions),
        Component("simulator", "quick", "quick_plugin:QuickSimulator", "random verdicts"),
    ]
"""


def write_plugin(folder: Path) -> dict[str, str]:
    """Installs the plugin into a folder; gives the environment in which gdg finds it."""
    (folder / "quick_plugin.py").write_text(PLUGIN)
    info = folder / "quick_plugin-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: quick-plugin\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[gdg]\nquick = quick_plugin\n")
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
    threads = {"OMP_NUM_THREADS": "1"}
    return {**os.environ, **threads, "PYTHONPATH": path, "GDG_STRICT_PLUGINS": "1"}


class Synth:
    """A run of ``gdg synth`` that a test may kill.

    Args:
        environment: as ``write_plugin`` gives it.
        words: of the command line.
    """

    def __init__(self, environment: Mapping[str, str], *words: str):
        code = "from gdg.cli import main; main()"
        self._process = subprocess.Popen(
            [sys.executable, "-c", code, "synth", *words],
            env=dict(environment),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    @property
    def pid(self) -> int:
        """Of the driver."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether the command has ended."""
        return self._process.poll() is not None

    def workers(self) -> list[int]:
        """The driver's worker processes."""
        return [pid for pid in children_of(self.pid) if "spawn_main" in command_of(pid)]

    def kill(self) -> None:
        """Kills the driver, and waits until its workers are gone too."""
        workers = self.workers()
        self._process.kill()
        self._process.communicate()
        deadline = time.monotonic() + 20
        while any(is_alive(pid) for pid in workers):
            assert time.monotonic() < deadline, "workers outlive their driver"
            time.sleep(0.02)

    def wait(self, code: int = 0) -> str:
        """What it said, once it has ended with this exit code."""
        try:
            said, _ = self._process.communicate(timeout=120)
        finally:
            self._process.kill()
        assert self._process.returncode == code, said
        return said


def wait_for_shards(run: Synth, out: Path, count: int) -> None:
    """Returns when a dataset has so many shards, or the run has ended."""
    deadline = time.monotonic() + 90
    while not run.ended and len(list(out.rglob("part-*.parquet"))) < count:
        assert time.monotonic() < deadline, f"{out} does not grow"
        time.sleep(0.02)


def contents(out: Path) -> dict[str, str]:
    """Place of every shard -> hash of its grasps and verdicts; every one is read in full."""
    found = {}
    for info in shards(out):
        assert len(read_shard(info.path)) == info.count
        found[str(info.path.relative_to(out))] = info.content
    return found


def children_of(pid: int) -> list[int]:
    """Processes that a process has started."""
    found = []
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            found += [int(word) for word in (thread / "children").read_text().split()]
    return found


def descendants_of(pid: int) -> list[int]:
    """Processes that a process has started, and those started by them, and so on."""
    return [pid for child in children_of(pid) for pid in (child, *descendants_of(child))]


def command_of(pid: int) -> str:
    """A process's command line, or "" once it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def is_alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state not in "ZX"


def kill(*pids: int) -> None:
    """Kills processes, as ``kill -9`` does; those that are gone already don't matter."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
