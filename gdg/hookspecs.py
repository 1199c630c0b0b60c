"""The hooks that a gdg plugin may implement."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from gdg.components import Component

PROJECT = "gdg"

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def gdg_components() -> Iterable[Component]:  # type: ignore[empty-body]
    """Return the records of the components that this plugin provides.

    Called once, at start-up, for every command: the module that implements it must import
    neither torch nor any other heavy library. The classes themselves are named lazily, as
    ``"module:Class"``, and imported on first use.
    """
