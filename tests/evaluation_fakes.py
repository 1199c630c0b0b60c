"""Components that take no time: random grasps, and verdicts that follow from their places."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import torch
from grasp_samples import make_verdict

from gdg.components import Component, Options
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.hookspecs import hookimpl
from gdg.kinds.planner import Planner
from gdg.kinds.simulator import Simulator

#: Environment variable with a file to which every plan and test adds a line, in any process.
LOG = "GDG_TEST_LOG"


def log(text: str) -> None:
    """Adds a line to the log, if there is one."""
    if path := os.environ.get(LOG):
        with Path(path).open("a", encoding="utf-8") as stream:
            stream.write(text + "\n")


class FakePlannerOptions(Options):
    """found: grasps per call, at most; broken: what goes wrong; seconds: told as generate, fit."""

    found: int = 1_000_000
    broken: str = ""
    weights: str = "fake"
    top: int = 1
    adapt: bool = False
    told: bool = False


class FakePlanner(Planner):
    """Random places, rotations about z, random joints."""

    options: FakePlannerOptions

    def plan(self, hand, obj, count, generator, progress=None):
        log(f"plan {hand.hand.name} {obj.name} {count}")
        if self.options.broken == "mistake":
            raise GdgError(f"{obj.name}: this planner gives up.")
        if self.options.broken == "bug":
            raise ZeroDivisionError(obj.name)
        if self.options.broken == "killed":
            os.kill(os.getpid(), 9)
        if self.options.broken == "interrupted":
            raise KeyboardInterrupt
        count = min(count, self.options.found)
        angle = 6.28 * torch.rand(count, generator=generator)
        poses = torch.eye(4).repeat(count, 1, 1)
        poses[:, 0, 0] = poses[:, 1, 1] = angle.cos()
        poses[:, 1, 0], poses[:, 0, 1] = angle.sin(), -angle.sin()
        poses[:, :3, 3] = 0.3 + torch.rand(count, 3, generator=generator)
        lower, upper = (torch.as_tensor(x, dtype=torch.float32) for x in hand.hand.limits())
        joints = lower + (upper - lower) * torch.rand(count, len(lower), generator=generator)
        if self.options.broken == "not finite":
            joints = joints * float("nan")
        seconds = {"generate": 0.25 * count, "fit": 0.5 * count} if self.options.told else {}
        return GraspSet(
            hand.hand.name, obj.name, hand.joint_names, hand.hand.spec.root_link, poses, joints,
            provenance={"rejected": {"too far": 2}, "seconds": seconds},
        )  # fmt: skip


class FakeSimulatorOptions(Options):
    """A grasp passes whose x lies below; early: trials are left out; broken: it fails."""

    below: float = 0.8
    early: bool = False
    broken: bool = False


#: What the fake simulator can't simulate.
LEFT_OUT = "The fake has no friction; the protocol's is left out."


class FakeSimulator(Simulator):
    """Passes where x is small; grasps just below the limit pass in two of three trials."""

    options: FakeSimulatorOptions

    def simulate(self, hand, obj, grasps, protocol, progress=None):
        refined = grasps.targets is not None
        log(f"test {obj.name} {protocol.name} {refined}")
        if self.options.broken:
            raise GdgError(f"{obj.name}: this simulator gives up.")
        return tuple(
            self._verdict(float(x), float(y), protocol.label)
            for x, y in grasps.poses[:, :2, 3].tolist()
        )

    def _verdict(self, x: float, y: float, label: str):
        passed, near = x < self.options.below, 0 < self.options.below - x < 0.1
        trials = (passed, passed, not passed if near else passed)
        failure = "" if passed else ("moved" if y < 0.8 else "lost-contact")
        verdict = make_verdict(
            passed, failure=failure, protocol=label, engine="fake 1.0", shift_successes=trials,
            left_out=(LEFT_OUT,),
        )  # fmt: skip
        return replace(verdict, trials=5) if self.options.early else verdict


class FakePlugin:
    """Registers the fakes, under further names where a test asks for them."""

    def __init__(self, *planners: str):
        self._planners = planners

    @hookimpl
    def gdg_components(self) -> Iterable[Component]:
        target = "evaluation_fakes:FakePlanner"
        planners = [
            Component("planner", name, target, "random grasps", FakePlannerOptions)
            for name in ("fake", *self._planners)
        ]
        target = "evaluation_fakes:FakeSimulator"
        simulator = Component("simulator", "fake", target, "verdicts", FakeSimulatorOptions)
        return [*planners, simulator]
