"""Finds plugins through entry points and looks their components up by name."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib import metadata
from typing import Any

import pluggy

from gdg import hookspecs
from gdg.components import KINDS, Component, Options
from gdg.errors import GdgError, did_you_mean

ENTRY_POINT_GROUP = "gdg"
#: Set to 1 (CI does) to raise on a broken plugin instead of listing it as FAILED.
STRICT_VARIABLE = "GDG_STRICT_PLUGINS"


#: What a component may be called: no "/" (it divides provider and name), "," or "=" (overrides).
NAME = re.compile(r"[a-z0-9]+([.-][a-z0-9]+)*")


@dataclass(frozen=True)
class PluginStatus:
    """What became of one plugin at start-up.

    Attributes:
        name: the entry point's name.
        distribution: the pip distribution that brought it, and its version.
        version: the version of that distribution.
        failure: the reason for which it was left out, or None if it works.
    """

    name: str
    distribution: str
    version: str
    failure: str | None = None


class Registry:
    """The components known to this process.

    One broken plugin never breaks the rest: it is recorded in ``plugins`` with its reason.

    Args:
        strict: raise at the first broken plugin instead.
    """

    def __init__(self, *, strict: bool = False):
        self.strict = strict
        self.plugins: list[PluginStatus] = []
        self._components: list[Component] = []

    @classmethod
    def from_entry_points(cls, *, strict: bool = False) -> Registry:
        """Loads every plugin of the entry-point group ``gdg``."""
        registry = cls(strict=strict)
        for entry_point in sorted(
            metadata.entry_points(group=ENTRY_POINT_GROUP), key=lambda point: point.name
        ):
            registry._add_entry_point(entry_point)
        return registry

    def _add_entry_point(self, entry_point: metadata.EntryPoint) -> None:
        dist = entry_point.dist
        status = PluginStatus(
            entry_point.name, dist.name if dist else "?", dist.version if dist else "?"
        )
        try:
            plugin = entry_point.load()
        except (Exception, SystemExit) as error:  # the plugin loader may catch all
            self._fail(status, f"import failed: {type(error).__name__}: {error}")
            return
        self._add(plugin, status)

    def register(self, plugin: Any, name: str) -> None:
        """Adds a plugin object (a module or an instance with hook implementations)."""
        self._add(plugin, PluginStatus(name, "(registered in process)", "0"))

    def _add(self, plugin: Any, status: PluginStatus) -> None:
        manager = pluggy.PluginManager(hookspecs.PROJECT)
        manager.add_hookspecs(hookspecs)
        try:
            manager.register(plugin, name=status.name)
            manager.check_pending()
            records = [record for batch in manager.hook.gdg_components() for record in batch]
        except (Exception, SystemExit) as error:  # the plugin loader may catch all
            self._fail(status, f"{type(error).__name__}: {error}")
            return
        mistakes = list(_mistakes_in(records))
        if not manager.get_hookcallers(plugin):
            mistakes.append("it implements no hook: decorate one with gdg.hookspecs.hookimpl.")
        other = next((p for p in self.plugins if p.name == status.name and not p.failure), None)
        if other is not None:
            mistakes.append(f"a plugin of that name came from '{other.distribution}' already.")
        if mistakes:
            self._fail(status, " ".join(mistakes))
            return
        self.plugins.append(status)
        for record in records:
            self._components.append(
                replace(
                    record,
                    provider=status.name,
                    distribution=status.distribution,
                    version=status.version,
                )
            )

    def _fail(self, status: PluginStatus, reason: str) -> None:
        failed = replace(status, failure=reason)
        if self.strict:
            raise GdgError(f"plugin '{status.name}' ({status.distribution}) is broken: {reason}")
        self.plugins.append(failed)

    def components(self, kind: str | None = None) -> list[Component]:
        """All records, or those of one kind, sorted by kind, name and provider."""
        if kind is not None:
            _check_kind(kind)
        chosen = [c for c in self._components if kind in (None, c.kind)]
        return sorted(chosen, key=lambda c: (list(KINDS).index(c.kind), c.name, c.provider))

    def find(self, kind: str, name: str) -> Component:
        """The record of ``name``, or of ``provider/name`` where two plugins share a name.

        Raises:
            GdgError: unknown kind, unknown name (with a suggestion), or a bare name that two
                plugins provide.
        """
        known = self.components(kind)
        provider, _, bare = name.rpartition("/")
        found = [c for c in known if c.name == bare and provider in ("", c.provider)]
        if len(found) == 1:
            return found[0]
        if found:
            choices = " or ".join(f"'{c.provider}/{c.name}'" for c in found)
            raise GdgError(f"{kind} '{name}' is provided by several plugins: write {choices}.")
        names = [c.name for c in known] + [f"{c.provider}/{c.name}" for c in known if provider]
        failed = [p.name for p in self.plugins if p.failure]
        note = f" (Plugins that failed to load: {', '.join(failed)}.)" if failed else ""
        raise GdgError(f"Unknown {kind} '{name}'.{did_you_mean(name, names)}{note}")


def _mistakes_in(records: Iterable[Component]) -> Iterable[str]:
    seen: set[tuple[str, str]] = set()
    for record in records:
        if not isinstance(record, Component):
            yield f"gdg_components() returned {record!r}, which is no gdg.components.Component."
        elif not _has_right_types(record):
            yield (
                f"component {record.name!r}: kind, name, target and summary must be text, uses and "
                f"requires tuples of text, extra text or None."
            )
        else:
            yield from (f"component '{record.name}': {text}" for text in _mistakes_of(record))
            if (record.kind, record.name) in seen:
                yield f"component '{record.name}': given twice by one plugin."
            seen.add((record.kind, record.name))


def _has_right_types(record: Component) -> bool:
    texts = [record.kind, record.name, record.target, record.summary, record.extra or ""]
    lists = [record.uses, record.requires]
    return all(isinstance(value, tuple) for value in lists) and all(
        isinstance(text, str) for text in [*texts, *record.uses, *record.requires]
    )


def _mistakes_of(record: Component) -> Iterable[str]:
    for what, kind in [("", record.kind), *(("uses ", kind) for kind in record.uses)]:
        if kind not in KINDS:
            yield f"{what}unknown kind '{kind}'.{did_you_mean(kind, KINDS)}"
    module, _, attribute = record.target.partition(":")
    if not module or not attribute:
        yield f"target '{record.target}' must be written 'module:Class'."
    if not NAME.fullmatch(record.name):
        yield "a name is made of lower-case letters, digits, dots and hyphens."
    if not (isinstance(record.options, type) and issubclass(record.options, Options)):
        yield "options must be a subclass of gdg.components.Options."
    elif "name" in record.options.model_fields:
        yield "options may have no field 'name', which chooses the component."


def _check_kind(kind: str) -> None:
    if kind not in KINDS:
        raise GdgError(f"Unknown kind of component '{kind}'.{did_you_mean(kind, KINDS)}")


@functools.cache
def get_registry() -> Registry:
    """The process-wide registry, loaded from entry points at the first call."""
    return Registry.from_entry_points(strict=os.environ.get(STRICT_VARIABLE) == "1")
