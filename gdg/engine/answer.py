"""How a worker calls the function: what it returned or raised, as bytes that travel."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable
from typing import Any

from gdg.errors import GdgError


class WorkerTraceback(Exception):
    """The traceback of an exception that was raised in a worker, as text."""

    def __str__(self) -> str:
        return f'\n"""\n{self.args[0]}"""'


def answer(function: Callable[[Any], Any], task: Any) -> bytes:
    """Calls the function, and packs its result or its exception.

    A bug in one task must not end the run that thousands of others share, so every exception is
    caught here; it is raised in the process that asked.
    """
    try:
        return pickle.dumps((function(task), None, ""))
    except GdgError as error:
        # its subclasses' arguments don't travel
        return pickle.dumps((None, GdgError(str(error)), ""))
    except Exception as error:
        return pickle.dumps((None, _travelling(error), traceback.format_exc()))


def unpacked(data: bytes) -> tuple[Any, BaseException | None]:
    """The inverse of ``answer``: (result, exception or None)."""
    result, error, trace = pickle.loads(data)
    if error is not None and trace:
        error.__cause__ = WorkerTraceback(trace)
    return result, error


def _travelling(error: Exception) -> Exception:
    """The exception, or one that says the same where its class can't be packed."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever a foreign class raises there
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
