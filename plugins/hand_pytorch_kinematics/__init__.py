"""Hand model on pytorch-kinematics."""

from __future__ import annotations

from gdg.components import Component
from gdg.hookspecs import hookimpl

from .options import PytorchKinematicsOptions


@hookimpl
def gdg_components() -> list[Component]:
    """The record of this plugin."""
    return [
        Component(
            kind="hand-model",
            name="pytorch-kinematics",
            target="gdg_plugins.hand_pytorch_kinematics.model:PytorchKinematicsHand",
            summary="batched differentiable kinematics by pytorch-kinematics",
            options=PytorchKinematicsOptions,
            requires=("pytorch_kinematics",),
        )
    ]
