"""Speed of what is run most; skipped unless asked for.

    pytest tests/benchmarks --benchmark-only

Times depend on the machine and its load: each result carries the number of threads and the version
of torch. Beside other work, threads that spin while they wait slow each other down a hundredfold;
OMP_WAIT_POLICY=PASSIVE, or one thread (OMP_NUM_THREADS=1), avoids that. Rows of
one group do the same work in different ways, or for different hands.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jaxtyping
import pytest
import torch
from gdg_plugins.fitter_adam.fitter import AdamFitter
from gdg_plugins.fitter_adam.options import AdamOptions
from gdg_plugins.planner_dfc.energy import Contacts, GraspEnergy
from gdg_plugins.planner_dfc.options import DfcOptions
from gdg_plugins.simulator_sapien.options import SapienOptions
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from torch import Tensor

from gdg.data.contact_map import ContactMap
from gdg.data.grasps import GraspSet
from gdg.folders import HANDS
from gdg.hands.hand import load_hand
from gdg.initial_poses import above_surface, around_sphere
from gdg.kinds.distance import Distance
from gdg.kinds.fitter import Fitter
from gdg.kinds.hand_model import HandModel
from gdg.nearest import EPSILON_M, nearest_hand_points
from gdg.nearest.eager import nearest_exhaustive
from gdg.objects.batch import ObjectBatch
from gdg.objects.model import ObjectModel, find_object
from gdg.registry import get_registry
from gdg.starts import prepare
from gdg.testing.fixtures import StandInGenerator, model_of, quick_protocol

PARTICLES, SURFACE_POINTS = 32, 1600
CHAINS = 128


@dataclass(frozen=True)
class Scene:
    """A hand around an object, and a map to fit."""

    hand: HandModel
    obj: ObjectModel
    distance: Distance
    q: Tensor
    maps: ContactMap


@pytest.fixture(autouse=True)
def as_users_run_it() -> Iterator[None]:
    """No shape checker, and the threads that torch takes by itself."""
    checked, threads = jaxtyping.config.jaxtyping_disable, torch.get_num_threads()
    jaxtyping.config.update("jaxtyping_disable", True)
    torch.set_num_threads(int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1)))
    yield
    jaxtyping.config.update("jaxtyping_disable", checked)
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True)
def circumstances(benchmark: Any, as_users_run_it: None) -> None:
    benchmark.extra_info.update(
        torch=torch.__version__,
        torch_threads=torch.get_num_threads(),
        processors=os.cpu_count(),
        wait_policy=os.environ.get("OMP_WAIT_POLICY", ""),
    )


@pytest.fixture(params=["bundled allegro", "real shadowhand"])
def scene(request: pytest.FixtureRequest) -> Scene:
    origin, name = request.param.split()
    real: Path | None = request.getfixturevalue("real_hands") if origin == "real" else None
    folder = real / name if real else HANDS.find(name).path
    hand, obj = model_of(load_hand(folder), SURFACE_POINTS), find_object("apple")
    record = get_registry().find("distance", "aligned")
    distance: Distance = record.load()(record.options())
    generator = torch.Generator().manual_seed(0)
    q = around_sphere(hand, obj, PARTICLES, generator)
    maps = StandInGenerator(distance).generate(obj, 1, generator)
    return Scene(hand, obj, distance, q, maps)


def test_kinematics_and_surface_forward_and_backward(benchmark: Any, scene: Scene):
    benchmark.group = f"surface of {PARTICLES} poses, forward and backward"
    probe = scene.q.clone().requires_grad_(True)

    def run() -> None:
        probe.grad = None
        scene.hand.surface_points(probe).square().sum().backward()

    benchmark(run)


@pytest.mark.parametrize("search", ["compiled", "eager"])
def test_nearest_points_of_the_aligned_distance(benchmark: Any, scene: Scene, search: str):
    obj, hand_points = scene.obj, scene.hand.surface_points(scene.q)
    shape = f"{PARTICLES} × {len(obj.points)} × {hand_points.shape[1]}"
    benchmark.group = f"aligned distance {shape}, {scene.hand.hand.name}"
    if search == "compiled":
        nearest_hand_points(obj.points, obj.normals, hand_points[:1], 1.0)  # compiles
        benchmark(nearest_hand_points, obj.points, obj.normals, hand_points, 1.0)
    else:
        arguments = (obj.points, obj.normals, hand_points, 1.0, EPSILON_M)
        benchmark.pedantic(nearest_exhaustive, arguments, rounds=3, warmup_rounds=1)


def test_fit_step(benchmark: Any, scene: Scene):
    benchmark.group = f"one step of the fit, {PARTICLES} particles"
    fitter = AdamFitter(AdamOptions(), distance=scene.distance)
    energy = fitter.energy(scene.hand, scene.obj, scene.maps)
    maps = torch.zeros(PARTICLES, dtype=torch.long)
    probe = scene.q.clone().requires_grad_(True)

    def run() -> None:
        probe.grad = None
        energy.total(energy.terms(probe, maps), 0.5).sum().backward()

    benchmark(run)


@pytest.mark.parametrize("name", ["adam", "halving"])
def test_full_fit(benchmark: Any, scene: Scene, name: str):
    benchmark.group = f"fit of one map, {scene.hand.hand.name}"
    record = get_registry().find("fitter", name)
    fitter: Fitter = record.load()(record.options(), distance=scene.distance)

    def run() -> GraspSet:
        generator = torch.Generator().manual_seed(0)
        return fitter.fit(scene.hand, scene.obj, scene.maps, generator)

    fitted = benchmark.pedantic(run, rounds=3, warmup_rounds=1)
    energies = fitted.energies["total"]
    benchmark.extra_info.update(
        lowest_energy=energies.min().item(), energy_of_those_kept=energies.mean().item()
    )


def test_force_closure_step(benchmark: Any, scene: Scene):
    options = DfcOptions()
    benchmark.group = f"one step of force closure, {CHAINS} chains"
    energy = GraspEnergy(scene.hand, ObjectBatch([scene.obj]), options)
    generator = torch.Generator().manual_seed(0)
    q = above_surface(scene.hand, scene.obj, CHAINS, generator).requires_grad_(True)
    shape = (CHAINS, options.contacts)
    regions = len(scene.hand.regions.corners)
    region = torch.randint(regions, shape, generator=generator)
    place = torch.rand(*shape, 2, generator=generator).requires_grad_(True)

    def run() -> None:
        terms = energy.terms(q, Contacts(region, place), options.surface_stride)
        torch.autograd.grad(energy.total(terms).sum(), (q, place))

    benchmark(run)


def test_one_protocol(benchmark: Any, scene: Scene):
    benchmark.group = "dro-2024, one trial of six directions"
    protocol = quick_protocol(per_direction=False)
    fitter = AdamFitter(AdamOptions(particles=8, steps=50), distance=scene.distance)
    generator = torch.Generator().manual_seed(0)
    grasps = fitter.fit(scene.hand, scene.obj, scene.maps, generator)
    prepared = prepare(scene.hand, scene.obj, grasps, protocol)
    simulator = SapienSimulator(SapienOptions())
    arguments = (scene.hand, scene.obj, prepared, protocol)
    (verdict,) = benchmark.pedantic(simulator.simulate, arguments, rounds=3, warmup_rounds=1)
    benchmark.extra_info["trial_seconds"] = verdict.seconds
    benchmark.extra_info["outcome"] = verdict.failure or "success"
