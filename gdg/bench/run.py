"""Runs a table: its rows are cells of one evaluation, so that tables share what they can."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gdg.bench.assets import BenchObjects, bench_objects, told_hands
from gdg.bench.claims import ClaimVerdict, judge
from gdg.bench.job import NOT_SWEPT, QUICK, QUICK_OBJECTS, SET_BY_TABLE, BenchJob
from gdg.bench.tables import SOURCE, BenchTable, Method
from gdg.bench.weights import NO_WEIGHTS, MissingWeights, with_weights
from gdg.config import RunConfig, compose
from gdg.errors import GdgError, raise_if_any
from gdg.evaluation.cell import Cell, Result
from gdg.evaluation.rows import Row, Tested, summarise
from gdg.evaluation.run import Report, run_cells
from gdg.objects.splits import expand_split
from gdg.pipeline.jobs import DEFAULTS, EvalJob
from gdg.registry import get_registry


@dataclass(frozen=True)
class BenchRow:
    """A row of a table, ours and theirs.

    Attributes:
        method: what the row is.
        row: our numbers; None where they could not be had.
        settings: what tells the rows of one method apart, or "".
        note: why there are no numbers, or "".
        failed: whether that is a mistake to mend, not weights that nobody has trained yet.
    """

    method: Method
    row: Row | None = None
    settings: str = ""
    note: str = ""
    failed: bool = False


@dataclass(frozen=True)
class Bench:
    """A finished table.

    Attributes:
        table: which.
        rows: in the paper's order.
        claims: what became of the paper's claims.
        caption: hands, objects, n and the like, in sentences.
        folder: where it was written.
    """

    table: BenchTable
    rows: tuple[BenchRow, ...]
    claims: tuple[ClaimVerdict, ...]
    caption: str
    folder: Path


def run_bench(
    table: BenchTable,
    words: Sequence[str] = (),
    files: Sequence[Path] = (),
    quick: bool = False,
    report: Report | None = None,
) -> Bench:
    """Evaluates every row that has no result yet.

    A row whose weights or planner are missing says so in its note, and others don't suffer.

    Args:
        table: which.
        words: the user's settings.
        files: YAML files with settings.
        quick: the small size, for continuous integration.
        report: told as cells end.

    Raises:
        GdgError: mistakes in the settings, in hands or objects.
    """
    given = [*(QUICK if quick else ()), *words]
    job = _job(files, given)
    objects = _objects(given, quick)
    given.append(objects.word)
    prepared = [_prepare(method, job, files, given, quick) for method in table.methods]
    configs = [config for row in prepared for config in row.configs]
    results, mistakes = run_cells(configs, report) if configs else ([], [])
    raise_if_any(list(dict.fromkeys(mistakes)))
    by_key, folder = {result.cell.key: result for result in results}, Path(job.out)
    rows = [row for one in prepared for row in _rows(one, folder, by_key)]
    caption = _caption(table, job, objects, rows, quick)
    return Bench(table, tuple(rows), tuple(_claims(table, rows)), caption, folder)


def _job(files: Sequence[Path], words: Sequence[str]) -> BenchJob:
    """The job's own settings, after every mistake in the words was told."""
    mistakes = []
    for word in words:
        key, _, value = word.partition("=")
        if key in SET_BY_TABLE or key.startswith("planner."):
            mistakes.append(f"{key}: is set by the table; for another grid use gdg eval.")
        elif key in NOT_SWEPT and "," in value and not value.startswith(("'", '"')):
            mistakes.append(f"{key}: takes one value here, not {value}.")
    raise_if_any(mistakes)
    return compose(BenchJob, get_registry(), DEFAULTS, files, words)[0].job


def _objects(words: Sequence[str], quick: bool) -> BenchObjects:
    given = [expand_split(word) for word in words if word.partition("=")[0] == "object"]
    if given:
        return BenchObjects(given[-1], "the objects given")
    return bench_objects(QUICK_OBJECTS) if quick else bench_objects()


@dataclass(frozen=True)
class _Prepared:
    """The configs of a row; or none, and why there are none."""

    method: Method
    configs: tuple[RunConfig, ...] = ()
    note: str = ""


def _prepare(
    method: Method, job: BenchJob, files: Sequence[Path], words: Sequence[str], quick: bool
) -> _Prepared:
    registry = get_registry()
    try:
        registry.find("planner", method.planner)
    except GdgError as error:
        return _Prepared(method, note=f"planner missing: {error}")
    n = min(job.n, method.most or job.n)
    own = [*method.words, f"hand={method.hand}", f"n={n}"]
    composed = compose(
        BenchJob, registry, DEFAULTS, files, [*words, *(method.quick if quick else ()), *own]
    )
    try:
        configs = [with_weights(method, _as_eval(config), job.weights) for config in composed]
    except MissingWeights as error:
        return _Prepared(method, note=f"weights missing: {error}")
    return _Prepared(method, tuple(configs))


def _as_eval(config: RunConfig) -> RunConfig:
    """The same as a cell of ``gdg eval``, so that its config repeats there."""
    job = EvalJob(**config.job.model_dump(exclude={"weights"}))
    return config.model_copy(update={"job": job})


def _rows(prepared: _Prepared, folder: Path, results: dict[str, Result]) -> list[BenchRow]:
    """The rows of a method: one, or one per protocol and the like."""
    method = prepared.method
    if not prepared.configs:
        return [BenchRow(method, note=prepared.note)]
    tested: list[Tested] = []
    for config in prepared.configs:
        result = results[Cell.of(config, folder).key]
        if result.grasps is None:
            lacking = any(words in result.error for words in NO_WEIGHTS)
            what = "weights missing" if lacking else "failed"
            return [BenchRow(method, note=f"{what}: {result.error}", failed=not lacking)]
        tested.append((config, result.grasps))
    return [BenchRow(method, row, _settings(row)) for row in summarise(tested)]


def _settings(row: Row) -> str:
    return " · ".join(f"{key}={value}" for key, value in row.settings.items() if key != "hand")


def _claims(table: BenchTable, rows: Sequence[BenchRow]) -> list[ClaimVerdict]:
    found = {(row.method.label, row.settings): row.row for row in rows}
    settings = list(dict.fromkeys(row.settings for row in rows if row.row is not None)) or [""]
    return [
        judge(claim, found.get((claim.first, one)), found.get((claim.second, one)), one)
        for claim in table.claims
        for one in settings
    ]


def _caption(
    table: BenchTable, job: BenchJob, objects: BenchObjects, rows: Sequence[BenchRow], quick: bool
) -> str:
    protocols = dict.fromkeys(row.row.protocol for row in rows if row.row is not None)
    seeds = max((row.row.seeds for row in rows if row.row is not None), default=1)
    parts = [
        f"{table.title}.",
        f"Hands: {told_hands([method.hand for method in table.methods])}.",
        f"Objects: {objects.told}; grasps: {job.n} per object and seed at most, {seeds} "
        f"seed{'' if seeds == 1 else 's'}.",
        f"Protocol: {', '.join(protocols) or job.protocol}.",
        f"Published: {SOURCE}, in Isaac Gym.",
    ]
    if quick:
        parts.insert(0, "QUICK: this shows that all runs; its numbers are no results.")
    return " ".join(parts)
