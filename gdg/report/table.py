"""Verdicts as a table for the terminal, and the one line that sums them up."""

from __future__ import annotations

import math

from rich.table import Table
from rich.text import Text

from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict
from gdg.metrics import joint_diversity, penetration_stats, wilson_interval

_NOTHING = "-"


def verdict_table(grasps: GraspSet) -> Table:
    """One row per grasp: energy, penetration, movement, drift, verdict, stability.

    ``moved`` is the largest displacement over the pushes and the lift, ``stability`` the share of
    the slightly shifted trials that passed. Columns stay empty for what was not measured.
    """
    table = Table(header_style="bold", row_styles=("", "dim"))
    for title in ("#", "energy", "penetration\nmm", "moved\nmm", "drift\nmm"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("stability", justify="right", no_wrap=True)
    energies = grasps.energies.get("total")
    for index in range(len(grasps)):
        energy = _NOTHING if energies is None else f"{float(energies[index]):.3g}"
        verdict = grasps.verdicts[index] if grasps.verdicts else None
        table.add_row(str(index), energy, *_verdict_cells(verdict))
    return table


def _verdict_cells(verdict: Verdict | None) -> tuple[str | Text, ...]:
    if verdict is None:
        return (_NOTHING, _NOTHING, _NOTHING, Text("not simulated", "dim"), _NOTHING)
    # Text, not str: rich would read [brackets] in names as markup
    outcome = Text("pass", "green") if verdict.success else Text(verdict.failure, "red")
    return (
        f"{verdict.penetration_start_mm:.2f}",
        millimetres(moved(verdict)),
        millimetres(verdict.drift_m),
        outcome,
        _trials_cell(verdict),
    )


def _trials_cell(verdict: Verdict) -> str:
    ran = f"{sum(verdict.shift_successes)}/{len(verdict.shift_successes)}"
    return f"{ran} of {verdict.trials}" if verdict.decided_early else ran


def moved(verdict: Verdict) -> float:
    """The largest displacement over the pushes and the lift that took place, metres."""
    each = (*verdict.displacement_m, verdict.lift_displacement_m)
    return max((length for length in each if not math.isnan(length)), default=math.nan)


def millimetres(length_m: float) -> str:
    """A length in millimetres, one decimal; whole ones above 100; a dash when not finite."""
    length_mm = 1000 * length_m
    if not math.isfinite(length_mm):
        return _NOTHING
    return f"{length_mm:.0f}" if length_mm >= 100 else f"{length_mm:.1f}"


def summary_line(grasps: GraspSet) -> str:
    """Successes with their Wilson 95 % interval, median penetration and diversity, plain text."""
    if len(grasps) == 0:
        return "no grasp found"
    if not grasps.verdicts:
        return f"{_count(len(grasps))}, not simulated"
    passed, total, of_what = len(grasps.passed), len(grasps.verdicts), _count(len(grasps.verdicts))
    if "yield" in grasps.provenance:  # only those that passed are here
        told = grasps.provenance["yield"]
        passed, total = told["passed"], told["proposed"]
        of_what = f"{total} proposed grasps"
    low, high = wilson_interval(passed, total)
    parts = [
        f"{passed}/{of_what} passed {_protocols(grasps)} "
        f"({100 * passed / total:.1f} %, 95 % interval {100 * low:.1f} to {100 * high:.1f} %)"
    ]
    if (penetration := penetration_stats(grasps)) is not None:
        parts.append(f"median penetration {penetration.median_mm:.2f} mm")
    if math.isfinite(diversity := joint_diversity(grasps)):
        parts.append(f"diversity {diversity:.2f} rad")
    return " · ".join(parts)


def _count(number: int) -> str:
    return f"{number} grasp" if number == 1 else f"{number} grasps"


def _protocols(grasps: GraspSet) -> str:
    return ", ".join(dict.fromkeys(verdict.protocol for verdict in grasps.verdicts))
