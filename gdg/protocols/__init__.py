"""Stability protocols: named, versioned YAML presets that any simulator runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from gdg.errors import GdgError, did_you_mean
from gdg.validation import validated
from gdg.yaml_files import read_yaml_mapping

FOLDER = Path(__file__).parent
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Start(_Section):
    """How a grasp starts, and how much overlap and drift may remain.

    Attributes:
        mode: ``as-fitted``, or ``backed-out``: joints are opened until no hand point lies
            deeper than ``clearance_m`` in the object, and then closed by the drives.
        clearance_m: allowed overlap after backing out, metres.
        settle_steps: steps without any push before the first one.
        max_penetration_m: more overlap than this after settling fails the grasp; None: any.
        max_drift_m: more object motion than this while settling fails it; None: any.
        max_depenetration_velocity: solver's limit, m/s.
    """

    mode: Literal["as-fitted", "backed-out"] = "as-fitted"
    clearance_m: NotNegative = 0.0005
    settle_steps: Annotated[int, Field(ge=0)] = 0
    max_penetration_m: Positive | None = None
    max_drift_m: Positive | None = None
    max_depenetration_velocity: Positive = 3.0


class Refinement(_Section):
    """The contact-aware refinement that gives the drives a target inside the object.

    Attributes:
        step: ``none``; ``gradient``: one step down the gradient (paper); ``sign``: every joint
            that moves a contact moves equally (the release's single Adam step).
        size: how far the joint that moves most moves, rad (m for prismatic joints).
        reach_m: hand points nearer to the object than this are moved, metres.
        depth_m: how far inside the surface their targets lie, metres.
    """

    step: Literal["none", "gradient", "sign"] = "none"
    size: NotNegative = 0.0
    reach_m: Positive = 0.005
    depth_m: NotNegative = 0.005


class Pushes(_Section):
    """Six pushes along ±x, ±y, ±z of the world (= object) frame.

    Attributes:
        acceleration: force = acceleration × object mass, m/s².
        steps: steps per push.
        order: ``sequential``: each starts where the last ended; ``reset``: each starts from the
            settled state.
    """

    acceleration: Positive
    steps: Annotated[int, Field(gt=0)]
    order: Literal["sequential", "reset"] = "sequential"


class Body(_Section):
    """The object's physics: density in kg/m³, damping in 1/s."""

    density: Positive
    linear_damping: NotNegative = 0.0
    angular_damping: NotNegative = 0.0


class DriveGains(_Section):
    """Position-drive gains of every joint: N m/rad and N m s/rad."""

    stiffness: Positive
    damping: NotNegative


class Success(_Section):
    """When a grasp passes.

    Attributes:
        max_displacement_m: of the object's centre of mass, metres.
        measured: ``per-push``: against the pose at the start of that push; ``total``: against
            the pose before the first push, judged after the last.
        max_rotation_rad: against the same reference; None: any.
        contact: whether hand and object must still touch after every push.
    """

    max_displacement_m: Positive
    measured: Literal["per-push", "total"]
    max_rotation_rad: Positive | None = None
    contact: bool = False


class Shifts(_Section):
    """Trials with the hand moved a little, since one verdict of a touching grasp is noisy.

    Attributes:
        count: number of shifted trials beside the unshifted one.
        distance_m: length of each shift, metres; directions follow a fixed pattern.
    """

    count: Annotated[int, Field(ge=0)] = 0
    distance_m: NotNegative = 0.0002


class Protocol(_Section):
    """One stability test, as data.

    Attributes:
        name: what users type.
        version: raised whenever a figure changes, since verdicts then can't be compared.
        source: the paper or release that the figures come from.
        timestep_ms: simulation step, milliseconds.
        friction: Coulomb coefficient of every contact, static and dynamic.
        deviations: where we differ from the source, in one sentence each.
    """

    name: str
    version: Annotated[int, Field(gt=0)]
    source: str
    timestep_ms: Positive
    friction: NotNegative
    body: Body
    drive: DriveGains | None
    start: Start = Start()
    refinement: Refinement = Refinement()
    pushes: Pushes
    success: Success
    shifts: Shifts = Shifts()
    deviations: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """``name-vVERSION``, as it is written beside every figure."""
        return f"{self.name}-v{self.version}"


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
