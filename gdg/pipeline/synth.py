"""``gdg synth``: a dataset of tested grasps, in shards that are complete or absent."""

from __future__ import annotations

import contextlib
import errno
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gdg.config import RunConfig
from gdg.engine import Engine, Outcome, TaskTimedOut, WorkersKilled, make_engine
from gdg.errors import GdgError, raise_if_any
from gdg.pipeline.counts import ShardCounts, total
from gdg.pipeline.jobs import SynthJob
from gdg.pipeline.schedule import PairState, Schedule, open_pairs
from gdg.pipeline.shard import MadeShard, ShardGroup, forget_pairs, make_shards
from gdg.pipeline.synth_record import SynthRecord, write_configs

#: Objects that a GPU plans for at once: some 10 000 chains with the usual options.
GPU_BATCH = 16


@dataclass(frozen=True)
class PairResult:
    """What became of one hand-object pair.

    Attributes:
        hand: its name.
        object_name: its name.
        passed: grasps that passed, over all shards.
        made: what became of the candidates of this run, by stage.
        shards: how many shards the pair has.
        reason: why the pair was given up, or "".
        mistake: whether the reason is a mistake in what the user gave, or killed workers.
        notes: what else is worth telling.
    """

    hand: str
    object_name: str
    passed: int
    made: ShardCounts = field(default_factory=ShardCounts)
    shards: int = 0
    reason: str = ""
    mistake: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Progress:
    """How far a run has come.

    Attributes:
        pairs: in all.
        ended: pairs that have their grasps, or were given up.
        grasps: that passed, earlier runs included.
        missing: that the other pairs still want.
        made: what became of the candidates of this run.
        seconds: since this run began.
    """

    pairs: int
    ended: int
    grasps: int
    missing: int
    made: ShardCounts
    seconds: float

    @property
    def rate(self) -> float:
        """Passing grasps per second of this run."""
        return self.made.passed / max(self.seconds, 1e-9)

    @property
    def eta_s(self) -> float | None:
        """Seconds until every pair has its grasps at this rate; None while nothing is known."""
        return self.missing / self.rate if self.made.passed else None


class Watcher:
    """Sees how a run advances; this one looks away."""

    def pair_ended(self, result: PairResult) -> None:
        """A pair has its grasps, or was given up."""

    def advanced(self, progress: Progress) -> None:
        """Something was finished."""


def run_synth(
    configs: Sequence[RunConfig], watcher: Watcher | None = None
) -> tuple[list[PairResult], Path]:
    """Synthesises every pair; a re-run goes on where the last one stopped.

    Shards are named by the hash of what made them (hand, object, components, protocol, limits,
    seed), so nothing is made twice, and a pair that has its ``n`` passing grasps is left alone.
    Workers make shards, this process alone writes them (``gdg.pipeline.schedule`` says which make
    the dataset). The folder also gets ``config.yaml`` and ``synth.json``.

    Args:
        configs: one per pair.
        watcher: told as it goes.

    Raises:
        GdgError: the mistakes of all pairs, once the others are done; or at once: the disk is
            full, workers can't start.
    """
    job: SynthJob = configs[0].job
    opened = list(open_pairs(configs))
    pairs = [pair for pair in opened if isinstance(pair, PairState)]
    run = _Run(pairs, Path(job.out), watcher or Watcher())
    with _disk_errors_told(run.root):
        write_configs(run.root, configs)
        run.leave_out_timed_out()
        run.go(_engine(job), objects_per_batch(job))
    mistakes = [str(error) for error in opened if isinstance(error, GdgError)]
    mistakes += [str(pair.error) for pair in pairs if isinstance(pair.error, GdgError)]
    for pair in pairs:
        if pair.error is not None and not isinstance(pair.error, GdgError):
            raise pair.error
    raise_if_any(list(dict.fromkeys(mistakes)))
    return [result_of(pair) for pair in pairs], run.root


def result_of(pair: PairState) -> PairResult:
    """What became of a pair that has ended."""
    return PairResult(
        pair.hand,
        pair.object_name,
        pair.passed,
        pair.made,
        pair.in_turn,
        str(pair.error or pair.reason),
        pair.error is not None,
        tuple(pair.notes),
    )


class _Run:
    """The driver's side of a run: gives out shards, writes them, keeps the record."""

    def __init__(self, pairs: list[PairState], root: Path, watcher: Watcher):
        self.root = root
        self._pairs, self._watcher = pairs, watcher
        self._record = SynthRecord(root, _settings(pairs))
        self._started = time.perf_counter()
        self._told: set[int] = set()
        self._made = ShardCounts()

    def leave_out_timed_out(self) -> None:
        """Ends the pairs of which a shard took too long before, with the same limit or more."""
        for pair in self._pairs:
            before = self._record.timed_out(pair)
            if before is None or pair.ended or pair.job.retry:
                continue
            number, limit = before
            if number not in pair.counts and 0 < pair.job.shard_timeout_s <= limit:
                _end_timed_out(pair, number, f"took longer than {limit:g} s")

    def go(self, engine: Engine, group: int = 1) -> None:
        """Makes what is missing, so many shards per call of the planner."""
        schedule = Schedule(self._pairs, group)
        outcomes = engine.run(make_shards, schedule.take)
        try:
            self._tell(self._pairs)
            for outcome in outcomes:
                pairs = schedule.pairs_of(outcome.task)
                _take_in(pairs, outcome)
                self._made = total([self._made, *(shard.counts for shard in outcome.result or ())])
                self._tell(pairs)
                self._record.save(self._pairs)
            self._record.save(self._pairs, now=True)
        except BaseException:
            outcomes.close()
            with contextlib.suppress(OSError):  # the disk may be what is full
                self._record.save(self._pairs, now=True)
            raise
        finally:
            forget_pairs()

    def _tell(self, pairs: Sequence[PairState]) -> None:
        for pair in pairs:
            if pair.ended and id(pair) not in self._told:
                self._told.add(id(pair))
                self._watcher.pair_ended(result_of(pair))
        self._watcher.advanced(self._progress())

    def _progress(self) -> Progress:
        going = [pair for pair in self._pairs if not pair.ended]
        return Progress(
            pairs=len(self._pairs),
            ended=len(self._pairs) - len(going),
            grasps=sum(pair.passed for pair in self._pairs),
            missing=sum(max(0, pair.job.n - pair.passed) for pair in going),
            made=self._made,
            seconds=time.perf_counter() - self._started,
        )


def _take_in(
    pairs: Sequence[PairState], outcome: Outcome[ShardGroup, tuple[MadeShard, ...]]
) -> None:
    """Writes what a worker made, or ends the pair with what went wrong.

    Of a group that failed nobody knows which shard is to blame, so each is made again by itself.
    """
    tasks, error = outcome.task.tasks, outcome.error
    if isinstance(error, OSError) and error.errno in _FULL:
        raise error
    for number, (pair, task) in enumerate(zip(pairs, tasks)):
        if outcome.result is not None:
            shard = outcome.result[number]
            pair.finish(task.number, shard.data, shard.counts)
        elif error is not None and len(tasks) > 1:
            pair.retry_alone(task.number, error)
        else:
            _end(pair, task.number, error)


def _end(pair: PairState, number: int, error: BaseException | None) -> None:
    """Ends a pair with what went wrong with one of its shards."""
    pair.running.discard(number)
    if isinstance(error, TaskTimedOut):
        _end_timed_out(pair, number, str(error))
    elif isinstance(error, WorkersKilled):
        pair.end(error=GdgError(f"{pair.hand} · {pair.object_name}: {error}"))
    else:
        pair.end(error=error)


def _end_timed_out(pair: PairState, number: int, how: str) -> None:
    pair.timed_out = number
    pair.end(f"shard {number} {how} (shard_timeout_s); retry=true tries it again")


def _engine(job: SynthJob) -> Engine:
    return make_engine(
        job.engine,
        job.workers,
        timeout_s=job.shard_timeout_s,
        address=job.ray_address,
        gpu=job.device.startswith("cuda"),
        size=len,
    )


def objects_per_batch(job: SynthJob) -> int:
    """Shards that a worker plans in one call."""
    return job.objects_per_batch or (GPU_BATCH if job.device.startswith("cuda") else 1)


def _settings(pairs: Sequence[PairState]) -> dict[str, str | int]:
    if not pairs:
        return {}
    job = pairs[0].job
    group = objects_per_batch(job)
    return {"engine": job.engine, "workers": job.workers, "objects_per_batch": group}


#: What the system says when a disk, a quota or a size limit is reached.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextlib.contextmanager
def _disk_errors_told(root: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        what = "the disk is full" if error.errno in _FULL else error.strerror or str(error)
        raise GdgError(
            f"{root}: cannot be written: {what} ({error.filename or 'file system'}). What was "
            f"finished is kept: make room and run the same command again."
        ) from error
