"""Builds component instances from a config, handing each the components that it uses."""

from __future__ import annotations

from typing import Any

from gdg.components import config_key
from gdg.config import ComponentChoice
from gdg.errors import GdgError


class Assembler:
    """Creates each configured component once, on first use, with what it uses.

    Args:
        choices: config key of a kind -> choice (``RunConfig.components``).
    """

    def __init__(self, choices: dict[str, ComponentChoice]):
        self._choices = choices
        self._built: dict[str, Any] = {}

    def get(self, kind: str) -> Any:
        """The instance for a kind, e.g. ``get("fitter")``.

        Raises:
            GdgError: a component uses a kind that is not configured here, or, through others,
                itself.
        """
        return self._get(kind, ())

    def _get(self, kind: str, users: tuple[str, ...]) -> Any:
        key = config_key(kind)
        if key in self._built:
            return self._built[key]
        if kind in users:
            raise GdgError(f"components use each other in a circle: {' → '.join((*users, kind))}.")
        if key not in self._choices:
            by = f", which {users[-1]} uses," if users else ""
            raise GdgError(f"a {kind}{by} is not part of this command's configuration.")
        choice = self._choices[key]
        used = {config_key(k): self._get(k, (*users, kind)) for k in choice.record.uses}
        self._built[key] = choice.record.load()(choice.options, **used)
        return self._built[key]
