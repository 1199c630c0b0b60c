"""Simulator on MuJoCo."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import MujocoOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="simulator",
            name="mujoco",
            target="gdg_plugins.simulator_mujoco.simulator:MujocoSimulator",
            summary="MuJoCo on the CPU, a second opinion on every verdict",
            options=MujocoOptions,
            requires=("mujoco",),
            extra="mujoco",
        )
    ]
