"""Planner by differentiable force closure and annealed MALA."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import DfcOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="planner",
            name="dfc",
            target="gdg_plugins.planner_dfc.planner:DfcPlanner",
            summary="grasp synthesis by differentiable force closure and MALA",
            options=DfcOptions,
        )
    ]
