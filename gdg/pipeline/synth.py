"""``gdg synth``: a dataset of tested grasps, in shards that are complete or absent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gdg.cache import content_hash
from gdg.config import RunConfig
from gdg.data.dataset import read_shard, shard_path, write_shard
from gdg.errors import GdgError, raise_if_any
from gdg.pipeline.fingerprint import fingerprint
from gdg.pipeline.jobs import SynthJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.pipeline.workers import run_all


@dataclass(frozen=True)
class PairResult:
    """What became of one hand-object pair.

    Attributes:
        hand: its name.
        object_name: its name.
        passed: grasps that passed, over all shards.
        tested: grasps simulated in this run.
        candidates: what the planner tried in this run, before its thresholds.
        reason: why the pair was given up, or "".
        mistake: whether the reason is a mistake in what the user gave.
    """

    hand: str
    object_name: str
    passed: int
    tested: int
    candidates: int
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
    for _, result in run_all(synthesise_pair, configs, configs[0].job.workers):
        results.append(result)
        if report is not None:
            report(result)
    raise_if_any(list(dict.fromkeys(result.reason for result in results if result.mistake)))
    return results, Path(configs[0].job.out)


def synthesise_pair(config: RunConfig) -> PairResult:
    """Plans and simulates shards until the pair has its grasps, or is given up."""
    try:
        return _fill(Pair.load(config))
    except GdgError as error:
        return PairResult(config.job.hand, config.job.object, 0, 0, 0, str(error), mistake=True)


def _fill(pair: Pair) -> PairResult:
    job: SynthJob = pair.config.job
    root, passed, tested, candidates = Path(job.out), 0, 0, 0
    hand, obj = pair.hand.hand.name, pair.obj.name
    for shard in range(job.max_shards):
        key = fingerprint(pair.config, job.shard, shard)
        path = shard_path(root, hand, obj, key)
        if path.is_file():
            passed += len(read_shard(path).passed)
        else:
            made = _make_shard(pair, root, key, shard)
            candidates, tested, passed = (
                candidates + made[0], tested + made[1], passed + made[2]
            )  # fmt: skip
        if passed >= job.n:
            return PairResult(hand, obj, passed, tested, candidates)
    reason = f"{passed} of {job.n} grasps after {job.max_shards} shards"
    return PairResult(hand, obj, passed, tested, candidates, reason)


def _make_shard(pair: Pair, root: Path, key: str, shard: int) -> tuple[int, int, int]:
    """Writes one shard; gives (candidates, grasps tested, grasps passed)."""
    job: SynthJob = pair.config.job
    seed = int(content_hash(job.seed, pair.obj.content_hash, pair.hand.hand.content_hash)[:8], 16)
    grasps = pair.plan(job.shard, generator_for(seed + shard))
    if len(grasps):
        grasps = pair.simulate(grasps)
    tested, passed = len(grasps), grasps.passed
    kept = grasps if job.keep_failed else grasps.select(passed)
    facts = {"tested": tested, "passed": len(passed), "shard": shard, "shard_seed": seed + shard}
    write_shard(root, key, kept, {**grasps.provenance, **facts})
    return grasps.provenance.get("candidates", tested), tested, len(passed)
