"""Runs a table: its rows are cells of one evaluation, so that tables share what they can."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gdg.bench.assets import BenchObjects, bench_objects, told_hands
from gdg.bench.claims import ClaimVerdict, judge
from gdg.bench.job import NOT_SWEPT, QUICK, QUICK_OBJECTS, SET_BY_TABLE, BenchJob
from gdg.bench.tables import SOURCE, BenchTable, Method
from gdg.bench.trained_on import RefusedWeights, TableObjects, check_weights
from gdg.bench.weights import RowWeights, with_weights
from gdg.config import ComponentChoice, RunConfig, compose
from gdg.errors import GdgError, MissingWeights, raise_if_any
from gdg.evaluation.cell import Cell, Result
from gdg.evaluation.rows import Row, Tested, summarise
from gdg.evaluation.run import Report, run_cells
from gdg.identity import Assets
from gdg.objects.splits import expand_split
from gdg.pipeline.fingerprint import used_components
from gdg.pipeline.jobs import DEFAULTS, EvalJob
from gdg.registry import get_registry


@dataclass(frozen=True)
class BenchRow:
    """A row of a table, ours and theirs.

    Attributes:
        method: what the row is.
        row: our numbers; None where they could not be had.
        settings: what tells the rows of one method apart, or "".
        note: why there are no numbers, or what is to be said of them, or "".
        failed: whether there are none by a mistake to mend, not by weights that nobody has trained
            as the row needs them.
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
        caption: hands, objects, weights, n and the like, in sentences.
        weights: that its rows used, each once.
        folder: where it was written.
    """

    table: BenchTable
    rows: tuple[BenchRow, ...]
    claims: tuple[ClaimVerdict, ...]
    caption: str
    weights: tuple[RowWeights, ...]
    folder: Path


def run_bench(
    table: BenchTable,
    words: Sequence[str] = (),
    files: Sequence[Path] = (),
    quick: bool = False,
    report: Report | None = None,
) -> Bench:
    """Evaluates every row that has no result yet.

    A row whose weights or planner are missing, or whose weights were trained otherwise than the row
    says, says so in its note, and others don't suffer.

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
    assets = Assets()
    prepared = [_prepare(method, job, files, given, quick, assets) for method in table.methods]
    configs = [config for row in prepared for config in row.configs]
    results, mistakes = run_cells(configs, report) if configs else ([], [])
    raise_if_any(list(dict.fromkeys(mistakes)))
    by_key, folder = {result.cell.key: result for result in results}, Path(job.out)
    made = [(one, _rows(one, folder, by_key)) for one in prepared]
    measured = [one for one, rows in made if rows[0].row is not None]
    rows = tuple(row for _, rows in made for row in rows)
    caption = _caption(table, job, objects, rows, measured, quick)
    claims = tuple(_claims(table, rows))
    return Bench(table, rows, claims, caption, _weights_of(measured), folder)


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
    """The configs of a row with the weights that they use; or none, and why there are none."""

    method: Method
    configs: tuple[RunConfig, ...] = ()
    weights: tuple[RowWeights, ...] = ()
    note: str = ""


def _prepare(
    method: Method,
    job: BenchJob,
    files: Sequence[Path],
    words: Sequence[str],
    quick: bool,
    assets: Assets,
) -> _Prepared:
    registry = get_registry()
    try:
        registry.find("planner", method.planner)
    except GdgError as error:
        return _Prepared(method, note=f"planner missing: {error}")
    n = min(job.n, method.most or job.n)
    own = [*(method.quick if quick else ()), *method.words, f"hand={method.hand}", f"n={n}"]
    given = [word for word in words if _group(word) not in method.fixed]
    composed = compose(BenchJob, registry, DEFAULTS, files, [*given, *own])
    if method.fixed:
        plain = compose(BenchJob, registry, DEFAULTS, (), own)[0].components
        fixed = {key: plain[key] for key in method.fixed}
        composed = [_with_components(config, fixed) for config in composed]
    try:
        pairs = [with_weights(method, _as_eval(config), job.weights, assets) for config in composed]
        found = {weights.path: weights for _, weights in pairs if weights is not None}
        objects = TableObjects.of(composed, assets)
        for one in found.values():
            check_weights(method, one, objects, assets)
    except MissingWeights as error:
        return _Prepared(method, note=f"weights missing: {error}")
    except RefusedWeights as error:
        return _Prepared(method, note=f"weights refused: {error}")
    return _Prepared(method, tuple(config for config, _ in pairs), tuple(found.values()))


def _with_components(config: RunConfig, choices: dict[str, ComponentChoice]) -> RunConfig:
    return config.model_copy(update={"components": {**config.components, **choices}})


def _group(word: str) -> str:
    """The component group, or the job's field, that a setting is of."""
    return word.partition("=")[0].partition(".")[0].strip()


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
            return [BenchRow(method, note=f"failed: {result.error}", failed=True)]
        tested.append((config, result.grasps))
    return [BenchRow(method, row, _settings(row)) for row in summarise(tested)]


def _settings(row: Row) -> str:
    return " · ".join(f"{key}={value}" for key, value in row.settings.items() if key != "hand")


def _claims(table: BenchTable, rows: Sequence[BenchRow]) -> list[ClaimVerdict]:
    found = {(row.method.label, row.settings): row.row for row in rows}
    settings = list(dict.fromkeys(row.settings for row in rows if row.row is not None)) or [""]
    return [
        judge(claim, [(found.get((a, one)), found.get((b, one))) for a, b in claim.pairs], one)
        for claim in table.claims
        for one in settings
    ]


def _caption(
    table: BenchTable,
    job: BenchJob,
    objects: BenchObjects,
    rows: Sequence[BenchRow],
    measured: Sequence[_Prepared],
    quick: bool,
) -> str:
    protocols = dict.fromkeys(row.row.protocol for row in rows if row.row is not None)
    seeds = max((row.row.seeds for row in rows if row.row is not None), default=1)
    weights = ", ".join(map(str, _weights_of(measured)))
    parts = [
        "QUICK: this shows that all runs; its numbers are no results." if quick else "",
        f"{table.title}.",
        f"Hands: {told_hands([method.hand for method in table.methods])}.",
        f"Objects: {objects.told}; grasps: {job.n} per object and seed at most, {seeds} "
        f"seed{'' if seeds == 1 else 's'}.",
        f"Protocol: {', '.join(protocols) or job.protocol}.",
        _told_maps([config for one in measured for config in one.configs]),
        f"Weights: {weights}." if weights else "",
        f"Published: {SOURCE}, in Isaac Gym.",
    ]
    return " ".join(filter(None, parts))


def _weights_of(measured: Sequence[_Prepared]) -> tuple[RowWeights, ...]:
    """The weights that rows used, each once."""
    return tuple({one.path: one for row in measured for one in row.weights}.values())


def _told_maps(configs: Sequence[RunConfig]) -> str:
    """Generators, fitters and rankings of the rows that go by contact maps, or ""."""
    made = [config for config in configs if "generator" in used_components(config)]
    if not made:
        return ""
    names = [
        ", ".join(dict.fromkeys(config.components[key].record.name for config in made))
        for key in ("generator", "fitter")
    ]
    how = ", ".join(dict.fromkeys(_told_choice(config) for config in made))
    return f"Contact maps from: {names[0]}; fitted by: {names[1]}; kept: {how}."


def _told_choice(config: RunConfig) -> str:
    """How a planner comes from contact maps to grasps, e.g. ``by stability, of 2 maps, closed``."""
    options = config.components["planner"].options.model_dump()
    told = [
        f"by {options['rank']}" if "rank" in options else "",
        f"of {options['maps']:g} maps each" if options.get("maps", 1) > 1 else "",
        "closed" if options.get("close") else "not closed",
    ]
    return " ".join(filter(None, told))
