"""Shards of hand-object pairs: plan, filter, simulate, measure, pack. Runs in a worker."""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from gdg.cache import content_hash
from gdg.config import RunConfig
from gdg.data.dataset import write_shard
from gdg.data.grasps import GraspSet
from gdg.errors import GdgError
from gdg.pipeline.counts import ShardCounts
from gdg.pipeline.fingerprint import fingerprint
from gdg.pipeline.jobs import SynthJob
from gdg.pipeline.pair import Pair, generator_for
from gdg.stopwatch import Stopwatch

#: Groups whose pairs a worker keeps loaded: the one it works on, and the one before.
GROUPS_KEPT = 2


@dataclass(frozen=True)
class PairTask:
    """A hand-object pair, equal to others of the same content.

    Attributes:
        key: ``pair_key`` of the config, as the driver sees its files.
        config: the pair's config.
    """

    key: str
    config: RunConfig = field(compare=False, repr=False)


@dataclass(frozen=True)
class ShardTask:
    """A shard to make.

    Attributes:
        pair: of which pair.
        number: which of its shards, from 0.
    """

    pair: PairTask
    number: int

    @property
    def key(self) -> str:
        """The name of the shard: what it holds depends on nothing else."""
        return shard_key(self.pair.key, self.number)


@dataclass(frozen=True)
class ShardGroup:
    """Shards that are planned in one call: of one hand, on as many objects.

    What a shard holds doesn't depend on the others of its group, as far as the planner keeps to
    ``Planner.plan_many``.

    Attributes:
        tasks: at least one; their configs differ in the object and the seed at most.
    """

    tasks: tuple[ShardTask, ...]

    def __len__(self) -> int:
        return len(self.tasks)


@dataclass(frozen=True)
class MadeShard:
    """A shard on its way to the disk.

    Attributes:
        data: the Parquet file.
        counts: what became of its candidates.
    """

    data: bytes
    counts: ShardCounts


def pair_key(config: RunConfig) -> str:
    """The hash of everything that shapes the shards of a pair.

    Raises:
        GdgError: hand, object or protocol can't be found.
    """
    job: SynthJob = config.job
    limits = (repr(job.max_penetration_mm), repr(job.max_self_penetration_mm))
    return fingerprint(config, job.shard, *limits)


def shard_key(key: str, number: int) -> str:
    """16 hex digits that name a shard of a pair."""
    return content_hash(key, number)[:16]


def make_shard(task: ShardTask) -> MadeShard:
    """Plans, filters, simulates and measures the grasps of one shard; see ``make_shards``."""
    return make_shards(ShardGroup((task,)))[0]


def make_shards(group: ShardGroup) -> tuple[MadeShard, ...]:
    """Plans the grasps of a group of shards; then filters, simulates and measures one by one.

    Memory stays bounded however many shards a worker makes: it holds the pairs (hand, object,
    components) of ``GROUPS_KEPT`` groups and the group's shards, whose size is set by the
    ``shard`` option and the planner's batch (Allegro with planner dfc, one shard: 0.8 GB, mostly
    libraries, 1.1 GB while a mesh is prepared for the first time; each further object 40 MB).
    A file depends only on its task's key, but for the seconds in its provenance.

    Raises:
        GdgError: a mistake in what the user gave, or this worker sees other files than the driver.
    """
    pairs = _LOADED.pairs_of(group)
    seeds = [_seed(pair) + task.number for pair, task in zip(pairs, group.tasks)]
    planned = _planned(pairs, seeds, group.tasks[0].pair.config.job.shard)
    made = zip(group.tasks, pairs, seeds, planned)
    return tuple(_finished(task, pair, seed, grasps) for task, pair, seed, grasps in made)


def _planned(pairs: Sequence[Pair], seeds: Sequence[int], count: int) -> list[GraspSet]:
    """Grasps of each pair, with an even share of the seconds that a joint call took."""
    first, generators = pairs[0], [generator_for(seed) for seed in seeds]
    if len(pairs) == 1:
        return [first.plan(count, generators[0], contact_maps=False)]
    started = time.perf_counter()
    objects = [pair.obj for pair in pairs]
    found = first.components.get("planner").plan_many(first.hand, objects, count, generators)
    seconds = (time.perf_counter() - started) / len(pairs)
    return [pair.stamped(grasps, seconds) for pair, grasps in zip(pairs, found, strict=True)]


def _finished(task: ShardTask, pair: Pair, seed: int, planned: GraspSet) -> MadeShard:
    """The shard of what was planned for it."""
    job: SynthJob = task.pair.config.job
    watch = Stopwatch()
    with watch.stage("filter"):
        grasps, rejected = _clear(pair, planned, job)
    with watch.stage("simulate"):
        tested = pair.simulate(grasps) if len(grasps) else grasps
    with watch.stage("measure"):
        kept = pair.measured(tested if job.keep_failed else tested.select(tested.passed))
    told = planned.provenance
    counts = ShardCounts(
        candidates=told.get("candidates", len(planned)),
        planned=len(planned),
        tested=len(tested),
        passed=len(tested.passed),
        rejected={k: v for k, v in (Counter(told.get("rejected", {})) + rejected).items() if v},
        failed=dict(Counter(verdict.failure for verdict in tested.verdicts if verdict.failure)),
        seconds={"plan": planned.provenance["seconds"]["plan"], **watch.seconds},
    )
    facts = {"shard": task.number, "shard_seed": seed, "job": _shaping(job), **counts.as_dict()}
    if not len(kept):
        facts["reason"] = f"no grasp passed; mostly {counts.commonest_loss() or 'none was found'}"
    return MadeShard(_packed(task.key, replace(kept, contact_values=None), facts), counts)


class _LoadedPairs:
    """The pairs that this process keeps loaded, those used last at the end."""

    def __init__(self) -> None:
        self._pairs: dict[PairTask, Pair] = {}

    def pairs_of(self, group: ShardGroup) -> list[Pair]:
        """The pair of each shard; pairs that are loaded together share the hand."""
        tasks = list(dict.fromkeys(task.pair for task in group.tasks))
        beside: Pair | None = None
        for task in tasks:
            pair = self._pairs.pop(task, None) or _load(task, beside)
            self._pairs[task] = beside = pair
        for task in list(self._pairs)[: -GROUPS_KEPT * len(tasks)]:
            del self._pairs[task]
        return [self._pairs[task.pair] for task in group.tasks]

    def clear(self) -> None:
        self._pairs.clear()


_LOADED = _LoadedPairs()


def forget_pairs() -> None:
    """Lets go of the pairs that this process keeps loaded."""
    _LOADED.clear()


def _load(task: PairTask, beside: Pair | None) -> Pair:
    if pair_key(task.config) != task.key:
        job = task.config.job
        raise GdgError(
            f"{job.hand} × {job.object}: the files of hand, object or protocol, or the version of "
            f"a component, are not those with which the run began; start it again (on a cluster: "
            f"with the same files and versions on every node)."
        )
    return Pair.load(task.config, beside)


def _seed(pair: Pair) -> int:
    parts = (pair.job.seed, pair.obj.content_hash, pair.hand.hand.content_hash)
    return int(content_hash(*parts)[:8], 16)


def _shaping(job: SynthJob) -> dict[str, float | int]:
    """Options of this command that shape a shard, for its provenance."""
    return {
        "grasps_per_shard": job.shard,
        "max_penetration_mm": job.max_penetration_mm,
        "max_self_penetration_mm": job.max_self_penetration_mm,
    }


def _clear(pair: Pair, grasps: GraspSet, job: SynthJob) -> tuple[GraspSet, Counter[str]]:
    """The grasps without overlap by the exact collision shapes, and why the others went."""
    from gdg.quality import exact_overlap

    if not len(grasps):
        return grasps, Counter()
    overlap = exact_overlap(pair.hand, pair.obj, grasps)
    # NaN compares as False, so it is rejected
    outside = overlap.object_mm <= job.max_penetration_mm
    apart = overlap.self_mm <= job.max_self_penetration_mm
    rejected = Counter(
        {
            "penetration": int((~outside).sum()),
            "self-penetration": int((outside & ~apart).sum()),
        }
    )
    keep = [i for i, good in enumerate((outside & apart).tolist()) if good]
    return grasps.select(keep), rejected


def _packed(key: str, grasps: GraspSet, facts: dict[str, object]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="gdg-") as folder:
        return write_shard(Path(folder), key, grasps, {**grasps.provenance, **facts}).read_bytes()
