"""What we ship conforms, and the conformance kit catches what doesn't."""

from __future__ import annotations

import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from gdg_plugins.distance_euclidean.distance import EuclideanDistance
from gdg_plugins.generator_cvae.weights import BUNDLED as WEIGHTS
from pydantic import ConfigDict
from real_hands import HANDS as REAL
from sabotage import OPTIONS, QUICK_ADAM, QUICK_DFC, SABOTAGE, HalfContact

from gdg.components import KINDS, Component, Options
from gdg.errors import GdgErrors
from gdg.folders import HANDS
from gdg.hookspecs import hookimpl
from gdg.registry import get_registry
from gdg.testing import assert_component, assert_hand, check_component
from gdg.testing.fixtures import jaw_grasps
from gdg.testing.gripper import write_gripper

BUNDLED = tuple(name for name, found in HANDS.all().items() if found.tier == "bundled")
QUICK_OPTIONS: dict[tuple[str, str], dict[str, Any]] = {
    ("hand-model", "pytorch-kinematics"): {"surface_points": 200},
    ("fitter", "adam"): QUICK_ADAM,
    ("fitter", "halving"): QUICK_ADAM,
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
    weights = WEIGHTS.parents[1] / f"generator_{name}" / "weights" / "full.safetensors"
    if name in ("cvae", "flow") and not weights.is_file():
        pytest.skip("no weights 'full' are bundled")
    if name in ("graspcvae", "unigrasp"):
        pytest.skip("weights are for one hand: tests/plugins trains the gripper's and checks")
    if name == "oracle":
        hand, grasps = write_gripper(tmp_path), tmp_path / "grasps.json"
        jaw_grasps((0.0, 0.005)).save(grasps)
        options = {"grasps": str(grasps), "hand": str(hand)}
    assert_component(kind, name, uses=QUICK_USES.get((kind, name)), **options)


@pytest.mark.parametrize("preset", ["release", "paper"])
def test_presets_of_the_aligned_distance_conform(preset: str):
    assert_component("distance", "aligned", preset=preset)


# -- components that don't conform ---------------------------------------------------------------


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
        bases = reversed(OPTIONS)  # those of one test come last
        model, uses, quick = next(OPTIONS[base] for base in bases if issubclass(cls, base))
        target = f"{module.__name__}:Sabotaged"
        record = Component(kind, "sabotaged", target, "spoilt on purpose", model, uses)
        registry.register(Plugin(record), "sabotage")
        return quick

    return add


@pytest.mark.parametrize(
    ("kind", "cls", "check", "problem"), SABOTAGE, ids=[cls.__name__ for _, cls, _, _ in SABOTAGE]
)
def test_a_sabotaged_component_is_caught(
    kind: str, cls: type, check: str, problem: str, register: Callable[[str, type], dict[str, Any]]
):
    problems = check_component(kind, "sabotaged", **register(kind, cls))
    assert any(text.startswith(check) and problem in text for text in problems), problems


def test_every_check_of_every_kind_has_sabotage():
    from gdg.testing.checks import check_name
    from gdg.testing.component import KITS

    assert set(KITS) == set(KINDS)
    tripped = {(kind, check) for kind, _, check, _ in SABOTAGE}
    assert tripped == {(kind, check_name(c)) for kind, (_, checks) in KITS.items() for c in checks}


class LaxOptions(Options):
    model_config = ConfigDict(extra="allow", frozen=False)


class MistypedOptions(Options):
    for_verified = MappingProxyType({"trails": "decisive"})
    trials: str = "all"


@pytest.mark.parametrize(
    ("options", "sentences"),
    [
        (LaxOptions, ("must refuse unknown options", "must be frozen")),
        (
            MistypedOptions,
            ("for_verified: trails: there is no such option. Did you mean 'trials'",),
        ),
    ],
)
def test_bad_options_models_are_caught(
    options: type[Options],
    sentences: tuple[str, ...],
    register: Callable[[str, type], dict[str, Any]],
):
    class Lax(EuclideanDistance):
        pass

    OPTIONS[Lax] = (options, (), {})
    try:
        register("distance", Lax)
    finally:
        del OPTIONS[Lax]
    problems = check_component("distance", "sabotaged")
    for problem, sentence in zip(problems, sentences, strict=True):
        assert sentence in problem


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
