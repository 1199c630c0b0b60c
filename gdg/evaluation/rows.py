"""Sums up cells in rows: one per combination of settings, objects and seeds pooled."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gdg.config import RunConfig
from gdg.data.grasps import GraspSet
from gdg.data.verdict import Verdict, left_out_of, stable_share
from gdg.evaluation.spread import Spread, diversity, pooled, spread_of
from gdg.metrics import Rate, chance_error, mean_interval

#: Settings that tell no rows apart: what is pooled, and how the work is shared.
POOLED = frozenset(
    ("object", "seed", "out", "engine", "workers", "threads", "ray_address", "cell_timeout_s")
)
#: Stages whose seconds are told apart. ``plan`` is all of planning; the four before it are parts of
#: it where the planner tells them.
STAGES = ("generate", "fit", "close", "rank", "plan", "measure", "simulate")

#: A config and its tested grasps.
Tested = tuple[RunConfig, GraspSet]


@dataclass(frozen=True)
class ObjectRow:
    """The same for one object of a row.

    Attributes:
        name: the object's.
        success: grasps that passed, of those asked for.
        diversity_rad: of its passing grasps; NaN for fewer than two.
        plan_s: seconds of planning per grasp.
    """

    name: str
    success: Rate
    diversity_rad: float
    plan_s: float


@dataclass(frozen=True)
class Row:
    """Summary of the cells that share every setting but the object and the seed.

    Attributes:
        settings: the settings that distinguish the rows of this evaluation.
        protocol: label of the protocol.
        engines: names and versions of the physics engines.
        n: grasps asked for per object and seed; a range if that differs.
        seeds: how many.
        success: grasps that passed by the majority of their trials, of those asked for; one that
            the planner did not find counts as a failure.
        macro: mean of the objects' success rates, and its 95 % interval over objects, at least as
            wide as chance makes it.
        trials: the mean over trials in which the hand was shifted a little, of all grasps asked
            for; k is NaN where the simulator left trials out.
        stable: share of grasps whose verdict was the same in all trials; NaN likewise.
        first: objects and seeds whose first-ranked grasp passed (pass@1).
        any: objects and seeds of which at least one grasp passed (best of ``n``).
        spread: how different the passing grasps are.
        penetration_mm: overlap of hand and object before the test, by the exact collision shapes:
            median, p95 and max over all planned grasps.
        quality: mean ε and volume of the grasp wrench space, over the passing grasps and over all.
        seconds: per grasp asked for, by stage; NaN for a stage that the planner does not tell.
        failures: reason -> grasps, ``not found`` included.
        rejected: the planner's reason -> candidates that it dropped.
        objects: the same by object.
        hardware: what the seconds were measured on.
        load: processes per core meanwhile, at most; more than 1 makes the seconds upper bounds.
        left_out: what the engines can't simulate of the protocol, a sentence each.
    """

    settings: dict[str, str]
    protocol: str
    engines: tuple[str, ...]
    n: str
    seeds: int
    success: Rate
    macro: tuple[float, float, float]
    trials: Rate
    stable: float
    first: Rate
    any: Rate
    spread: Spread
    penetration_mm: dict[str, float]
    quality: dict[str, float]
    seconds: dict[str, float]
    failures: dict[str, int]
    rejected: dict[str, int]
    objects: tuple[ObjectRow, ...]
    hardware: tuple[str, ...] = ()
    load: float = field(default=math.nan)
    left_out: tuple[str, ...] = ()


def summarise(cells: Sequence[Tested]) -> list[Row]:
    """One row per combination of settings, objects and seeds pooled."""
    trees = [flat(config.as_tree()) for config, _ in cells]
    # an option that some cells' components don't have can't tell rows apart; their names do
    shared = [key for key in trees[0] if all(key in tree for tree in trees)]
    varying = [key for key in shared if len({tree[key] for tree in trees}) > 1]
    keys = [k for k in dict.fromkeys(["hand", *varying]) if k not in POOLED]
    groups: dict[tuple[str, ...], list[Tested]] = {}
    for cell, tree in zip(cells, trees, strict=True):
        groups.setdefault(tuple(tree[k] for k in keys), []).append(cell)
    columns = zip(*(_shortened(column) for column in zip(*groups, strict=True)), strict=True)
    return [
        row_of(dict(zip(keys, values, strict=True)), members)
        for values, members in zip(columns, groups.values(), strict=True)
    ]


def row_of(settings: dict[str, str], cells: Sequence[Tested]) -> Row:
    """The row of cells that are pooled.

    Args:
        settings: what distinguishes them from others.
        cells: at least one.
    """
    sets = [grasps for _, grasps in cells]
    asked = [config.job.n for config, _ in cells]
    verdicts = [verdict for grasps in sets for verdict in grasps.verdicts]
    total = sum(asked)
    by_object = _by_object(cells)
    objects = tuple(_object_row(name, members) for name, members in by_object.items())
    counts = sorted(set(asked))
    return Row(
        settings=settings,
        protocol=", ".join(dict.fromkeys(v.protocol for v in verdicts)),
        engines=tuple(dict.fromkeys(v.engine for v in verdicts)),
        n=str(counts[0]) if len(counts) == 1 else f"{counts[0]}–{counts[-1]}",
        seeds=len({config.job.seed for config, _ in cells}),
        success=Rate(sum(v.success for v in verdicts), total),
        macro=_macro([row.success for row in objects]),
        trials=Rate(_trial_successes(verdicts), total),
        stable=stable_share(verdicts),
        first=Rate(sum(g.verdicts[0].success for g in sets if g.verdicts), len(sets)),
        any=Rate(sum(bool(g.passed) for g in sets), len(sets)),
        spread=spread_of(list(by_object.values())),
        penetration_mm=_penetration(sets),
        quality=_quality(sets),
        seconds=_seconds(sets, total),
        failures=_failures(verdicts, total),
        rejected=_added(grasps.provenance.get("rejected", {}) for grasps in sets),
        objects=objects,
        hardware=_measured_on(sets)[0],
        load=_measured_on(sets)[1],
        left_out=left_out_of(verdicts),
    )


def _macro(rates: Sequence[Rate]) -> tuple[float, float, float]:
    shares = [rate.share for rate in rates]
    return sum(shares) / len(shares), *mean_interval(shares, chance_error(rates))


def _by_object(cells: Sequence[Tested]) -> dict[str, list[Tested]]:
    """Objects by what the config calls them: files of one name are different objects."""
    found: dict[str, list[Tested]] = {}
    for config, grasps in cells:
        found.setdefault(config.job.object, []).append((config, grasps))
    return dict(zip(_shortened(list(found)), found.values(), strict=True))


def _object_row(name: str, cells: list[Tested]) -> ObjectRow:
    sets, total = [grasps for _, grasps in cells], sum(config.job.n for config, _ in cells)
    passed = sum(len(grasps.passed) for grasps in sets)
    seconds = _seconds(sets, total)["plan"]
    return ObjectRow(name, Rate(passed, total), diversity(pooled(sets)), seconds)


def _trial_successes(verdicts: Sequence[Verdict]) -> float:
    if any(verdict.decided_early for verdict in verdicts):
        return math.nan
    return float(sum(verdict.success_rate for verdict in verdicts))


def _penetration(sets: Sequence[GraspSet]) -> dict[str, float]:
    depths = _metric(sets, "penetration_mm")
    if not depths:
        return {"median": math.nan, "p95": math.nan, "max": math.nan}
    from numpy import quantile

    return {
        "median": float(quantile(depths, 0.5)),
        "p95": float(quantile(depths, 0.95)),
        "max": max(depths),
    }


def _quality(sets: Sequence[GraspSet]) -> dict[str, float]:
    passing = [grasps.select(grasps.passed) for grasps in sets]
    return {
        "epsilon": _mean(_metric(passing, "epsilon")),
        "volume": _mean(_metric(passing, "wrench_volume")),
        "epsilon_all": _mean(_metric(sets, "epsilon")),
        "volume_all": _mean(_metric(sets, "wrench_volume")),
    }


def _metric(sets: Sequence[GraspSet], name: str) -> list[float]:
    """Its finite values over all grasps."""
    values = [v for grasps in sets if name in grasps.metrics for v in grasps.metrics[name].tolist()]
    return [value for value in values if math.isfinite(value)]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan


def _seconds(sets: Sequence[GraspSet], total: int) -> dict[str, float]:
    """Seconds per grasp asked for; a part of planning that some cell does not tell is NaN."""
    told = [grasps.provenance.get("seconds", {}) for grasps in sets]
    parts = {stage: [seconds.get(stage, math.nan) for seconds in told] for stage in STAGES}
    # nothing is simulated where nothing was found
    tests = zip(parts["simulate"], sets, strict=True)
    parts["simulate"] = [seconds if len(grasps) else 0.0 for seconds, grasps in tests]
    return {stage: sum(values) / max(1, total) for stage, values in parts.items()}


def _failures(verdicts: Sequence[Verdict], total: int) -> dict[str, int]:
    counts = Counter(verdict.failure for verdict in verdicts if verdict.failure)
    if total > len(verdicts):
        counts["not found"] = total - len(verdicts)
    return dict(counts.most_common())


def _added(tables: Any) -> dict[str, int]:
    counts: Counter[str] = Counter()
    for table in tables:
        counts.update(table)
    return {reason: count for reason, count in counts.most_common() if count}


def _measured_on(sets: Sequence[GraspSet]) -> tuple[tuple[str, ...], float]:
    told = [m for g in sets for m in g.provenance.get("measured_on", {}).values()]
    loads = [m["load"] for m in told if m["load"] is not None]
    return tuple(dict.fromkeys(m["hardware"] for m in told)), max(loads, default=math.nan)


def flat(tree: dict[str, Any], prefix: str = "") -> dict[str, str]:
    """A config's tree by dotted keys; a component's name stands under its kind."""
    found: dict[str, str] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            found.update(flat(value, f"{prefix}{key}."))
        else:
            found[f"{prefix}{key}".removesuffix(".name")] = str(value)
    return found


def _shortened(values: Sequence[str]) -> list[str]:
    """Paths cut to their file names, unless that makes different ones equal."""
    short = [Path(value).stem if "/" in value else value for value in values]
    return short if len(set(short)) == len(set(values)) else list(values)
