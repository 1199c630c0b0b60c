"""Options of the oracle generator."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.components import Options


class OracleOptions(Options):
    """Options of ``OracleGenerator``.

    Attributes:
        grasps: path of the ``grasps.json`` whose maps are given.
        hand: name or folder of the hand of those grasps; empty for the name in the file.
        hand_model: hand-model component that places the hand.
    """

    grasps: Annotated[str, Field(min_length=1)]
    hand: str = ""
    hand_model: Annotated[str, Field(min_length=1)] = "pytorch-kinematics"
