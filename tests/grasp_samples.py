"""Verdicts for tests that only carry them about."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from gdg.data.verdict import Verdict

PASSED = Verdict(
    success=True,
    failure="",
    displacement_m=(0.001,) * 6,
    rotation_rad=(0.01,) * 6,
    drift_m=0.002,
    contact_kept=(True,) * 6,
    penetration_start_mm=1.5,
    penetration_end_mm=0.5,
    free_displacement_m=0.034,
    shift_successes=(True, True, True),
    protocol="dro-2024-v1",
    engine="some engine 1.0",
    refined=True,
    seconds=0.1,
)


def make_verdict(success: bool = True, **changes: Any) -> Verdict:
    """A verdict of all shifts alike; fields may be given."""
    shifts = (success,) * len(PASSED.shift_successes)
    failure = "" if success else "drifted"
    judged = replace(PASSED, success=success, failure=failure, shift_successes=shifts)
    return replace(judged, **changes)
