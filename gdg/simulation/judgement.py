"""What a trial fails by, under the criteria of its protocol."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gdg.protocols import Protocol, Success


@dataclass(frozen=True)
class Push:
    """The object after one push, against the protocol's reference; metres and rad."""

    displacement: float
    rotation: float
    touching: bool


#: A push that didn't take place.
NO_PUSH = Push(math.nan, math.nan, False)


@dataclass(frozen=True)
class Lifted:
    """The object after the lift, against where it was in the hand before; metres and rad.

    Attributes:
        held: whether the hand touches it, and nothing else does.
    """

    displacement: float
    rotation: float
    held: bool


#: A lift that didn't take place.
NO_LIFT = Lifted(math.nan, math.nan, False)


def start_failure(protocol: Protocol, overlap: float, drift: float) -> str:
    """What a settled trial fails by: overlap and drift in metres."""
    limits = protocol.start
    if limits.max_penetration_m is not None and overlap > limits.max_penetration_m:
        return "penetrating"
    if limits.max_drift_m is not None and drift > limits.max_drift_m:
        return "drifted"
    return ""


def push_failure(protocol: Protocol, pushes: Sequence[Push]) -> str:
    """What the pushes so far fail by, empty if nothing yet.

    Where a share of the pushes may fail, what most often goes wrong first counts for nothing: the
    failure is named by the foremost reason of any push.
    """
    success, planned = protocol.success, protocol.pushes
    if planned is None:
        return ""
    total = len(planned.directions)
    together = success.measured == "total" and planned.order == "sequential"
    reasons = {
        _reason(success, push, judged=not together or number == total)
        for number, push in enumerate(pushes, start=1)
    }
    if success.share < 1:
        failed = sum(1 for push in pushes if _reason(success, push, judged=True))
        if total - failed >= success.share * total - 1e-9:
            return ""
    return next((reason for reason in _REASONS if reason in reasons), "")


def foremost_failure(success: Success) -> str:
    """The name that goes before all others that pushes under these criteria can fail by."""
    if success.contact:
        return "lost-contact"
    return "rotated" if success.max_displacement_m is None else "moved"


def lift_failure(protocol: Protocol, lifted: Lifted) -> str:
    """What the lift fails by, empty if nothing."""
    success = protocol.success
    if not lifted.held or _exceeds(lifted.displacement, success.max_displacement_m):
        return "dropped"
    return "tilted" if _exceeds(lifted.rotation, success.max_rotation_rad) else ""


#: The reasons of pushes, foremost first.
_REASONS = ("lost-contact", "moved", "rotated")


def _reason(success: Success, push: Push, judged: bool) -> str:
    """What one push fails by; where it is not ``judged``, where the object is doesn't count."""
    if success.contact and not push.touching:
        return "lost-contact"
    if judged and _exceeds(push.displacement, success.max_displacement_m):
        return "moved"
    return "rotated" if judged and _exceeds(push.rotation, success.max_rotation_rad) else ""


def _exceeds(value: float, limit: float | None) -> bool:
    return limit is not None and value > limit
