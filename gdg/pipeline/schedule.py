"""Which shard is made next, and when a pair is done or given up."""

from __future__ import annotations

import json
import math
import os
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from gdg.config import RunConfig
from gdg.data.atomic import atomic_path
from gdg.data.shards import read_info, shard_path
from gdg.errors import GdgError
from gdg.folders import HANDS, OBJECTS
from gdg.hands.spec import read_spec
from gdg.objects.spec import read_object_spec
from gdg.pipeline.counts import ShardCounts, total
from gdg.pipeline.jobs import SynthJob
from gdg.pipeline.shard import PairTask, ShardGroup, ShardTask, pair_key, shard_key

#: Share of a shard that is taken to pass before anything is known of a pair.
EXPECTED_YIELD = 0.5
_COUNTS = TypeAdapter(ShardCounts)


@dataclass(eq=False)
class PairState:
    """One hand-object pair: its shards on disk, those that are being made, and its end.

    Shards count in order of their number, and a pair's dataset is the shortest row of shards
    0, 1, … with its ``n`` passing grasps, so that the same command gives the same dataset whatever
    the workers, their timing and interruptions. A shard that is finished ahead of its turn waits
    under a hidden name, which no reader of datasets sees.

    Attributes:
        task: the pair, as workers get it.
        root: folder of the dataset.
        hand: the hand's name.
        object_name: the object's name.
        counts: of finished shards, by number.
        in_turn: how many shards, from 0, are finished without a gap.
        running: numbers of the shards that workers make.
        passed: passing grasps in those, the pair's dataset.
        made: what became of the candidates of this run.
        notes: what is worth telling of what was found on disk.
        ended: whether nothing more is to be made.
        reason: why it was given up, or "".
        error: the mistake or bug that ended it, if one did.
        timed_out: the shard that took too long, if one did.
        alone: whether its shards are made one at a time, since a group with one of them failed.
    """

    task: PairTask
    root: Path
    hand: str
    object_name: str
    counts: dict[int, ShardCounts] = field(default_factory=dict)
    in_turn: int = 0
    passed: int = 0
    running: set[int] = field(default_factory=set)
    made: ShardCounts = field(default_factory=ShardCounts)
    notes: list[str] = field(default_factory=list)
    ended: bool = False
    reason: str = ""
    error: BaseException | None = None
    timed_out: int | None = None
    alone: bool = False
    _give_up_at: int = 0

    @classmethod
    def open(cls, config: RunConfig) -> PairState:
        """The state in which earlier runs left a pair; only footers of its shards are read.

        Raises:
            GdgError: hand, object or protocol can't be found, or a manifest is malformed.
        """
        job: SynthJob = config.job
        task = PairTask(pair_key(config), config)
        hand = read_spec(HANDS.find(job.hand).path).name
        found = OBJECTS.find(job.object)
        object_name = found.name if found.path.is_file() else read_object_spec(found.path).name
        state = cls(task, Path(job.out), hand, object_name)
        state._find_shards()
        return state

    @property
    def job(self) -> SynthJob:
        """The pair's job."""
        return self.task.config.job

    def path(self, number: int) -> Path:
        """Where a shard lies."""
        return shard_path(self.root, self.hand, self.object_name, self._key(number))

    def waiting_path(self, number: int) -> Path:
        """Where a shard waits that was finished ahead of its turn."""
        return self.path(number).with_name(f".ahead-{self._key(number)}.parquet")

    def _key(self, number: int) -> str:
        return shard_key(self.task.key, number)

    def _find_shards(self) -> None:
        folder = self.path(0).parent
        names = {entry.name for entry in os.scandir(folder)} if folder.is_dir() else set()
        found = bool(names)
        for number in range(self.job.max_shards if found else 0):
            for path in (self.path(number), self.waiting_path(number)):
                if path.name in names and number not in self.counts:
                    self._count(number, path)
        # what lies in its place stays, whether or not this run would have made it
        while self.in_turn in self.counts and self.path(self.in_turn).name in names:
            self._next_turn()
        self._give_up_at = self.job.give_up_after + (self.in_turn if self.job.retry else 0)
        self._advance()

    def _count(self, number: int, path: Path) -> None:
        counts = read_counts(path)
        if counts is None:
            self.notes.append(f"{path}: is no readable shard; made again")
        else:
            self.counts[number] = counts

    def wanted(self) -> int:
        """How many more shards are worth starting now, beside those that run."""
        if self.ended:
            return 0
        if self.in_turn not in self.counts and self.in_turn not in self.running:
            return 1
        passed, finished = sum(c.passed for c in self.counts.values()), len(self.counts)
        expected = (passed + EXPECTED_YIELD * self.job.shard) / (finished + 1)
        needed = math.ceil(max(0, self.job.n - passed) / expected)
        if passed < self.job.give_up_below:
            needed = min(needed, self._give_up_at - finished)
        return min(needed, self.job.max_shards - finished) - len(self.running)

    def start(self) -> ShardTask:
        """The next shard, from now on running."""
        number = self.in_turn
        while number in self.counts or number in self.running:
            number += 1
        self.running.add(number)
        return ShardTask(self.task, number)

    def finish(self, number: int, data: bytes, counts: ShardCounts) -> None:
        """Writes a shard that a worker has made.

        Raises:
            OSError: it can't be written.
        """
        self.running.discard(number)
        in_turn = number == self.in_turn and not self.ended
        write_bytes(self.path(number) if in_turn else self.waiting_path(number), data)
        self.counts[number] = counts
        self.made = total([self.made, counts])
        self._advance()

    def retry_alone(self, number: int, why: BaseException) -> None:
        """Takes back a shard of a group that failed; it is made again by itself."""
        self.running.discard(number)
        if not self.alone:
            reason = " ".join(f"{type(why).__name__}: {why}".split())
            self.notes.append(f"made one shard at a time, since a batch failed: {reason}")
        self.alone = True

    def end(self, reason: str = "", error: BaseException | None = None) -> None:
        """Nothing more is made of this pair."""
        self.ended, self.reason, self.error = True, reason, error

    def _advance(self) -> None:
        """Puts finished shards in their place as their turn comes, until the pair ends."""
        while not self.ended:
            reason = self._given_up()
            if reason or self.passed >= self.job.n:
                self.end(reason)
            elif self.in_turn in self.counts:
                waiting = self.waiting_path(self.in_turn)
                if not self.path(self.in_turn).is_file():
                    os.replace(waiting, self.path(self.in_turn))
                self._next_turn()
            else:
                return

    def _next_turn(self) -> None:
        self.passed += self.counts[self.in_turn].passed
        self.in_turn += 1

    def _given_up(self) -> str:
        """Why the pair ends without its grasps, or ""."""
        passed, shards = self.passed, self.in_turn
        hopeless = shards >= self._give_up_at and passed < self.job.give_up_below
        if passed >= self.job.n or not (hopeless or shards >= self.job.max_shards):
            return ""
        counts = total(self.counts[number] for number in range(shards))
        found = f"{passed} of {self.job.n} grasps" if passed else "no grasp passed"
        loss = counts.commonest_loss()
        mostly = f"; mostly {loss}" if loss else ""
        plural = "shard" if shards == 1 else "shards"
        return f"{found} after {shards} {plural}, {counts.candidates} candidates{mostly}"


class Schedule:
    """Hands out shards of many pairs so that no worker waits while there is something to do.

    A worker stays with its pairs, which it has loaded, as long as these need more shards; then
    it gets pairs that nobody has begun; then it helps where most is left to do.

    Args:
        pairs: in the order in which they are begun.
        group: shards that a worker gets at once, at most. They are of pairs with one hand and the
            same settings, each of another pair while there are such, then further ones of these.
    """

    def __init__(self, pairs: Sequence[PairState], group: int = 1):
        self._pairs = {pair.task: pair for pair in pairs}
        self._fresh = deque(pair for pair in pairs if not pair.ended)
        self._begun: list[PairState] = []
        self._group = group
        self._companies = {pair.task: _company(pair.task.config) for pair in pairs if group > 1}

    def take(self, last: ShardGroup | None) -> ShardGroup | None:
        """The next shards for a worker that made ``last``, or None when there are none (yet)."""
        mine = [] if last is None else self.pairs_of(last)
        first = self._choose(mine)
        if first is None:
            return None
        tasks = [first.start()]
        if self._group > 1 and not first.alone:
            tasks += self._more(first, mine)
        return ShardGroup(tuple(tasks))

    def pairs_of(self, group: ShardGroup) -> list[PairState]:
        """The pair of each shard of a group that was taken here."""
        return [self._pairs[task.pair] for task in group.tasks]

    def _choose(self, mine: Sequence[PairState]) -> PairState | None:
        for pair in mine:
            if pair.wanted() > 0:
                return pair
        while self._fresh:
            pair = self._fresh.popleft()
            if pair.wanted() > 0:
                self._begun.append(pair)
                return pair
        self._begun = [pair for pair in self._begun if not pair.ended]
        most = max(self._begun, key=PairState.wanted, default=None)
        return most if most is not None and most.wanted() > 0 else None

    def _more(self, first: PairState, mine: Sequence[PairState]) -> Iterator[ShardTask]:
        """Shards that go along with one of ``first``; they are running once they are given."""
        together, room = [first], self._group - 1
        for pair in [*mine, *self._fresh, *sorted(self._begun, key=PairState.wanted)[::-1]]:
            if not room:
                return
            if pair.alone or pair in together or not self._suits(first, pair):
                continue
            if pair in self._fresh:
                self._fresh.remove(pair)
                self._begun.append(pair)
            together.append(pair)
            room -= 1
            yield pair.start()
        while room and (pair := max(together, key=PairState.wanted)).wanted() > 0:
            room -= 1
            yield pair.start()

    def _suits(self, first: PairState, other: PairState) -> bool:
        same = self._companies[first.task] == self._companies[other.task]
        return same and other.wanted() > 0


def _company(config: RunConfig) -> str:
    """What pairs have in common that are planned in one call: all but the object and the seed."""
    apart = ("object", "object_scale", "seed")
    return json.dumps({k: v for k, v in config.as_tree().items() if k not in apart}, sort_keys=True)


def read_counts(path: Path) -> ShardCounts | None:
    """The counts in a shard's footer, or None where the file is damaged or of another make.

    What passed is counted by the rows that it has, since a merge may have dropped some.
    """
    try:
        info = read_info(path)
        counts = _COUNTS.validate_python(vars(ShardCounts.from_dict(info.provenance)))
    except (GdgError, KeyError, ValidationError):
        return None
    passed = info.passed if info.count else 0
    return counts if passed is None else replace(counts, passed=passed)


def write_bytes(path: Path, data: bytes) -> None:
    """Writes a file so that it is complete or absent, even if the machine loses power.

    Raises:
        OSError: it can't be written.
    """
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def open_pairs(configs: Sequence[RunConfig]) -> Iterator[PairState | GdgError]:
    """Opens each pair once, however often it is named; mistakes come in their place."""
    seen: set[PairTask] = set()
    for config in configs:
        try:
            state = PairState.open(config)
        except GdgError as error:
            yield error
            continue
        if state.task not in seen:
            seen.add(state.task)
            yield state
