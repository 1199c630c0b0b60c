"""Stability protocols: named, versioned YAML presets that any simulator runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field, model_validator

from gdg.errors import GdgError, did_you_mean
from gdg.protocols.sections import (
    SIX,
    Body,
    Direction,
    DriveGains,
    Lift,
    NotNegative,
    Positive,
    Pushes,
    Refinement,
    Section,
    Shifts,
    Start,
    Success,
)
from gdg.validation import validated
from gdg.yaml_files import read_yaml_mapping

__all__ = [
    "FOLDER", "SIX", "Body", "Direction", "DriveGains", "Lift", "Protocol", "Pushes", "Refinement",
    "Shifts", "Start", "Success", "load_protocol", "protocol_names",
]  # fmt: skip

FOLDER = Path(__file__).parent


class Protocol(Section):
    """One stability test, as data.

    Attributes:
        name: what users type.
        version: raised whenever a figure changes, since verdicts then can't be compared.
        source: the paper or release that the figures come from.
        timestep_ms: simulation step, milliseconds.
        friction: Coulomb coefficient of every contact, static and dynamic.
        torsional_friction: largest torque about a contact's normal over its normal force, metres.
            An engine without it leaves it out and says so in its verdicts.
        drive: gains of all joints; None: those of the hand.
        shared_motors: whether an actuated joint and those that mimic it, which one motor turns,
            share its force limit (``gdg.simulation.bodies.motor_share``); if not, each has its
            own, as in simulators of the literature.
        pushes: None: no push, only a lift.
        lift: what follows the pushes; None: nothing.
        deviations: where we differ from the source, in one sentence each.
    """

    LATER: ClassVar[frozenset[str]] = frozenset({"torsional_friction", "shared_motors", "lift"})

    name: str
    version: Annotated[int, Field(gt=0)]
    source: str
    timestep_ms: Positive
    friction: NotNegative
    torsional_friction: NotNegative = 0.0
    body: Body
    drive: DriveGains | None
    shared_motors: bool = False
    start: Start = Start()
    refinement: Refinement = Refinement()
    pushes: Pushes | None = None
    lift: Lift | None = None
    success: Success
    shifts: Shifts = Shifts()
    deviations: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _loads_the_grasp(self) -> Protocol:
        if self.pushes is None and self.lift is None:
            raise ValueError("give pushes, lift or both: without a load every grasp holds")
        if self.pushes is not None and self.needs_table:
            raise ValueError("an object on a table can't be pushed six ways; leave pushes out")
        return self

    @model_validator(mode="after")
    def _judges_pushes_that_it_has(self) -> Protocol:
        if self.pushes is None and self.success.share < 1:
            raise ValueError("success.share is one of pushes, and there are none; leave it out")
        in_a_row = self.pushes is not None and self.pushes.order == "sequential"
        if self.success.measured == "total" and not in_a_row:
            raise ValueError(
                "success.measured: total needs pushes one after another (pushes.order: "
                "sequential); write measured: per-push"
            )
        return self

    @property
    def label(self) -> str:
        """``name-vVERSION``, as it is written beside every figure."""
        return f"{self.name}-v{self.version}"

    @property
    def needs_table(self) -> bool:
        """Whether the object rests on a table until the hand lifts it."""
        return self.lift is not None and self.lift.support == "table"


def protocol_names() -> list[str]:
    """Names of the bundled presets."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def load_protocol(name: str) -> Protocol:
    """A bundled preset by name, or the protocol in a YAML file by path.

    Raises:
        GdgError: unknown name (with a suggestion), unreadable file, or a broken schema.
    """
    path = FOLDER / f"{name}.yaml"
    if name not in protocol_names():
        path = Path(os.path.expanduser(name))
        if path.suffix not in (".yaml", ".yml") or not path.is_file():
            raise GdgError(f"Unknown protocol '{name}'.{did_you_mean(name, protocol_names())}")
    return validated(Protocol, read_yaml_mapping(path), str(path))
