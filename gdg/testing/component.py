"""Builds a registered component and runs the checks of its kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from gdg.components import Component, config_key
from gdg.errors import GdgError, GdgErrors, raise_if_any
from gdg.pipeline.jobs import DEFAULTS
from gdg.registry import get_registry
from gdg.testing import Use, distance, fitter, generator, hand_model, planner, simulator
from gdg.testing.checks import Check, run_checks
from gdg.testing.fixtures import StandInGenerator
from gdg.validation import validated

#: Kind -> what its checks are given, made from a built component (for a hand model: from its class
#: and options), and the checks.
KITS: dict[str, tuple[Callable[[Any], Any], tuple[Check[Any, str], ...]]] = {
    "distance": (distance.DistanceCase, distance.CHECKS),
    "generator": (generator.GeneratorCase, generator.CHECKS),
    "fitter": (fitter.FitterCase, fitter.CHECKS),
    "hand-model": (hand_model.HandModelCase, hand_model.CHECKS),
    "simulator": (simulator.SimulatorCase, simulator.CHECKS),
    "planner": (planner.PlannerCase, planner.CHECKS),
}


def component_problems(
    kind: str, name: str, uses: Mapping[str, Use], options: Mapping[str, Any]
) -> list[str]:
    """See ``gdg.testing.check_component``; a component that can't be built is a problem, too."""
    try:
        case = component_case(kind, name, uses, options)
    except GdgErrors as errors:
        return list(errors.messages)
    except GdgError as error:
        return [str(error)]
    except Exception as error:  # what is tested is foreign code and may raise anything
        return [f"cannot be created: {type(error).__name__}: {error}"]
    return run_checks(KITS[kind][1], case)


def component_case(
    kind: str, name: str, uses: Mapping[str, Use], options: Mapping[str, Any]
) -> Any:
    """What the checks of a kind are given: the component, built, with all that it is tried on.

    Raises:
        GdgError: unknown kind or name, wrong options, or a missing package; building foreign code
            may raise anything else, too.
    """
    record = get_registry().find(kind, name)
    raise_if_any(list(_lax_options(record)))
    if kind == "hand-model":
        made: Any = hand_model.Maker(record.load(), _options(record, options))
    else:
        made = _Parts(uses).build(record, options)
    validated(record.options, {**options, **record.options.for_verified}, "for_verified")
    return KITS[kind][0](made)


def _lax_options(record: Component) -> Iterator[str]:
    """What an options model lets pass that the base class refuses."""
    config = record.options.model_config
    if config.get("extra") != "forbid":
        yield "the options model must refuse unknown options (extra='forbid'), or typos pass."
    if not config.get("frozen"):
        yield "the options model must be frozen: a run records what it was started with."


def _options(record: Component, given: Mapping[str, Any]) -> Any:
    return validated(record.options, given, f"{record.kind} '{record.name}'")


class _Parts:
    """Builds components with the default components that they use, each kind once."""

    def __init__(self, uses: Mapping[str, Use]):
        self._uses = uses
        self._built: dict[str, Any] = {}

    def build(self, record: Component, options: Mapping[str, Any]) -> Any:
        used = {config_key(kind): self._get(kind) for kind in record.uses}
        return record.load()(_options(record, options), **used)

    def _get(self, kind: str) -> Any:
        if kind not in self._built:
            self._built[kind] = self._make(kind)
        return self._built[kind]

    def _make(self, kind: str) -> Any:
        if kind == "generator" and kind not in self._uses:
            return StandInGenerator(self._get("distance"))
        use = self._uses.get(kind, DEFAULTS[config_key(kind)])
        tree = {"name": use} if isinstance(use, str) else dict(use)
        return self.build(get_registry().find(kind, tree.pop("name")), tree)
