"""Components get the components that they use, each built once."""

from __future__ import annotations

import sys
import types
from typing import Any

import pytest

from gdg.assemble import Assembler
from gdg.components import Component, NoOptions
from gdg.config import ComponentChoice
from gdg.errors import GdgError
from gdg.kinds.distance import Distance
from gdg.kinds.fitter import Fitter
from gdg.kinds.generator import Generator


def _concrete(interface: type) -> type:
    methods = dict.fromkeys(interface.__abstractmethods__, lambda *args: None)

    def init(self: Any, options: Any, **used: Any) -> None:
        self.options, self.used = options, used

    return type(f"My{interface.__name__}", (interface,), {**methods, "__init__": init})


@pytest.fixture(autouse=True)
def targets(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("gdg_test_parts")
    for interface in (Distance, Fitter, Generator):
        setattr(module, interface.__name__, _concrete(interface))
    monkeypatch.setitem(sys.modules, module.__name__, module)


def choice(kind: str, *uses: str) -> ComponentChoice:
    target = f"gdg_test_parts:{kind.capitalize()}"
    record = Component(kind=kind, name="mine", target=target, summary="", uses=uses)
    return ComponentChoice(record=record, options=NoOptions())


def test_a_component_gets_what_it_uses_and_each_is_built_once():
    parts = Assembler(
        {
            "fitter": choice("fitter", "distance"),
            "generator": choice("generator", "distance", "fitter"),
            "distance": choice("distance"),
        }
    )
    generator = parts.get("generator")
    assert generator.used["distance"] is parts.get("distance")
    assert generator.used["fitter"] is parts.get("fitter")
    assert parts.get("fitter").used == {"distance": parts.get("distance")}


def test_a_circle_is_explained():
    parts = Assembler(
        {"fitter": choice("fitter", "distance"), "distance": choice("distance", "fitter")}
    )
    with pytest.raises(GdgError, match="circle: fitter → distance → fitter"):
        parts.get("fitter")


def test_a_used_kind_that_the_command_does_not_configure_is_named_with_its_user():
    with pytest.raises(GdgError, match="a distance, which fitter uses, is not part"):
        Assembler({"fitter": choice("fitter", "distance")}).get("fitter")
