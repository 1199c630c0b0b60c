"""What we ship conforms, and the conformance kit catches what doesn't."""

from __future__ import annotations

import sys
import types
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from gdg_plugins.distance_aligned.distance import AlignedDistance
from gdg_plugins.distance_aligned.options import AlignedOptions
from gdg_plugins.distance_euclidean.distance import EuclideanDistance
from gdg_plugins.fitter_adam.fitter import AdamFitter
from gdg_plugins.fitter_adam.options import AdamOptions
from gdg_plugins.generator_cvae.weights import BUNDLED as WEIGHTS
from gdg_plugins.hand_pytorch_kinematics.model import PytorchKinematicsHand
from gdg_plugins.hand_pytorch_kinematics.options import PytorchKinematicsOptions
from gdg_plugins.planner_dfc.options import DfcOptions
from gdg_plugins.planner_dfc.planner import DfcPlanner
from gdg_plugins.simulator_sapien.options import SapienOptions
from gdg_plugins.simulator_sapien.simulator import SapienSimulator
from real_hands import HANDS as REAL
from torch import Tensor

from gdg.components import KINDS, Component, NoOptions, Options
from gdg.data.contact_map import ContactMap
from gdg.errors import GdgErrors
from gdg.folders import HANDS
from gdg.hookspecs import hookimpl
from gdg.kinds.distance import HandDistance
from gdg.kinds.generator import Generator
from gdg.registry import get_registry
from gdg.testing import assert_component, assert_hand, check_component
from gdg.testing.fixtures import jaw_grasps
from gdg.testing.gripper import write_gripper

BUNDLED = tuple(name for name, found in HANDS.all().items() if found.tier == "bundled")
#: Loose enough that a few steps of eight chains give grasps.
QUICK_DFC = {
    "batch": 8, "steps": 5, "max_batches": 1, "max_distance_m": 1.0, "max_penetration_m": 1.0,
    "max_self_m": 1.0, "max_force_closure": 100.0,
}  # fmt: skip
QUICK_ADAM = {"particles": 4, "steps": 5}
QUICK_OPTIONS: dict[tuple[str, str], dict[str, Any]] = {
    ("hand-model", "pytorch-kinematics"): {"surface_points": 200},
    ("fitter", "adam"): QUICK_ADAM,
    ("planner", "dfc"): QUICK_DFC,
}
QUICK_USES: dict[tuple[str, str], dict[str, Any]] = {
    ("planner", "contact-map"): {"fitter": {"name": "adam", **QUICK_ADAM}},
}
BUILT_IN = [(c.kind, c.name) for c in get_registry().components() if c.distribution == "gdg"]


# -- what we ship --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_hands_conform(name: str):
    assert_hand(HANDS.find(name).path)


@pytest.mark.parametrize("name", REAL)
def test_real_hands_conform(real_hands: Path, name: str):
    assert_hand(real_hands / name)


def test_the_two_jaw_gripper_conforms(tmp_path: Path):
    assert_hand(write_gripper(tmp_path))


@pytest.mark.parametrize(("kind", "name"), BUILT_IN)
def test_built_in_components_conform(kind: str, name: str, tmp_path: Path):
    options = QUICK_OPTIONS.get((kind, name), {})
    if name == "cvae" and not (WEIGHTS / "default.safetensors").is_file():
        pytest.skip("no weights 'default' are bundled")
    if name == "oracle":
        hand, grasps = write_gripper(tmp_path), tmp_path / "grasps.json"
        jaw_grasps((0.0, 0.005)).save(grasps)
        options = {"grasps": str(grasps), "hand": str(hand)}
    assert_component(kind, name, uses=QUICK_USES.get((kind, name)), **options)


@pytest.mark.parametrize("preset", ["release", "paper"])
def test_presets_of_the_aligned_distance_conform(preset: str):
    assert_component("distance", "aligned", preset=preset)


# -- components that don't conform ---------------------------------------------------------------


class WrongGradient(EuclideanDistance):
    def to_hand(self, *args: Any):
        found = super().to_hand(*args)
        doubled = 2 * found.distance - found.distance.detach()
        return HandDistance(doubled, found.hand_index)


class DependsOnFrame(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        stretch = torch.tensor([1.0, 1.0, 1.5])
        return super().to_hand(
            object_points * stretch, object_normals, hand_points * stretch, *args
        )


class FarthestPoint(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        apart = torch.cdist(object_points.expand(len(hand_points), -1, -1), hand_points)
        return HandDistance(*apart.max(-1))


class IgnoresGivenPoints(EuclideanDistance):
    def to_hand(
        self, object_points: Tensor, object_normals: Tensor, hand_points: Tensor, *args: Any
    ):
        return super().to_hand(object_points, object_normals, hand_points)


class HalfContact(EuclideanDistance):
    def contact_value(self, distance: Tensor) -> Tensor:
        return super().contact_value(distance) / 2


class OtherGap(AlignedDistance):
    def aligned_gap(self, value: Tensor) -> Tensor:
        return 2 * super().aligned_gap(value)


class Raises(EuclideanDistance):
    def contact_value(self, distance: Tensor) -> Tensor:
        raise ZeroDivisionError("oh")


class OwnRandomness(Generator):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        return ContactMap(obj.name, torch.rand(count, len(obj.points)), "aligned/release")


class UnknownLabel(Generator):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        values = torch.rand(count, len(obj.points), generator=generator)
        return ContactMap(obj.name, values, "aligend/release")


class UnknownPreset(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        return replace(super().generate(obj, count, generator), distance="aligned/newest")


class OutOfRange(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        drawn = super().generate(obj, count, generator)
        return replace(drawn, values=2 * drawn.values, distance="aligned/release")


class OneMapTooMany(UnknownLabel):
    def generate(self, obj: Any, count: int, generator: torch.Generator) -> ContactMap:
        return replace(super().generate(obj, count + 1, generator), distance="aligned/release")


class OutOfLimits(AdamFitter):
    def fit(self, *args: Any, **kwargs: Any):
        fitted = super().fit(*args, **kwargs)
        return replace(fitted, joints=fitted.joints + 0.1)


class NoTotal(AdamFitter):
    def fit(self, *args: Any, **kwargs: Any):
        fitted = super().fit(*args, **kwargs)
        return replace(fitted, energies={"contact": fitted.energies["contact"]})


class OneGraspOnly(AdamFitter):
    def fit(self, *args: Any, **kwargs: Any):
        return super().fit(*args, **kwargs).select([0])


class OwnSeed(AdamFitter):
    def fit(self, hand: Any, obj: Any, maps: Any, generator: Any, progress: Any = None):
        return super().fit(hand, obj, maps, torch.default_generator, progress)


class TakesAnyMap(AdamFitter):
    def fit(self, hand: Any, obj: Any, maps: Any, generator: Any, progress: Any = None):
        same = replace(maps, distance=self.distance.label)
        return super().fit(hand, obj, same, generator, progress)


class Sheared(PytorchKinematicsHand):
    def link_poses_in_root(self, joints: Tensor) -> Tensor:
        poses = super().link_poses_in_root(joints)
        return poses * torch.tensor([1.0, 1.0, 1.1, 1.0])


class DetachedJoints(PytorchKinematicsHand):
    def link_poses_in_root(self, joints: Tensor) -> Tensor:
        poses = super().link_poses_in_root(joints)
        return poses.detach() + 0.0 * joints.sum()


class MixesTheBatch(PytorchKinematicsHand):
    def link_poses_in_root(self, joints: Tensor) -> Tensor:
        return super().link_poses_in_root(joints.mean(0, keepdim=True).expand_as(joints))


class IgnoresMimic(PytorchKinematicsHand):
    def __init__(self, *args: Any):
        super().__init__(*args)
        self._matrix = self._matrix * (self._matrix.abs().cumsum(0) <= 1)


class AlwaysPasses(SapienSimulator):
    def simulate(self, *args: Any, **kwargs: Any):
        return tuple(replace(v, success=True, failure="") for v in super().simulate(*args))


class NeverPasses(SapienSimulator):
    def simulate(self, *args: Any, **kwargs: Any):
        found = super().simulate(*args)
        return tuple(replace(v, success=False, failure="moved") for v in found)


class Backward(SapienSimulator):
    def simulate(self, *args: Any, **kwargs: Any):
        return super().simulate(*args)[::-1]


class Moody(SapienSimulator):
    runs = 0

    def simulate(self, *args: Any, **kwargs: Any):
        self.runs += 1
        off = 0.001 * self.runs
        return tuple(replace(v, displacement_m=(off,) * 6) for v in super().simulate(*args))


class OneTooMany(DfcPlanner):
    def plan(self, hand: Any, obj: Any, count: int, generator: Any, progress: Any = None):
        return super().plan(hand, obj, count + 1, generator, progress)


class WorstFirst(DfcPlanner):
    def plan(self, *args: Any, **kwargs: Any):
        planned = super().plan(*args, **kwargs)
        return planned.select(range(len(planned))[::-1])


class ForgetsTheRejected(DfcPlanner):
    def plan(self, *args: Any, **kwargs: Any):
        return replace(super().plan(*args, **kwargs), provenance={})


class Stretched(DfcPlanner):
    def plan(self, *args: Any, **kwargs: Any):
        planned = super().plan(*args, **kwargs)
        return replace(planned, poses=1.1 * planned.poses)


SABOTAGE: list[tuple[str, type, str]] = [
    ("distance", WrongGradient, "gradient along x differs from finite differences"),
    ("distance", DependsOnFrame, "depends on the frame"),
    ("distance", FarthestPoint, "not the least of the distances"),
    ("distance", IgnoresGivenPoints, "a hand_index that is given must come back"),
    ("distance", HalfContact, "the contact value at distance 0 is 0.5, not 1"),
    ("distance", OtherGap, "does not give the gap"),
    ("distance", Raises, "raised ZeroDivisionError: oh"),
    ("generator", OwnRandomness, "draw from the generator that is passed in"),
    ("generator", UnknownLabel, "Did you mean 'aligned'"),
    ("generator", UnknownPreset, "contact maps made with 'aligned/newest': preset"),
    ("generator", OutOfRange, "contact values must lie in [0, 1]"),
    ("generator", OneMapTooMany, "count=1 gave values of shape (2, 2048), not (1, 2048)"),
    ("fitter", OutOfLimits, "joint 'close' is outside its limits"),
    ("fitter", NoTotal, "energies must have 'total'"),
    ("fitter", OneGraspOnly, "2 maps gave 1 grasps"),
    ("fitter", OwnSeed, "draw from the generator passed in"),
    ("fitter", TakesAnyMap, "maps of an unknown distance must raise"),
    ("hand-model", Sheared, "link poses are not rigid"),
    ("hand-model", DetachedJoints, "gradients in the joints differ"),
    ("hand-model", MixesTheBatch, "row 0 of a batch differs from the same row alone"),
    ("hand-model", IgnoresMimic, "link 'right' is not where its joint puts it"),
    ("simulator", AlwaysPasses, "a hand one metre away must not pass"),
    ("simulator", NeverPasses, "two jaws that press on the cube's middle must hold it"),
    ("simulator", Backward, "must hold it"),
    ("simulator", Moody, "a second run moved the object by"),
    ("planner", OneTooMany, "3 grasps were asked for, 4 given"),
    ("planner", WorstFirst, "grasps must come best first"),
    ("planner", ForgetsTheRejected, "provenance['rejected'] must count"),
    ("planner", Stretched, "poses are not rigid"),
]
#: Base class -> its options model and what its instances use.
OPTIONS: dict[type, tuple[type[Options], tuple[str, ...], dict[str, Any]]] = {
    EuclideanDistance: (NoOptions, (), {}),
    AlignedDistance: (AlignedOptions, (), {}),
    Generator: (NoOptions, (), {}),
    AdamFitter: (AdamOptions, ("distance",), QUICK_ADAM),
    PytorchKinematicsHand: (PytorchKinematicsOptions, (), {"surface_points": 200}),
    SapienSimulator: (SapienOptions, (), {}),
    DfcPlanner: (DfcOptions, (), QUICK_DFC),
}


class Plugin:
    """A plugin made on the spot."""

    def __init__(self, record: Component):
        self.record = record

    @hookimpl
    def gdg_components(self) -> list[Component]:
        return [self.record]


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, type], dict[str, Any]]]:
    """Registers a class as the component ``sabotaged``, for one test; gives quick options."""
    registry = get_registry()
    monkeypatch.setattr(registry, "_components", list(registry._components))
    monkeypatch.setattr(registry, "plugins", list(registry.plugins))
    module = types.ModuleType("gdg_test_sabotage")
    monkeypatch.setitem(sys.modules, module.__name__, module)

    def add(kind: str, cls: type) -> dict[str, Any]:
        module.__dict__["Sabotaged"] = cls
        model, uses, quick = next(v for base, v in OPTIONS.items() if issubclass(cls, base))
        target = f"{module.__name__}:Sabotaged"
        record = Component(kind, "sabotaged", target, "spoilt on purpose", model, uses)
        registry.register(Plugin(record), "sabotage")
        return quick

    return add


@pytest.mark.parametrize(
    ("kind", "cls", "problem"), SABOTAGE, ids=lambda v: getattr(v, "__name__", None)
)
def test_a_sabotaged_component_is_caught(
    kind: str, cls: type, problem: str, register: Callable[[str, type], dict[str, Any]]
):
    problems = check_component(kind, "sabotaged", **register(kind, cls))
    assert any(problem in text for text in problems), problems


def test_every_kind_has_checks_and_sabotage():
    from gdg.testing.component import KITS

    assert set(KITS) == set(KINDS) == {kind for kind, _, _ in SABOTAGE}


def test_an_unknown_name_and_a_wrong_option_are_problems():
    assert "Did you mean 'aligned'" in check_component("distance", "alinged")[0]
    assert "gama: there is no such option" in check_component("distance", "aligned", gama=1)[0]


def test_the_mistakes_of_a_component_come_with_its_name(
    register: Callable[[str, type], dict[str, Any]],
):
    register("distance", HalfContact)
    with pytest.raises(GdgErrors, match="distance 'sabotaged': contact value: the contact value"):
        assert_component("distance", "sabotaged")


def test_importing_the_kit_imports_nothing_heavy():
    from test_light_imports import HEAVY, modules_after

    assert modules_after("import gdg.testing") & HEAVY == set()
