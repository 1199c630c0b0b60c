"""The fitter improves, stops when its populations agree, and never leaves the limits."""

from __future__ import annotations

import torch
from gdg_acme.evolution import EvolutionFitter
from gdg_acme.options import EvolutionOptions

from gdg.data.grasps import GraspSet
from gdg.kinds.distance import Distance
from gdg.kinds.hand_model import HandModel
from gdg.registry import get_registry
from gdg.testing.fixtures import StandInGenerator, model_of, small_cube, two_jaws

CUBE = small_cube(256)


def distance() -> Distance:
    record = get_registry().find("distance", "huber")
    return record.load()(record.options())


def fit(hand: HandModel, **options: object) -> GraspSet:
    """Fits one map of two opposite spots on a cube."""
    metric = distance()
    maps = StandInGenerator(metric).generate(CUBE, 1, torch.Generator().manual_seed(0))
    fitter = EvolutionFitter(EvolutionOptions(**{"population": 12, **options}), distance=metric)
    return fitter.fit(hand, CUBE, maps, torch.Generator().manual_seed(1))


def test_more_generations_never_make_it_worse():
    hand = model_of(two_jaws())
    exact = {"every": 1, "tolerance": 0}
    totals = [float(fit(hand, generations=n, **exact).energies["total"]) for n in (1, 10, 40)]
    assert totals[0] > totals[1] > totals[2]


def test_it_stops_when_the_population_agrees():
    found = fit(model_of(two_jaws()), tolerance=100.0)
    assert found.status == ("converged",)
    assert fit(model_of(two_jaws()), tolerance=0, generations=2).status == ("hit_limit",)


def test_joints_stay_within_their_limits():
    hand = model_of(two_jaws())
    joints = fit(hand, generations=20).joints
    assert bool(((joints >= hand.lower) & (joints <= hand.upper)).all())
