"""Processes that get ready to test grasps while this one still plans them. Light."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from gdg.config import RunConfig
from gdg.engine.answer import unpacked
from gdg.engine.process import ProcessEnded, WorkerProcess
from gdg.engine.threads import usable_cores
from gdg.pipeline.jobs import GraspJob
from gdg.protocols import Protocol, load_protocol
from gdg.simulation.options import SimulatorOptions

if TYPE_CHECKING:
    from gdg.data.grasps import GraspSet
    from gdg.data.verdict import Verdict
    from gdg.kinds.fitter import Progress

    #: Tests the one grasp of a set under a protocol.
    Test = Callable[[GraspSet, Protocol], Verdict]


class Judges:
    """Processes for the grasps of one run, started at once; to be closed at the end.

    Each loads the hand and the object and builds the simulator's world, on cores that planning
    leaves free as it starts.

    Args:
        config: of a ``GraspJob``.
        count: how many processes.
    """

    def __init__(self, config: RunConfig, count: int):
        self._judges = [_Judge(config) for _ in range(count)]

    @classmethod
    def of_job(cls, config: RunConfig) -> Judges:
        """As many as help: a core each, at most one for every two things to do at the end.

        None for a simulator of another make than ours: it may test all grasps at once.
        """
        job: GraspJob = config.job
        one_by_one = isinstance(config.components["simulator"].options, SimulatorOptions)
        if job.verified or not job.simulate or not one_by_one:
            return cls(config, 0)
        cores = job.workers or usable_cores()
        return cls(config, min(cores - 1, (job.n + job.picture) // 2))

    def __len__(self) -> int:
        return len(self._judges)

    def __enter__(self) -> Judges:
        return self

    def __exit__(self, *_: object) -> None:
        for judge in self._judges:
            judge.process.kill()

    def verdicts(
        self,
        grasps: GraspSet,
        protocol: Protocol,
        test: Test,
        report: Progress,
        meanwhile: Callable[[], None],
    ) -> list[Verdict]:
        """One verdict per grasp, in order, whoever tested it.

        Each grasp is tested by itself, so verdicts don't depend on who does. What a process that
        was killed has left is tested here.

        Args:
            grasps: as the simulator takes them.
            protocol: the stability test.
            test: tests one grasp in this process.
            report: told how many verdicts there are, of how many.
            meanwhile: called here before this process tests, too.
        """
        share = _Share(grasps, protocol, report)
        threads = [
            threading.Thread(target=judge.work, args=(share,), daemon=True)
            for judge in self._judges
        ]
        for thread in threads:
            thread.start()
        meanwhile()
        share.work(test)
        for thread in threads:
            thread.join()
        share.work(test)
        return share.verdicts()


class _Share:
    """Grasps that wait for a test, and the verdicts that are there."""

    def __init__(self, grasps: GraspSet, protocol: Protocol, report: Progress):
        self._grasps, self._protocol, self._report = grasps, protocol, report
        self._waiting = deque(range(len(grasps)))
        self._found: dict[int, Verdict] = {}
        self._error: Exception | None = None

    def work(self, test: Test) -> None:
        """Tests grasps until none waits."""
        while self._error is None:
            try:
                index = self._waiting.popleft()
            except IndexError:
                return
            try:
                self._found[index] = test(self._grasps.select([index]), self._protocol)
            except ProcessEnded:
                self._waiting.appendleft(index)
                return
            except Exception as error:
                self._error = error
            else:
                self._report(len(self._found), len(self._grasps))

    def verdicts(self) -> list[Verdict]:
        """All of them, or what a test raised."""
        if self._error is not None:
            raise self._error
        return [self._found[index] for index in range(len(self._grasps))]


class _Judge:
    """One process."""

    def __init__(self, config: RunConfig):
        self.process = WorkerProcess(threads=1)
        self._config, self._unread = config, 2  # that it has started, and that it is ready
        self.process.send(_get_ready, config)

    def work(self, share: _Share) -> None:
        """Tests grasps of a share, once the process is ready."""
        with suppress(ProcessEnded):
            while self._unread:
                self.process.receive()
                self._unread -= 1
            share.work(self._test)

    def _test(self, grasp: GraspSet, protocol: Protocol) -> Verdict:
        self.process.send(_tested, (self._config, grasp, protocol))
        verdict, error = unpacked(self.process.receive())
        if error is not None:
            raise error
        return verdict


def _get_ready(config: RunConfig) -> None:
    """Loads everything; what is wrong is told by the process that plans."""
    from gdg.pipeline.kept_pair import kept_pair

    pair, protocol = kept_pair(config), load_protocol(config.job.protocol)
    pair.components.get("simulator").get_ready(pair.hand, pair.obj, protocol)


def _tested(task: tuple[RunConfig, GraspSet, Protocol]) -> Verdict:
    """The verdict of the one grasp of a set."""
    from gdg.pipeline.kept_pair import kept_pair

    config, grasp, protocol = task
    pair = kept_pair(config)
    return pair.components.get("simulator").simulate(pair.hand, pair.obj, grasp, protocol)[0]
