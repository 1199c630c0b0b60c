"""One broken plugin never breaks the rest, and every mistake is named."""

from __future__ import annotations

import sys
import types
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib import metadata
from types import ModuleType
from typing import Any

import pytest

from gdg.components import KINDS, Component, NoOptions, Options
from gdg.errors import GdgError
from gdg.hookspecs import hookimpl, hookspec
from gdg.kinds.generator import Generator
from gdg.registry import Registry, get_registry

GOOD = Component(
    kind="generator",
    name="mine",
    target="gdg_test_targets:Mine",
    summary="a throw-away generator",
)


class Plugin:
    """A plugin made on the spot."""

    def __init__(self, *records: Any):
        self.records = records

    @hookimpl
    def gdg_components(self) -> Iterable[Any]:
        return self.records


class Mine(Generator):
    def generate(self, obj: Any, count: int, generator: Any) -> Any:
        return None


class Unfinished(Generator):
    pass


class NotAGenerator:
    pass


@pytest.fixture(autouse=True)
def targets(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("gdg_test_targets")
    for cls in (Mine, Unfinished, NotAGenerator):
        setattr(module, cls.__name__, cls)
    monkeypatch.setitem(sys.modules, module.__name__, module)


def registry_of(*records: Any, name: str = "mine-plugin") -> Registry:
    registry = Registry()
    registry.register(Plugin(*records), name)
    return registry


def failure_of(*records: Any) -> str:
    (status,) = registry_of(*records).plugins
    assert status.failure is not None
    return status.failure


def test_a_component_is_found_and_loaded():
    found = registry_of(GOOD).find("generator", "mine")
    assert found.provider == "mine-plugin"
    assert found.load() is Mine


def test_every_built_in_plugin_loads():
    assert [(p.name, p.failure) for p in get_registry().plugins if p.failure] == []


def test_every_built_in_component_implements_its_kind():
    for component in get_registry().components():
        if not component.missing_requirements():
            component.load()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"kind": "fiter"}, "unknown kind 'fiter'. Did you mean 'fitter'?"),
        ({"uses": ("distanc",)}, "uses unknown kind 'distanc'. Did you mean 'distance'?"),
        ({"target": "gdg_test_targets"}, "must be written 'module:Class'"),
        ({"target": "gdg_test_targets:"}, "must be written 'module:Class'"),
        ({"target": ":Mine"}, "must be written 'module:Class'"),
        ({"name": "a/b"}, "a name is made of"),
        ({"name": ""}, "a name is made of"),
        ({"name": "Mine"}, "a name is made of"),
        ({"name": "a,b"}, "a name is made of"),
        ({"name": "a=b"}, "a name is made of"),
        ({"options": dict}, "options must be a subclass"),
        ({"options": NoOptions()}, "options must be a subclass"),
        ({"name": 3}, "must be text"),
        ({"kind": ["generator"]}, "must be text"),
        ({"requires": "torch"}, "tuples of text"),
        ({"uses": ["distance"]}, "tuples of text"),
        ({"extra": 1}, "must be text"),
    ],
)
def test_a_mistaken_record_fails_its_plugin_with_the_reason(change: dict[str, Any], reason: str):
    assert reason in failure_of(replace(GOOD, **change))


def test_an_option_called_name_is_refused():
    class Named(Options):
        name: str = ""

    assert "no field 'name'" in failure_of(replace(GOOD, options=Named))


@pytest.mark.parametrize("record", [None, 3, "mine", {"kind": "generator"}, Component])
def test_what_is_no_record_is_named(record: Any):
    assert "which is no gdg.components.Component" in failure_of(record)


def test_the_same_component_twice_in_one_plugin_is_refused():
    assert "given twice" in failure_of(GOOD, replace(GOOD, summary="again"))


def test_one_mistaken_record_leaves_out_the_whole_plugin():
    registry = registry_of(GOOD, replace(GOOD, name="a/b"))
    assert registry.components() == []


def test_a_hook_that_raises_fails_only_its_own_plugin():
    class Raising:
        @hookimpl
        def gdg_components(self) -> Iterable[Component]:
            raise RuntimeError("out of coffee")

    registry = registry_of(GOOD)
    registry.register(Raising(), "raising")
    assert registry.plugins[1].failure == "RuntimeError: out of coffee"
    assert registry.find("generator", "mine").load() is Mine


def test_a_generator_that_raises_half_way_fails_its_plugin():
    class Lazy:
        @hookimpl
        def gdg_components(self) -> Iterable[Component]:
            yield GOOD
            raise ValueError("half way")

    registry = Registry()
    registry.register(Lazy(), "lazy")
    assert registry.plugins[0].failure == "ValueError: half way"
    assert registry.components() == []


@pytest.mark.parametrize("returned", [GOOD, 7])
def test_a_hook_that_returns_no_list_fails_its_plugin(returned: Any):
    class Single:
        @hookimpl
        def gdg_components(self) -> Any:
            return returned

    registry = Registry()
    registry.register(Single(), "single")
    assert registry.plugins[0].failure is not None


def test_a_misspelt_hook_fails_its_plugin():
    class Misspelt:
        @hookimpl
        def gdg_component(self) -> Iterable[Component]:
            return [GOOD]

    registry = Registry()
    registry.register(Misspelt(), "misspelt")
    assert "gdg_component" in (registry.plugins[0].failure or "")


def test_a_forgotten_decorator_fails_its_plugin():
    class Undecorated:
        def gdg_components(self) -> Iterable[Component]:
            return [GOOD]

    registry = Registry()
    registry.register(Undecorated(), "undecorated")
    assert "hookimpl" in (registry.plugins[0].failure or "")


def test_a_hook_with_an_unknown_argument_fails_its_plugin():
    class Curious:
        @hookimpl
        def gdg_components(self, registry: Registry) -> Iterable[Component]:
            return [GOOD]

    registry = Registry()
    registry.register(Curious(), "curious")
    assert "registry" in (registry.plugins[0].failure or "")


def test_strict_mode_raises_at_the_first_broken_plugin():
    registry = Registry(strict=True)
    with pytest.raises(GdgError, match=r"plugin 'broken' .* is broken: .*unknown kind"):
        registry.register(Plugin(replace(GOOD, kind="x")), "broken")


def test_an_unknown_name_gets_a_suggestion():
    with pytest.raises(GdgError, match=r"Unknown generator 'mien'\. Did you mean 'mine'\?"):
        registry_of(GOOD).find("generator", "mien")


def test_an_unknown_name_without_a_near_one_lists_what_is_known():
    with pytest.raises(GdgError, match="Known: mine"):
        registry_of(GOOD).find("generator", "quite-different")


def test_an_unknown_name_mentions_the_plugins_that_failed():
    registry = registry_of(replace(GOOD, name="a/b"), name="culprit")
    with pytest.raises(GdgError, match="failed to load: culprit"):
        registry.find("generator", "mine")


def test_an_unknown_kind_gets_a_suggestion():
    with pytest.raises(GdgError, match=r"'fiter'\. Did you mean 'fitter'\?"):
        Registry().find("fiter", "adam")
    with pytest.raises(GdgError, match=r"'fiter'\. Did you mean 'fitter'\?"):
        Registry().components("fiter")


def test_two_providers_are_an_error_only_when_the_bare_name_is_used():
    registry = registry_of(GOOD, name="first")
    registry.register(Plugin(replace(GOOD, target="gdg_test_targets:Unfinished")), "second")
    assert [p.failure for p in registry.plugins] == [None, None]
    assert registry.find("generator", "first/mine").target == "gdg_test_targets:Mine"
    assert registry.find("generator", "second/mine").target == "gdg_test_targets:Unfinished"
    with pytest.raises(GdgError, match="write 'first/mine' or 'second/mine'"):
        registry.find("generator", "mine")


def test_a_wrong_provider_gets_a_suggestion():
    with pytest.raises(GdgError, match=r"Did you mean 'mine-plugin/mine'\?"):
        registry_of(GOOD).find("generator", "mine-plugn/mine")


def test_two_plugins_of_one_name_could_not_be_told_apart_so_the_second_fails():
    registry = registry_of(GOOD, name="same")
    registry.register(Plugin(replace(GOOD, name="other")), "same")
    assert "already" in (registry.plugins[1].failure or "")
    assert registry.find("generator", "mine")


def test_the_same_name_in_two_kinds_is_no_conflict():
    registry = registry_of(GOOD, replace(GOOD, kind="planner"))
    assert registry.plugins[0].failure is None


def test_missing_packages_are_named_with_the_pip_command_only_on_use():
    record = replace(GOOD, requires=("torch", "no_such_a", "no_such_b.part"), extra="fast")
    registry = registry_of(record)
    assert registry.plugins[0].failure is None
    found = registry.find("generator", "mine")
    assert found.missing_requirements() == ("no_such_a", "no_such_b.part")
    with pytest.raises(GdgError, match=r"'no_such_a' and 'no_such_b\.part'") as caught:
        replace(found, distribution="acme-grasp").load()
    assert "pip install 'acme-grasp[fast]'" in str(caught.value)


def test_without_an_extra_every_missing_package_is_in_the_pip_command():
    record = replace(GOOD, requires=("no_such_a", "no_such_b"))
    with pytest.raises(GdgError, match="pip install no_such_a no_such_b"):
        record.load()


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ("no_such_module:Mine", "No module named 'no_such_module'"),
        ("gdg_test_targets:Nobody", "Nobody"),
        ("gdg_test_targets:NotAGenerator", "does not extend gdg.kinds.generator.Generator"),
        ("gdg_test_targets:__name__", "does not extend"),
        ("gdg_test_targets:Unfinished", "does not implement generate"),
    ],
)
def test_a_bad_target_is_explained_on_use(target: str, reason: str):
    found = registry_of(replace(GOOD, target=target)).find("generator", "mine")
    with pytest.raises(GdgError, match=reason):
        found.load()


def test_a_target_module_that_raises_is_explained_on_use(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any
):
    (tmp_path / "gdg_test_explodes.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(GdgError, match=r"generator 'mine'.*ZeroDivisionError"):
        replace(GOOD, target="gdg_test_explodes:Mine").load()


@dataclass
class FakeDistribution:
    name: str
    version: str


def entry_point(name: str, load: Callable[[], Any]) -> Any:
    point = types.SimpleNamespace(name=name, load=load)
    point.dist = FakeDistribution("acme-grasp", "1.2")
    return point


def raising(error: BaseException) -> Callable[[], Any]:
    def load() -> ModuleType:
        raise error

    return load


@pytest.mark.parametrize(
    "error",
    [
        ImportError("no torch"),
        SyntaxError("oops"),
        RuntimeError("cuda"),
        SystemExit(3),
        KeyError(1),
    ],
)
def test_a_plugin_that_cannot_be_imported_is_listed_as_failed(
    monkeypatch: pytest.MonkeyPatch, error: BaseException
):
    points = [entry_point("good", lambda: Plugin(GOOD)), entry_point("bad", raising(error))]
    monkeypatch.setattr(metadata, "entry_points", lambda group: points)
    registry = Registry.from_entry_points()
    bad, good = registry.plugins
    assert (bad.name, bad.distribution, bad.version) == ("bad", "acme-grasp", "1.2")
    assert f"import failed: {type(error).__name__}" in (bad.failure or "")
    assert good.failure is None
    assert registry.find("generator", "mine").version == "1.2"


def test_an_interrupted_import_is_not_swallowed(monkeypatch: pytest.MonkeyPatch):
    points = [entry_point("slow", raising(KeyboardInterrupt()))]
    monkeypatch.setattr(metadata, "entry_points", lambda group: points)
    with pytest.raises(KeyboardInterrupt):
        Registry.from_entry_points()


def test_components_are_sorted_whatever_the_order_of_registration():
    a, b = replace(GOOD, name="a"), replace(GOOD, name="b", kind="hand-model")
    assert registry_of(a, b).components() == registry_of(b, a).components()


def test_a_plugin_need_not_provide_components():
    assert registry_of().plugins[0].failure is None


def test_every_kind_names_an_abstract_class():
    for kind in KINDS:
        with pytest.raises(GdgError, match="does not extend"):
            replace(GOOD, kind=kind, target="gdg_test_targets:NotAGenerator").load()


def test_hookspec_marker_is_public_for_other_packages():
    assert hookspec.project_name == hookimpl.project_name == "gdg"
