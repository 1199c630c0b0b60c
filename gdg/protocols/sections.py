"""The sections of a stability protocol: what each says, in which unit. Light."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Steps = Annotated[int, Field(gt=0)]
#: A direction along an axis of the object's frame.
Direction = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
SIX: tuple[Direction, ...] = ("+x", "-x", "+y", "-y", "+z", "-z")


class Section(BaseModel):
    """A part of a protocol.

    What a protocol dumps to goes into the names of dataset shards (``gdg.pipeline.fingerprint``).
    So a field that a later gdg adds is left out where it has its default: what the protocol means
    is then unchanged, and so must be its dump.

    Attributes:
        LATER: names of such fields.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    LATER: ClassVar[frozenset[str]] = frozenset()

    @model_serializer(mode="wrap")
    def _without_unused(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        fields, tree = type(self).model_fields, dump(self)
        unused = [name for name in self.LATER if getattr(self, name) == fields[name].default]
        return {name: value for name, value in tree.items() if name not in unused}


class Start(Section):
    """How a grasp starts, and how much overlap and drift may remain.

    Attributes:
        mode: ``as-fitted``, or ``backed-out``: joints are opened until no hand point lies
            deeper than ``clearance_m`` in the object, and then closed by the drives.
        clearance_m: allowed overlap after backing out, metres.
        settle_steps: steps without any push before the first one; the weight of an object on a
            table acts.
        max_initial_penetration_m: a grasp that starts deeper in the object than this fails
            whatever follows, metres; None: any.
        max_penetration_m: more overlap than this after settling fails the grasp; None: any.
        max_drift_m: more object motion than this while settling fails it; None: any.
        max_depenetration_velocity: solver's limit, m/s.
    """

    LATER: ClassVar[frozenset[str]] = frozenset({"max_initial_penetration_m"})

    mode: Literal["as-fitted", "backed-out"] = "as-fitted"
    clearance_m: NotNegative = 0.0005
    settle_steps: Annotated[int, Field(ge=0)] = 0
    max_initial_penetration_m: Positive | None = None
    max_penetration_m: Positive | None = None
    max_drift_m: Positive | None = None
    max_depenetration_velocity: Positive = 3.0


class Refinement(Section):
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


class Pushes(Section):
    """Pushes along axes of the world (= object) frame.

    Attributes:
        acceleration: force = acceleration × object mass, m/s².
        steps: steps per push.
        order: ``sequential``: each starts where the last ended; ``reset``: each starts from the
            settled state.
        directions: which of the six there are; they always come in the order of the six.
        rest_steps: steps without force after each push, before it is judged.
    """

    LATER: ClassVar[frozenset[str]] = frozenset({"directions", "rest_steps"})

    acceleration: Positive
    steps: Steps
    order: Literal["sequential", "reset"] = "sequential"
    directions: tuple[Direction, ...] = SIX
    rest_steps: Annotated[int, Field(ge=0)] = 0

    @field_validator("directions", mode="after")
    @classmethod
    def _sorted(cls, given: tuple[Direction, ...]) -> tuple[Direction, ...]:
        if not given or len(set(given)) < len(given):
            raise ValueError(f"must name one or more of {', '.join(SIX)}, each once")
        return tuple(direction for direction in SIX if direction in given)


class Lift(Section):
    """The hand lifts the object against gravity, from the settled state, after the pushes.

    The hand's root stands still: by the equivalence principle an object in a hand that rises with
    acceleration a is one in a standing hand under weight and inertial force, −(g + a) per mass.
    The hand rises along a fifth-order polynomial, at rest at both ends.

    Attributes:
        height_m: how far, metres; 0 holds the object against gravity alone.
        steps: how long the rise takes.
        hold_steps: steps at rest at the top, before the lift is judged.
        gravity: m/s².
        direction: of gravity, without a table; on one gravity acts against its normal.
        support: ``none``: gravity sets in with the lift, as if a support were taken away;
            ``table``: the object rests on a table, and feels its weight, from the beginning.
    """

    height_m: NotNegative
    steps: Steps
    hold_steps: Annotated[int, Field(ge=0)] = 0
    gravity: Positive = 9.81
    direction: Direction = "-z"
    support: Literal["none", "table"] = "none"

    @model_validator(mode="after")
    def _one_gravity(self) -> Lift:
        if self.support == "table" and self.direction != "-z":
            raise ValueError("on a table gravity acts against its normal; leave direction out")
        return self


class Body(Section):
    """The object's physics: density in kg/m³ or mass in kg (one of the two), damping in 1/s."""

    LATER: ClassVar[frozenset[str]] = frozenset({"mass_kg"})

    density: Positive | None = None
    mass_kg: Positive | None = None
    linear_damping: NotNegative = 0.0
    angular_damping: NotNegative = 0.0

    @model_validator(mode="after")
    def _one_of_two(self) -> Body:
        if (self.density is None) == (self.mass_kg is None):
            raise ValueError("give either density (kg/m³) or mass_kg, one of the two")
        return self


class DriveGains(Section):
    """Position-drive gains of every joint: N m/rad and N m s/rad."""

    stiffness: Positive
    damping: NotNegative


class Success(Section):
    """When a grasp passes: what holds of every push, and of the lift.

    Attributes:
        max_displacement_m: of the object's centre of mass, metres; None: any.
        measured: ``per-push``: against the pose at the start of that push; ``total``: against
            the pose before the first push, judged after the last.
        max_rotation_rad: against the same reference; None: any.
        contact: whether hand and object must still touch after every push.
        share: this share of the pushes must pass, of those that the protocol has; the lift must
            pass in any case.
    """

    LATER: ClassVar[frozenset[str]] = frozenset({"share"})

    max_displacement_m: Positive | None = None
    measured: Literal["per-push", "total"] = "per-push"
    max_rotation_rad: Positive | None = None
    contact: bool = False
    share: Annotated[float, Field(gt=0, le=1)] = 1.0

    @model_validator(mode="after")
    def _judges_something(self) -> Success:
        if self.max_displacement_m is None and self.max_rotation_rad is None and not self.contact:
            raise ValueError("give max_displacement_m, max_rotation_rad or contact: true")
        if self.share < 1 and self.measured == "total":
            raise ValueError("a share of the pushes can only pass if measured is per-push")
        return self


class Shifts(Section):
    """Trials with the hand moved a little, since one verdict of a touching grasp is noisy.

    Attributes:
        count: number of shifted trials beside the unshifted one.
        distance_m: length of each shift, metres; directions follow a fixed pattern.
    """

    count: Annotated[int, Field(ge=0)] = 0
    distance_m: NotNegative = 0.0002
