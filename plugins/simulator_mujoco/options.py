"""Options of the MuJoCo simulator."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gdg.simulation.options import SimulatorOptions


class MujocoOptions(SimulatorOptions):
    """Options of ``MujocoSimulator``, beside those of all simulators.

    Attributes:
        max_timestep_ms: a step of the protocol is divided into as few equal steps of the engine as
            make them no longer than this, milliseconds.
        contact_time_ms: the overlap of a contact decays with this time constant, critically damped
            (``solref``), milliseconds; at least as long as a step of the engine.
        impedance: d of MuJoCo's contact model (``solimp``), the same at every overlap: the share
            of a contact's acceleration that its constraint decides. The rest yields: contacts are
            the softer, and friction creeps the more, the larger 1 - d.
        impratio: how much stiffer friction is than the normal direction.
    """

    max_timestep_ms: Annotated[float, Field(ge=0.1, le=20)] = 5.0
    contact_time_ms: Annotated[float, Field(gt=0, le=1000)] = 10.0
    impedance: Annotated[float, Field(gt=0, le=0.9999)] = 0.999
    impratio: Annotated[float, Field(ge=1, le=1000)] = 10.0
