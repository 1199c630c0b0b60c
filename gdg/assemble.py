"""Builds component instances from a config, handing each the components that it uses."""

from __future__ import annotations

from typing import Any

from gdg.components import config_key
from gdg.config import ComponentChoice


class Assembler:
    """Creates each configured component once, on first use, with what it uses.

    Args:
        choices: config key of a kind -> choice (``RunConfig.components``).
    """

    def __init__(self, choices: dict[str, ComponentChoice]):
        self._choices = choices
        self._built: dict[str, Any] = {}

    def get(self, kind: str) -> Any:
        """The instance for a kind, e.g. ``get("fitter")``."""
        key = config_key(kind)
        if key not in self._built:
            choice = self._choices[key]
            used = {config_key(other): self.get(other) for other in choice.record.uses}
            self._built[key] = choice.record.load()(choice.options, **used)
        return self._built[key]
