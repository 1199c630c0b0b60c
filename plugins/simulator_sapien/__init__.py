"""Simulator on SAPIEN (PhysX on the CPU)."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import SapienOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="simulator",
            name="sapien",
            target="gdg_plugins.simulator_sapien.simulator:SapienSimulator",
            summary="PhysX on the CPU, through SAPIEN",
            options=SapienOptions,
            requires=("sapien",),
        )
    ]
