"""Options of the SAPIEN simulator."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.simulation.options import SimulatorOptions


class SapienOptions(SimulatorOptions):
    """Options of ``SapienSimulator``, beside those of all simulators.

    Attributes:
        position_iterations: the solver's position iterations per step.
        velocity_iterations: the solver's velocity iterations per step.
        contact_offset_m: PhysX makes contacts between shapes nearer than the sum of their
            offsets; this is the offset of each, metres.
    """

    position_iterations: Annotated[int, Field(ge=1, le=255)] = 20
    velocity_iterations: Annotated[int, Field(ge=0, le=255)] = 1
    contact_offset_m: Annotated[float, Field(gt=0, le=0.02)] = 0.002
