"""``gdg grasp verified=true``: proposes grasps until enough of them pass the test."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

from gdg.cache import content_hash
from gdg.config import RunConfig
from gdg.data.grasps import GraspSet
from gdg.engine import make_engine
from gdg.engine.threads import usable_cores
from gdg.kinds.fitter import Progress
from gdg.pipeline.jobs import GraspJob
from gdg.pipeline.kept_pair import forget_pair, kept_pair
from gdg.pipeline.pair import generator_for

#: Grasps planned and tested at a time: few, so that little is proposed in vain.
BATCH = 4


@dataclass(frozen=True)
class Batch:
    """Grasps to propose and test; what they are depends on this alone.

    Attributes:
        number: of the batch, from 0.
        config: of the run.
    """

    number: int
    config: RunConfig = field(compare=False, repr=False)

    @property
    def seed(self) -> int:
        """Of the batch's random choices: the run's own for the first."""
        seed = self.config.job.seed
        return int(content_hash(seed, self.number)[:8], 16) if self.number else seed


def for_verdicts(config: RunConfig) -> RunConfig:
    """The config with what its components have for verified grasps, where it says nothing else."""
    for key, choice in config.components.items():
        given = choice.options.model_fields_set
        if values := {k: v for k, v in choice.options.for_verified.items() if k not in given}:
            config = config.with_options(key, **values)
    return config


def verified_grasps(
    config: RunConfig,
    found: Callable[[GraspSet], None] = lambda grasps: None,
    progress: Progress | None = None,
) -> GraspSet:
    """``n`` grasps that pass the protocol, lowest energy first; fewer if too many fail.

    Batches of proposals are planned and tested in several processes, with one thread each, and
    taken in order, so that the grasps don't depend on the number of workers. ``most_proposed`` for
    each grasp asked for are tried at most. The provenance's ``yield`` says how many were proposed,
    how many of them passed, and what the others failed by.

    Args:
        config: of a ``GraspJob``.
        found: told the grasps so far whenever there are more, so that none is lost.
        progress: told how many there are, of how many.
    """
    config = for_verdicts(config)
    job: GraspJob = config.job
    report = progress or (lambda done, total: None)
    most = max(1, -(-job.n * job.most_proposed // BATCH))
    waiting, done = iter(range(most)), _Found(job.n)
    engine = make_engine("local", min(job.workers or _usual_workers(job), most))

    def take(last: Batch | None) -> Batch | None:
        number = None if done.surely_enough else next(waiting, None)
        return None if number is None else Batch(number, config)

    report(0, job.n)
    try:
        with closing(engine.run(tested_batch, take)) as outcomes:
            for outcome in outcomes:
                if outcome.error is not None:
                    raise outcome.error
                assert outcome.result is not None
                if done.add(outcome.task.number, outcome.result):
                    found(done.grasps())
                    report(len(done), job.n)
                if len(done) == job.n:
                    break  # batches that are still running are of no use
    finally:
        forget_pair()
    return done.grasps()


def _usual_workers(job: GraspJob) -> int:
    """A process per core, but none for which there may be nothing to do; one per GPU."""
    if job.device.startswith("cuda"):
        return 1
    return min(usable_cores(), -(-job.n // BATCH))


def tested_batch(batch: Batch) -> GraspSet:
    """A batch of proposals with their verdicts."""
    pair = kept_pair(batch.config)
    planned = pair.measured(pair.plan(BATCH, generator_for(batch.seed)))
    return pair.simulate(planned) if len(planned) else planned


class _Found:
    """Batches as they come in, and the passing grasps of those whose predecessors are all there."""

    def __init__(self, wanted: int):
        self._wanted = wanted
        self._batches: dict[int, GraspSet] = {}
        self._in_order = 0

    def __len__(self) -> int:
        return min(self._wanted, sum(len(batch.passed) for batch in self._first()))

    @property
    def surely_enough(self) -> bool:
        """Whether no further batch is needed, once those between are there, too."""
        passed = sum(len(batch.passed) for batch in self._batches.values())
        return passed >= self._wanted

    def add(self, number: int, batch: GraspSet) -> bool:
        """Takes a batch in; whether there are more grasps now."""
        before = len(self)
        self._batches[number] = batch
        while self._in_order in self._batches:
            self._in_order += 1
        return len(self) > before

    def grasps(self) -> GraspSet:
        """The first so many that passed, with the yield of the batches that they are from."""
        used, passed = [], 0
        for batch in self._first():
            used.append(batch)
            passed += len(batch.passed)
            if passed >= self._wanted:
                break
        joined = GraspSet.joined(used)
        kept = joined.select(joined.passed[: self._wanted])
        if "total" in kept.energies:
            kept = kept.select(kept.energies["total"].argsort(stable=True).tolist())
        return replace(kept, provenance={**kept.provenance, **_totals(used)})

    def _first(self) -> Iterator[GraspSet]:
        return (self._batches[number] for number in range(self._in_order))


def _totals(batches: list[GraspSet]) -> dict[str, Any]:
    """What became of all proposals, and the seconds that went into them."""
    verdicts = [verdict for batch in batches for verdict in batch.verdicts]
    sums: dict[str, Counter[str]] = {"seconds": Counter(), "rejected": Counter()}
    for batch in batches:
        for name, counter in sums.items():
            counter.update(batch.provenance.get(name, {}))
    return {
        **{name: dict(counter) for name, counter in sums.items()},
        "yield": {
            "proposed": BATCH * len(batches),
            "tested": len(verdicts),
            "passed": sum(verdict.success for verdict in verdicts),
            "failed": dict(Counter(v.failure for v in verdicts if not v.success)),
        },
    }
