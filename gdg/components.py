"""What a plugin tells the registry about a component, without importing it."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from gdg.errors import GdgError

#: Kind of component -> the abstract class that its implementations extend.
KINDS: dict[str, str] = {
    "hand-model": "gdg.kinds.hand_model:HandModel",
    "distance": "gdg.kinds.distance:Distance",
    "generator": "gdg.kinds.generator:Generator",
    "fitter": "gdg.kinds.fitter:Fitter",
    "simulator": "gdg.kinds.simulator:Simulator",
    "planner": "gdg.kinds.planner:Planner",
}


def config_key(kind: str) -> str:
    """The key of a kind in a config: ``hand-model`` is written ``hand_model``."""
    return kind.replace("-", "_")


class Options(BaseModel):
    """Base of every component's options: frozen, typed, finite, unknown fields refused.

    Attributes:
        one_by_one: of a simulator: whether it tests one grasp after the other anyway, so that
            several processes may share them.
        for_verified: what ``gdg grasp verified=true`` sets where no word or file does.
    """

    one_by_one: ClassVar[bool] = False
    for_verified: ClassVar[Mapping[str, Any]] = MappingProxyType({})

    model_config = ConfigDict(
        extra="forbid", frozen=True, validate_default=True, allow_inf_nan=False
    )


class NoOptions(Options):
    """For components that have nothing to set."""


@dataclass(frozen=True)
class Component:
    """A component's record: enough to list, configure and check it without importing it.

    Attributes:
        kind: one of ``KINDS``.
        name: lower-case with hyphens; unique per kind and provider.
        target: ``"module:Class"``, imported on first use.
        summary: one line for ``gdg plugins``.
        options: pydantic model of the component's options.
        uses: kinds of the components handed to the class as keyword arguments, by config key
            (a planner that uses a fitter gets ``fitter=...``).
        requires: import names that must be installed, checked on use.
        extra: pip extra of ``distribution`` that installs them.
    """

    kind: str
    name: str
    target: str
    summary: str
    options: type[Options] = NoOptions
    uses: tuple[str, ...] = ()
    requires: tuple[str, ...] = ()
    extra: str | None = None
    #: Filled in by the registry: which plugin and distribution the record came from.
    provider: str = field(default="", compare=False)
    distribution: str = field(default="", compare=False)
    version: str = field(default="", compare=False)

    def missing_requirements(self) -> tuple[str, ...]:
        """Import names in ``requires`` that are not installed; imports no top-level package."""
        return tuple(name for name in self.requires if not _is_installed(name))

    def load(self) -> type:
        """Imports and returns the component's class.

        Raises:
            GdgError: an optional package is missing (with the pip command that installs it),
                the target cannot be imported, or it does not implement the kind's interface.
        """
        missing = self.missing_requirements()
        if missing:
            names = " and ".join(f"'{name}'" for name in missing)
            packages = [f"{self.distribution or 'gdg'}[{self.extra}]"] if self.extra else missing
            raise GdgError(
                f"{self.kind} '{self.name}' needs {names}, not installed here: "
                f"pip install {' '.join(shlex.quote(package) for package in packages)}"
            )
        cls = self._import_target(self.target)
        interface = self._import_target(KINDS[self.kind])
        if not (isinstance(cls, type) and issubclass(cls, interface)):
            raise GdgError(
                f"{self.kind} '{self.name}' of plugin '{self.provider}': {self.target} does not "
                f"extend {interface.__module__}.{interface.__name__}."
            )
        if inspect.isabstract(cls):
            raise GdgError(
                f"{self.kind} '{self.name}' of plugin '{self.provider}': {self.target} does not "
                f"implement {', '.join(sorted(cls.__abstractmethods__))}."
            )
        return cls

    def _import_target(self, target: str) -> type:
        module_name, _, attribute = target.partition(":")
        try:
            return getattr(importlib.import_module(module_name), attribute)
        except Exception as error:  # loads a plugin: its module may raise anything
            raise GdgError(
                f"{self.kind} '{self.name}' of plugin '{self.provider}': cannot import "
                f"'{target}': {type(error).__name__}: {error}"
            ) from error


def _is_installed(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except (ModuleNotFoundError, ValueError):  # no parent package; a module without a spec
        return name in sys.modules
