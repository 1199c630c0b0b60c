"""A process of this machine that calls functions for this one, and ends with it."""

from __future__ import annotations

import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.resource_tracker import ensure_running
from typing import Any

from gdg.engine.answer import answer
from gdg.engine.threads import limit_threads
from gdg.garbage import look_rarely


class ProcessEnded(Exception):
    """A worker process is gone; says how it ended."""


class WorkerProcess:
    """A spawned process that calls one function after the other.

    It ends with this process, however that ends, and leaves Ctrl-C to it.

    Args:
        threads: that it may use.

    Attributes:
        connection: readable when there is something to receive.
    """

    def __init__(self, threads: int):
        context = get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, threads), daemon=True)
        if hasattr(signal, "pthread_sigmask"):
            ensure_running()  # whose start would let Ctrl-C through to the first process
        with _no_interrupt():
            self._process.start()
        theirs.close()  # so that ours ends when the worker does

    def send(self, function: Callable[[Any], Any], task: Any) -> None:
        """Has it call a function that is importable by its name; what became of it is received."""
        data = pickle.dumps((function, task))
        with suppress(OSError):  # it died: the end of its connection says so
            self.connection.send_bytes(data)

    def receive(self) -> bytes:
        """Waits for the next message: b"" once it has started, then an ``answer`` per call.

        Raises:
            ProcessEnded: there won't be one.
        """
        try:
            return self.connection.recv_bytes()
        except (EOFError, OSError):
            self._process.join()
            raise ProcessEnded(_end_of(self._process.exitcode)) from None

    def kill(self) -> None:
        """Ends it at once, if it still runs."""
        self._process.kill()
        self._process.join()
        self.connection.close()


def _serve(connection: Connection, threads: int) -> None:
    """The life of a worker process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers itself
    threading.Thread(target=_end_with_parent, daemon=True).start()
    look_rarely()
    limit_threads(threads)
    connection.send_bytes(b"")
    while True:
        try:
            connection.send_bytes(answer(_called, connection.recv_bytes()))
        except (EOFError, OSError):
            return  # the parent is gone


def _called(message: bytes) -> Any:
    function, task = pickle.loads(message)
    return function(task)


def _end_with_parent() -> None:
    """Ends this process at once when its parent is gone, whatever it computes."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _end_of(code: int | None) -> str:
    """How a process ended, in words."""
    if code is not None and code < 0:
        try:
            return signal.Signals(-code).name
        except ValueError:
            return f"signal {-code}"
    return f"exit code {code}"


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Holds Ctrl-C back from this thread, and from processes that are started meanwhile."""
    mask = getattr(signal, "pthread_sigmask", None)
    if mask is None:
        yield
        return
    before = mask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        mask(signal.SIG_SETMASK, before)
