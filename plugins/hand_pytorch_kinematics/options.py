"""Options of the pytorch-kinematics hand model."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.components import Options


class PytorchKinematicsOptions(Options):
    """Options of ``PytorchKinematicsHand``.

    Attributes:
        surface_points: points on the hand's surface (the release has 1077 to 1663).
    """

    surface_points: Annotated[int, Field(ge=16, le=20_000)] = 1600
