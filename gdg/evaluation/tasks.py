"""What workers of an evaluation do: plan grasps, test grasps."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field, replace
from typing import Any

from gdg.assemble import Assembler
from gdg.config import RunConfig
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.evaluation.hardware import hardware, load
from gdg.metrics import palm_directions
from gdg.pipeline.fingerprint import PLANNING, plan_fingerprint, used_components
from gdg.pipeline.pair import Pair, generator_for

#: Metrics that hold where the palm looks, object frame.
PALM = ("palm_x", "palm_y", "palm_z")
#: Pairs of hand and object that a worker keeps loaded.
PAIRS_KEPT = 4
#: Components of the other stage, the test.
TESTING = ("simulator",)
#: Sets of components of a stage that a worker keeps: more than the methods of a table, each a few
#: MB of weights. One that has gone must be built, and its weights read, again.
COMPONENTS_KEPT = 16


@dataclass(frozen=True)
class Task:
    """Grasps to plan, or to test.

    Attributes:
        key: of the plan, or of the cell.
        plan_key: of the plan, as the driver sees its files.
        config: what is planned, or tested.
        planned: the grasps to test; None to plan them.
    """

    key: str
    plan_key: str
    config: RunConfig = field(compare=False, repr=False)
    planned: GraspSet | None = field(default=None, compare=False, repr=False)


def run_task(task: Task) -> GraspSet:
    """Plans and measures grasps, or tests them.

    Raises:
        GdgError: a mistake in what the user gave, or this worker sees other files than the driver.
    """
    if plan_fingerprint(task.config, task.config.job.n) != task.plan_key:
        job = task.config.job
        raise GdgError(
            f"{job.hand} × {job.object}: the files of hand or object, or the version of a "
            f"component, are not those with which the run began; start it again (on a cluster: "
            f"with the same files and versions on every node)."
        )
    if task.planned is None:
        return _planned(_LOADED.pair(task.config, PLANNING))
    return _tested(_LOADED.pair(task.config, TESTING), task.planned)


def forget_pairs() -> None:
    """Lets go of what this process keeps loaded."""
    _LOADED.clear()


def _planned(pair: Pair) -> GraspSet:
    job = pair.job
    _LOADED.warm_up(pair)
    grasps = pair.plan(job.n, generator_for(job.seed), contact_maps=False)
    started = time.perf_counter()
    if len(grasps):
        palms = palm_directions(pair.hand, grasps)
        metrics = {**grasps.metrics, **dict(zip(PALM, palms.unbind(-1), strict=True))}
        grasps = pair.measured(replace(grasps, metrics=metrics))
    seconds = {"measure": time.perf_counter() - started}
    return _stamped(replace(grasps, contact_values=None), "plan", job.device, seconds)


def _tested(pair: Pair, planned: GraspSet) -> GraspSet:
    grasps = pair.simulate(planned) if len(planned) else planned
    return _stamped(grasps, "test", "cpu", {})


def _stamped(grasps: GraspSet, stage: str, device: str, seconds: dict[str, float]) -> GraspSet:
    """The same with seconds, and what they were measured on."""
    told = grasps.provenance
    measured = {"hardware": hardware(device), "load": round(load(), 2)}
    changed: dict[str, Any] = {
        "seconds": {**told.get("seconds", {}), **seconds},
        "measured_on": {**told.get("measured_on", {}), stage: measured},
    }
    return replace(grasps, provenance={**told, **changed})


class _Loaded:
    """Hands, objects and components that this process keeps, those used last at the end."""

    def __init__(self) -> None:
        self._pairs: dict[str, Pair] = {}
        self._components: dict[str, Assembler] = {}
        #: Hand and planning components that have planned in this process, kept or not.
        self._warm: set[tuple[str, str]] = set()

    def pair(self, config: RunConfig, stages: tuple[str, ...]) -> Pair:
        """The pair of a config for some stages; what was loaded for another one is shared."""
        job, hand_key = config.job, _hand_key(config)
        placed = [job.object, job.object_scale, job.scene, job.scene_pose]
        pair_key = json.dumps([hand_key, *placed])
        known = self._pairs.pop(pair_key, None)
        if known is None:
            beside = next((p for k, p in self._pairs.items() if json.loads(k)[0] == hand_key), None)
            known = Pair.load(config, beside)
        self._pairs[pair_key] = known
        for key in list(self._pairs)[:-PAIRS_KEPT]:
            del self._pairs[key]
        return replace(known, config=config, job=job, components=self._assembler(config, stages))

    def warm_up(self, pair: Pair) -> None:
        """Plans a grasp that is thrown away, the first time a hand meets planning components.

        So the seconds of what is planned next hold no compiling, and no reading of weights unless
        there are more than ``COMPONENTS_KEPT`` settings.
        """
        key = _hand_key(pair.config), _components_key(pair.config, PLANNING)
        if key not in self._warm:
            pair.components.get("planner").plan(pair.hand, pair.obj, 1, generator_for(0))
            self._warm.add(key)

    def _assembler(self, config: RunConfig, stages: tuple[str, ...]) -> Assembler:
        key = _components_key(config, stages)
        assembler = self._components.pop(key, None) or Assembler(config.components)
        self._components[key] = assembler
        for other in list(self._components)[:-COMPONENTS_KEPT]:
            del self._components[other]
        return assembler

    def clear(self) -> None:
        self._pairs.clear()
        self._components.clear()
        self._warm.clear()


def _hand_key(config: RunConfig) -> str:
    """What tells the hands that are loaded apart."""
    job = config.job
    return json.dumps([job.hand, job.device, config.components["hand_model"].as_tree()])


def _components_key(config: RunConfig, stages: tuple[str, ...]) -> str:
    """What tells components apart that serve some stages, whatever the others are."""
    used = used_components(config, stages)
    return json.dumps({name: config.components[name].as_tree() for name in used})


_LOADED = _Loaded()
