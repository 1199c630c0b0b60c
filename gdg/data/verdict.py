"""What a simulator says of one grasp under one protocol."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from gdg.data.json_values import finite_or_none

#: Push directions in the order of every per-direction field.
DIRECTIONS = ("+x", "-x", "+y", "-y", "+z", "-z")
#: What a grasp may fail by. Of several the first of this order names the failure, but for
#: ``diverged``: that names what failed by nothing else before the simulation ended in nonsense.
FAILURES = (
    "penetrating", "drifted", "lost-contact", "moved", "rotated", "dropped", "tilted", "diverged",
)  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """The outcome of one grasp under one stability protocol.

    Attributes:
        success: the protocol's criterion, over all shifts, by majority of the shifts.
        failure: why not: ``""`` on success, else one of ``FAILURES`` (of the first shift that
            failed). Overlap (at the start or after settling) is ``penetrating``, motion while
            closing ``drifted``; pushes fail by ``lost-contact``, ``moved``, ``rotated``; a lift by
            ``dropped`` (contact lost, moved in the hand, or left on the table) and ``tilted``
            (turned in the hand).
        displacement_m: object displacement per push direction (``DIRECTIONS``), metres, against
            the protocol's reference pose, of the unshifted trial. NaN for a push that did not
            take place, or that the protocol doesn't have; its rotation is NaN as well, and
            ``contact_kept`` false.
        rotation_rad: object rotation per push direction, radians.
        drift_m: how far the object moved while the hand closed and settled, metres.
        contact_kept: whether hand and object still touched after each push.
        penetration_start_mm: largest overlap of the hand with the object, or the table that it
            rests on, before the test, millimetres, by the signed distance at the hand's surface
            points and inscribed spheres.
        penetration_end_mm: the solver's largest overlap after settling, millimetres.
        free_displacement_m: how far the same object moves in one push without any hand.
        shift_successes: successes over trials in which the hand was shifted a little; the
            first trial is the unshifted one. Fewer than ``trials`` where a simulator stopped
            because the majority was decided.
        protocol: ``name-vVERSION``.
        engine: ``sapien 3.0.3`` and the like.
        refined: whether the contact-aware refinement closed the hand.
        seconds: wall time of all trials of this grasp.
        trials: trials that the protocol asks for; 0 where this is not known, as in verdicts
            written before the field was, of which all trials ran.
        lift_displacement_m: how far the object moved in the hand in the lift, metres, of the
            unshifted trial; NaN where no lift took place.
        lift_rotation_rad: how far it turned in the hand, likewise.
        lift_contact: whether the hand held it at the end of the lift: they touch, and nothing
            else does.
        left_out: what the engine can't simulate of the protocol, a sentence each.
    """

    success: bool
    failure: str
    displacement_m: tuple[float, ...]
    rotation_rad: tuple[float, ...]
    drift_m: float
    contact_kept: tuple[bool, ...]
    penetration_start_mm: float
    penetration_end_mm: float
    free_displacement_m: float
    shift_successes: tuple[bool, ...]
    protocol: str
    engine: str
    refined: bool
    seconds: float
    trials: int = 0
    lift_displacement_m: float = math.nan
    lift_rotation_rad: float = math.nan
    lift_contact: bool = False
    left_out: tuple[str, ...] = ()

    @property
    def success_rate(self) -> float:
        """Share of the shifted trials that passed, of those that ran."""
        return sum(self.shift_successes) / len(self.shift_successes)

    @property
    def stable(self) -> bool | None:
        """Whether every shifted trial gave the same answer; None if those that ran agree, but
        others were left out."""
        if len(set(self.shift_successes)) > 1:
            return False
        return None if self.decided_early else True

    @property
    def decided_early(self) -> bool:
        """Whether trials were left out because the majority was decided."""
        return len(self.shift_successes) < self.trials

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as they stand in ``grasps.json``; None where one is not finite."""
        return finite_or_none(asdict(self))

    @classmethod
    def from_dict(cls, tree: dict[str, Any]) -> Verdict:
        """The inverse of ``as_dict`` (JSON lists become tuples, null becomes NaN)."""
        return cls(**{name: _from_json(value) for name, value in tree.items()})


def stable_share(verdicts: Sequence[Verdict]) -> float:
    """Share of the grasps whose trials all gave the same answer; NaN where that is not known.

    It is not known when trials were left out because a majority was decided: all trials ran only
    where they disagreed, so a share of those grasps would always be 0.
    """
    if not verdicts or any(verdict.decided_early for verdict in verdicts):
        return math.nan
    return sum(bool(verdict.stable) for verdict in verdicts) / len(verdicts)


def left_out_of(verdicts: Iterable[Verdict]) -> tuple[str, ...]:
    """What engines left out of protocols, each sentence once."""
    return tuple(dict.fromkeys(one for verdict in verdicts for one in verdict.left_out))


def _from_json(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_from_json(item) for item in value)
    return math.nan if value is None else value
