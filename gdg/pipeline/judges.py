"""Processes that get ready to test grasps while this one still plans them. Light."""

from __future__ import annotations

import pickle
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

if TYPE_CHECKING:
    from gdg.data.grasps import GraspSet
    from gdg.data.verdict import Verdict
    from gdg.kinds.fitter import Progress

    #: Tests the one grasp of a set under a protocol.
    Test = Callable[[GraspSet, Protocol], Verdict]


class Judges:
    """Processes for the grasps of one run, started at once and closed with its last verdict.

    Each loads the hand and the object and builds the simulator's world, on the CPU.

    Args:
        config: of a ``GraspJob``.
        count: how many processes.
    """

    def __init__(self, config: RunConfig, count: int):
        config = config.model_copy(update={"job": config.job.model_copy(update={"device": "cpu"})})
        self._judges: list[_Judge] = []
        # what can't be sent, or where the system gives no more processes, is tested in this one
        with suppress(OSError, pickle.PicklingError, AttributeError, TypeError):
            pickle.dumps(config)
            while len(self._judges) < count:
                self._judges.append(_Judge(config))

    @classmethod
    def of_job(cls, config: RunConfig) -> Judges:
        """As many as help: at most a core each, one while pictures are drawn or for four grasps.

        No process for a simulator that may test all grasps at once.
        """
        job: GraspJob = config.job
        if (
            job.verified
            or not job.simulate
            or not config.components["simulator"].options.one_by_one
        ):
            return cls(config, 0)
        cores = job.workers or usable_cores()
        return cls(config, min(cores - 1, max(int(job.picture), job.n // 4)))

    def __len__(self) -> int:
        return len(self._judges)

    def __enter__(self) -> Judges:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the processes, whatever they do."""
        for judge in self._judges:
            judge.process.kill()
        self._judges.clear()

    def verdicts(
        self,
        grasps: GraspSet,
        protocol: Protocol,
        test: Test,
        report: Progress,
        meanwhile: Callable[[], None],
    ) -> list[Verdict]:
        """One verdict per grasp, in order, whoever tested it; may be asked for once.

        Each grasp is tested by itself, so verdicts don't depend on who does. What a process that
        was killed has left is tested here, and so is everything as long as none is ready.

        Args:
            grasps: as the simulator takes them.
            protocol: the stability test.
            test: tests one grasp in this process.
            report: told how many verdicts there are, of how many; by one thread at a time.
            meanwhile: called here before this process tests, too.
        """
        share = _Share(grasps, protocol, report)
        for judge in self._judges:
            threading.Thread(target=judge.work, args=(share,), daemon=True).start()
        try:
            meanwhile()
            share.finish(test)
        finally:
            self.close()
        return share.verdicts()


class _Share:
    """Grasps that wait for a test, and the verdicts that are there."""

    def __init__(self, grasps: GraspSet, protocol: Protocol, report: Progress):
        self._grasps, self._protocol, self._report = grasps, protocol, report
        self._waiting, self._at_work = deque(range(len(grasps))), 0
        self._found: dict[int, Verdict] = {}
        self._error: Exception | None = None
        self._changed = threading.Condition()

    def work(self, test: Test) -> None:
        """Tests grasps until none waits, or the process that tests ends."""
        while (index := self._taken()) is not None:
            try:
                verdict = test(self._grasps.select([index]), self._protocol)
            except ProcessEnded:
                self._give_back(index)
                return
            except Exception as error:  # raised where the verdicts are asked for
                self._stop(error)
            else:
                self._keep(index, verdict)

    def finish(self, test: Test) -> None:
        """Tests grasps until all have a verdict, those of processes that end meanwhile, too."""
        while self._error is None and (self._waiting or self._at_work):
            self.work(test)
            with self._changed:
                self._changed.wait_for(lambda: self._error or self._waiting or not self._at_work)

    def verdicts(self) -> list[Verdict]:
        """All of them, or what a test raised."""
        if self._error is not None:
            raise self._error
        return [self._found[index] for index in range(len(self._grasps))]

    def _taken(self) -> int | None:
        with self._changed:
            if not self._waiting:
                return None
            self._at_work += 1
            return self._waiting.popleft()

    def _give_back(self, index: int) -> None:
        with self._changed:
            self._waiting.appendleft(index)
            self._ended()

    def _stop(self, error: Exception) -> None:
        with self._changed:
            self._waiting.clear()
            self._error = error
            self._ended()

    def _keep(self, index: int, verdict: Verdict) -> None:
        with self._changed:
            self._found[index] = verdict
            self._ended()
            self._report(len(self._found), len(self._grasps))

    def _ended(self) -> None:
        self._at_work -= 1
        self._changed.notify_all()


class _Judge:
    """One process."""

    def __init__(self, config: RunConfig):
        self.process = WorkerProcess(threads=1)
        self._config = config
        self.process.send(_get_ready, config)

    def work(self, share: _Share) -> None:
        """Tests grasps of a share, once the process has started and is ready."""
        with suppress(ProcessEnded):
            for _ in range(2):
                self.process.receive()
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
