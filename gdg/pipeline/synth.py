"""``gdg synth``: a dataset of tested grasps, in shards that are complete or absent."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from gdg.cache import content_hash
from gdg.components import config_key
from gdg.config import RunConfig
from gdg.data.dataset import read_shard, shard_path, write_shard
from gdg.errors import GdgError, raise_if_any
from gdg.pipeline.jobs import SynthJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.pipeline.workers import limit_threads


@dataclass(frozen=True)
class PairResult:
    """What became of one hand-object pair.

    Attributes:
        hand: its name.
        object_name: its name.
        passed: grasps that passed, over all shards.
        tested: grasps simulated in this run.
        planned: candidates of this run, before the planner's thresholds.
        reason: why the pair was given up, or "".
        mistake: whether the reason is a mistake in what the user gave.
    """

    hand: str
    object_name: str
    passed: int
    tested: int
    planned: int
    reason: str = ""
    mistake: bool = False


def run_synth(
    configs: Sequence[RunConfig], report: Callable[[PairResult], None] | None = None
) -> tuple[list[PairResult], Path]:
    """Synthesises every pair; a re-run goes on where the last one stopped.

    Shards are named by the hash of what made them (hand, object, components, protocol, seed), so
    nothing is made twice, and a pair that has its ``n`` passing grasps is left alone.

    Args:
        configs: one per pair.
        report: called as each pair ends.

    Raises:
        GdgError: the mistakes of all pairs, once the others are done.
    """
    results = []
    for result in _run_pairs(configs):
        results.append(result)
        if report is not None:
            report(result)
    raise_if_any(list(dict.fromkeys(result.reason for result in results if result.mistake)))
    return results, Path(configs[0].job.out)


def _run_pairs(configs: Sequence[RunConfig]) -> Iterable[PairResult]:
    workers = configs[0].job.workers
    if workers == 1 or len(configs) == 1:
        yield from map(synthesise_pair, configs)
        return
    with ProcessPoolExecutor(
        workers, mp_context=get_context("spawn"), initializer=limit_threads, initargs=(workers,)
    ) as pool:
        futures = [pool.submit(synthesise_pair, config) for config in configs]
        for future in as_completed(futures):
            yield future.result()


def synthesise_pair(config: RunConfig) -> PairResult:
    """Plans and simulates shards until the pair has its grasps, or is given up."""
    try:
        return _fill(Pair.load(config))
    except GdgError as error:
        return PairResult(config.job.hand, config.job.object, 0, 0, 0, str(error), mistake=True)


def _fill(pair: Pair) -> PairResult:
    job: SynthJob = pair.config.job
    root, passed, tested, planned = Path(job.out), 0, 0, 0
    for shard in range(job.max_shards):
        key = _shard_key(pair, shard)
        path = shard_path(root, pair.hand.hand.name, pair.obj.name, key)
        if path.is_file():
            passed += len(read_shard(path).passed)
        else:
            counts = _make_shard(pair, root, key, shard)
            planned, tested, passed = (
                planned + job.shard, tested + counts[0], passed + counts[1]
            )  # fmt: skip
        if passed >= job.n:
            return PairResult(pair.hand.hand.name, pair.obj.name, passed, tested, planned)
    reason = f"{passed} of {job.n} grasps after {job.max_shards} shards of {job.shard}"
    return PairResult(pair.hand.hand.name, pair.obj.name, passed, tested, planned, reason)


def _make_shard(pair: Pair, root: Path, key: str, shard: int) -> tuple[int, int]:
    """Writes one shard; gives (grasps tested, grasps passed)."""
    job: SynthJob = pair.config.job
    seed = int(content_hash(job.seed, pair.obj.content_hash, pair.hand.hand.content_hash)[:8], 16)
    grasps = pair.plan(job.shard, generator_for(seed + shard))
    if len(grasps):
        grasps = pair.simulate(grasps)
    tested, passed = len(grasps), grasps.passed
    kept = grasps if job.keep_failed else grasps.select(passed)
    write_shard(root, key, kept, {**grasps.provenance, "tested": tested, "passed": len(passed)})
    return tested, len(passed)


def _shard_key(pair: Pair, shard: int) -> str:
    tree, job = pair.config.as_tree(), pair.config.job
    made_by = {key: tree[key] for key in (*_used_components(pair), "protocol", "refine")}
    parts = json.dumps(made_by, sort_keys=True), job.seed, job.shard, shard
    return content_hash(pair.hand.hand.content_hash, pair.obj.content_hash, *parts)[:16]


def _used_components(pair: Pair) -> list[str]:
    """Config keys of the components that shape grasps, with all that these use in turn."""
    used, pending = [], ["hand_model", "planner", "simulator"]
    while pending:
        key = pending.pop()
        if key not in used:
            used.append(key)
            pending += map(config_key, pair.config.components[key].record.uses)
    return used
