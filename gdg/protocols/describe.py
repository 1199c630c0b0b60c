"""Protocols in words: the rows of the table in ``docs/protocols.md``. Light."""

from __future__ import annotations

import math
from collections.abc import Iterable

from gdg.protocols import SIX, Protocol

HEADER = ("preset", "load", "object", "friction", "drives", "closing", "passes if")


def markdown_table(protocols: Iterable[Protocol]) -> str:
    """One row per protocol, Markdown, with a line break at the end."""
    rows = [HEADER, ("---",) * len(HEADER), *(_row(protocol) for protocol in protocols)]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _row(p: Protocol) -> tuple[str, ...]:
    return (
        f"`{p.name}` v{p.version}",
        "; ".join([*_pushes(p), *_lift(p)]),
        _body(p),
        _friction(p),
        _drives(p),
        _closing(p),
        ", ".join([*_limits(p), *_start_limits(p)]),
    )


def _drives(p: Protocol) -> str:
    gains = "the hand's" if p.drive is None else f"{p.drive.stiffness:g} / {p.drive.damping:g}"
    return gains + ", motors shared" * p.shared_motors


def _friction(p: Protocol) -> str:
    if not p.torsional_friction:
        return f"{p.friction:g}"
    return f"{p.friction:g}, torsional {p.torsional_friction:g} m"


def _seconds(p: Protocol, steps: int) -> str:
    return f"{steps * p.timestep_ms / 1000:.3g} s"


def _pushes(p: Protocol) -> Iterable[str]:
    plan = p.pushes
    if plan is None:
        return
    which = "six ways" if plan.directions == SIX else "along " + ", ".join(plan.directions)
    rest = f" and {_seconds(p, plan.rest_steps)} without" * bool(plan.rest_steps)
    order = "each from the settled state" if plan.order == "reset" else "one after another"
    yield (
        f"{plan.acceleration:g} m/s² {which}, {_seconds(p, plan.steps)} each{rest}"
        + f", {order}" * (len(plan.directions) > 1)
    )


def _lift(p: Protocol) -> Iterable[str]:
    if p.lift is not None:
        origin = "off a table" if p.lift.support == "table" else f"gravity along {p.lift.direction}"
        hold = f", held for {_seconds(p, p.lift.hold_steps)}" * bool(p.lift.hold_steps)
        yield (
            f"lift by {100 * p.lift.height_m:g} cm in {_seconds(p, p.lift.steps)} at "
            f"{p.lift.gravity:g} m/s², {origin}{hold}"
        )


def _body(p: Protocol) -> str:
    body = p.body
    mass = f"{body.density:g} kg/m³" if body.mass_kg is None else f"{body.mass_kg:g} kg"
    if body.linear_damping or body.angular_damping:
        return f"{mass}, damping {body.linear_damping:g} / {body.angular_damping:g}"
    return mass


def _closing(p: Protocol) -> str:
    closing = p.refinement
    settle = f", settles {_seconds(p, p.start.settle_steps)}" * bool(p.start.settle_steps)
    if closing.step == "none":
        return "none" + settle
    return f"{closing.step}, {closing.size:g} rad or m{settle}"


def _limits(p: Protocol) -> Iterable[str]:
    success = p.success
    if success.max_displacement_m is not None:
        total = " in total" if success.measured == "total" else ""
        yield f"moves ≤ {100 * success.max_displacement_m:g} cm{total}"
    if success.max_rotation_rad is not None:
        yield f"turns ≤ {math.degrees(success.max_rotation_rad):.3g}°"
    if success.contact:
        yield "contact kept"
    if success.share < 1 and p.pushes is not None:
        needed = math.ceil(success.share * len(p.pushes.directions) - 1e-9)
        yield f"in at least {needed} of {len(p.pushes.directions)} pushes"


def _start_limits(p: Protocol) -> Iterable[str]:
    limits = (
        ("overlap as planned", 1000, "mm", p.start.max_initial_penetration_m),
        ("overlap left", 1000, "mm", p.start.max_penetration_m),
        ("drift while closing", 100, "cm", p.start.max_drift_m),
    )
    for what, factor, unit, limit in limits:
        if limit is not None:
            yield f"{what} ≤ {factor * limit:g} {unit}"
