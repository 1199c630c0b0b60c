"""``gdg eval``: a grid of hands, objects and settings, each cell planned and tested."""

from __future__ import annotations

import itertools
import json
import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from gdg.config import RunConfig
from gdg.data.atomic import write_text_atomically
from gdg.data.grasps import GraspSet, load_grasps
from gdg.data.json_values import finite_or_none
from gdg.data.verdict import stable_share
from gdg.errors import GdgError
from gdg.metrics import joint_diversity, wilson_interval
from gdg.pipeline.fingerprint import fingerprint
from gdg.pipeline.jobs import EvalJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.pipeline.workers import run_all
from gdg.yaml_files import dump_yaml


@dataclass(frozen=True)
class Row:
    """Summary of the cells that share every setting but the object (and the seed).

    Attributes:
        settings: the settings that distinguish the rows of this evaluation.
        protocol: label of the protocol.
        objects: number of objects.
        n: grasps asked for; one that the planner did not find counts as a failure.
        successes: grasps that passed.
        interval: 95 % Wilson interval of the success rate.
        stable: share of grasps whose verdict was the same in all shifted trials; NaN where the
            simulator stopped trials early.
        diversity_rad: joint standard deviation of the passing grasps, over all objects.
        penetration_mm: median initial penetration.
        seconds: mean time per grasp, by stage.
        failures: reason -> count.
    """

    settings: dict[str, str]
    protocol: str
    objects: int
    n: int
    successes: int
    interval: tuple[float, float]
    stable: float
    diversity_rad: float
    penetration_mm: float
    seconds: dict[str, float]
    failures: dict[str, int]


def run_eval(
    configs: Sequence[RunConfig], report: Callable[[int, int, str], None] | None = None
) -> tuple[list[Row], Path]:
    """Runs every cell that has no result yet, and summarises all.

    Results lie in ``out/cells/KEY/grasps.json``, KEY being the hash of all that shapes them
    (``gdg.pipeline.fingerprint``);
    a cell that is complete is not run again. A cell that fails with a ``GdgError`` leaves the
    others alone and is raised at the end.

    Args:
        configs: one per cell.
        report: called with (cells done, cells in all, what was just finished).
    """
    job: EvalJob = configs[0].job
    folder = Path(job.out)
    cells, errors = _cells(folder, configs)
    pending = [config for path, config in cells.items() if not path.is_file()]
    done = len(configs) - len(pending)
    tell = report or (lambda *_: None)
    tell(done, len(configs), "")
    for config, error in run_all(run_cell, pending, job.workers):
        done += 1
        if error is not None:
            errors.append(error)
        tell(done, len(configs), f"{config.job.hand} · {config.job.object}")
    if errors:
        raise GdgError("\n".join(dict.fromkeys(errors)))
    rows = summarise([(config, load_grasps(path)) for path, config in cells.items()])
    tree = finite_or_none([asdict(row) for row in rows])
    write_text_atomically(folder / "summary.json", json.dumps(tree, indent=1) + "\n")
    write_text_atomically(folder / "summary.md", markdown(rows))
    return rows, folder


def run_cell(config: RunConfig) -> str | None:
    """Plans and tests one cell; gives the sentence of a user's mistake, or None."""
    path = _cell(Path(config.job.out), config)
    try:
        pair = Pair.load(config)
        grasps = pair.plan(config.job.n, generator_for(config.job.seed))
        if len(grasps):
            grasps = pair.simulate(grasps)
    except GdgError as error:
        return str(error)
    text = dump_yaml(config.as_tree())
    write_text_atomically(path.parent / "config.yaml", text)
    grasps.save(path)
    return None


def _cell(folder: Path, config: RunConfig) -> Path:
    return folder / "cells" / fingerprint(config, config.job.n) / "grasps.json"


def _cells(folder: Path, configs: Sequence[RunConfig]) -> tuple[dict[Path, RunConfig], list[str]]:
    """Result file -> config, each cell once, and the mistakes of configs that have none."""
    cells: dict[Path, RunConfig] = {}
    mistakes = []
    for config in configs:
        try:
            cells[_cell(folder, config)] = config
        except GdgError as error:
            mistakes.append(str(error))
    return cells, mistakes


def summarise(cells: Sequence[tuple[RunConfig, GraspSet]]) -> list[Row]:
    """One row per combination of settings, objects and seeds pooled."""
    trees = [_flat(config.as_tree()) for config, _ in cells]
    pooled = {"object", "seed", "out", "workers"}
    # an option that some cells' components don't have can't tell rows apart; their names do
    shared = [key for key in trees[0] if all(key in tree for tree in trees)]
    varying = [key for key in shared if len({tree[key] for tree in trees}) > 1]
    keys = [k for k in dict.fromkeys(["hand", *varying]) if k not in pooled]
    groups: dict[tuple[str, ...], list[int]] = {}
    for index, tree in enumerate(trees):
        groups.setdefault(tuple(tree.get(k, "") for k in keys), []).append(index)
    columns = zip(*(_shortened(column) for column in zip(*groups, strict=True)), strict=True)
    return [
        _row(
            dict(zip(keys, values, strict=True)),
            [cells[i][1] for i in members],
            sum(cells[i][0].job.n for i in members),
        )
        for values, members in zip(columns, groups.values(), strict=True)
    ]


def _row(settings: dict[str, str], sets: list[GraspSet], requested: int) -> Row:
    verdicts = [verdict for grasps in sets for verdict in grasps.verdicts]
    successes = sum(verdict.success for verdict in verdicts)
    n = max(requested, len(verdicts))
    failures = {"not found": n - len(verdicts)} if n > len(verdicts) else {}
    for verdict in verdicts:
        if verdict.failure:
            failures[verdict.failure] = failures.get(verdict.failure, 0) + 1
    seconds: dict[str, float] = {}
    for grasps in sets:
        for stage, value in grasps.provenance.get("seconds", {}).items():
            seconds[stage] = seconds.get(stage, 0.0) + value / max(1, n)
    return Row(
        settings=settings,
        protocol=verdicts[0].protocol if verdicts else "",
        objects=len({grasps.object_name for grasps in sets}),
        n=n,
        successes=successes,
        interval=wilson_interval(successes, n),
        stable=stable_share(verdicts),
        diversity_rad=_pooled_diversity(sets),
        penetration_mm=_median_penetration(sets),
        seconds=seconds,
        failures=failures,
    )


def _pooled_diversity(sets: list[GraspSet]) -> float:
    tested = [grasps for grasps in sets if grasps.verdicts]
    if not tested:
        return math.nan
    first = tested[0]
    pooled = GraspSet(
        first.hand,
        "all",
        first.joint_names,
        first.root_link,
        torch.cat([grasps.poses for grasps in tested]),
        torch.cat([grasps.joints for grasps in tested]),
        verdicts=tuple(itertools.chain.from_iterable(grasps.verdicts for grasps in tested)),
    )
    return joint_diversity(pooled)


def _median_penetration(sets: list[GraspSet]) -> float:
    depths = [v.penetration_start_mm for grasps in sets for v in grasps.verdicts]
    return statistics.median(depths) if depths else math.nan


def _flat(tree: dict[str, Any], prefix: str = "") -> dict[str, str]:
    flat: dict[str, str] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}".removesuffix(".name")] = str(value)
    return flat


def _shortened(values: Sequence[str]) -> list[str]:
    """Paths cut to their file names, unless that makes different ones equal."""
    short = [Path(value).stem if "/" in value else value for value in values]
    return short if len(set(short)) == len(set(values)) else list(values)


#: Titles of the columns after the settings.
COLUMNS = (
    "protocol", "objects", "n", "success %", "95 %", "stable %", "diversity rad",
    "penetration mm", "plan s", "simulate s",
)  # fmt: skip


def markdown(rows: Sequence[Row]) -> str:
    """The summary as a Markdown table."""
    header = [*rows[0].settings, *COLUMNS]
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    lines += ["| " + " | ".join(cells(row)) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def cells(row: Row) -> list[str]:
    """The values of one row as text, in the order of the tables."""
    low, high = row.interval
    return [
        *row.settings.values(),
        row.protocol,
        str(row.objects),
        str(row.n),
        f"{100 * row.successes / max(1, row.n):.1f}",
        f"{100 * low:.0f}–{100 * high:.0f}",
        f"{100 * row.stable:.0f}",
        f"{row.diversity_rad:.3f}",
        f"{row.penetration_mm:.2f}",
        f"{row.seconds.get('plan', math.nan):.2f}",
        f"{row.seconds.get('simulate', math.nan):.2f}",
    ]
