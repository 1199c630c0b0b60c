"""What ``gdg synth`` shows on stderr."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from gdg.pipeline.synth import PairResult, Progress, Watcher
from gdg.text import one_line

#: Off a terminal a line is printed about this often, seconds.
LINE_S = 30.0


class SynthDisplay(Watcher):
    """Tells how ``gdg synth`` advances: live on a terminal, else in a line now and then.

    One line stays for every pair that has ended.
    """

    def __init__(self, console: Console, bar: Bar | None):
        self._console, self._bar = console, bar
        self._task = None if bar is None else bar.add_task("grasps", total=None, rest="")
        self._started = self._told = time.monotonic()
        self.seconds = 0.0

    def pair_ended(self, result: PairResult) -> None:
        """Prints the pair's line."""
        for note in result.notes:
            self._print(note)
        self._print(pair_line(result))

    def advanced(self, progress: Progress) -> None:
        """Moves the display; off a terminal, prints a line if the last is a while ago."""
        self.seconds = time.monotonic() - self._started
        if self._bar is not None and self._task is not None:
            all_of_them = progress.grasps + progress.missing
            self._bar.update(
                self._task,
                completed=progress.grasps,
                total=all_of_them or None,
                rest=progress_line(progress),
            )
        elif time.monotonic() - self._told > LINE_S:
            self._told = time.monotonic()
            self._print(f"{progress.grasps} grasps, {progress_line(progress)}")

    def _print(self, text: str) -> None:
        self._console.print(one_line(text), markup=False, highlight=False, soft_wrap=True)


def pair_line(result: PairResult) -> str:
    """What became of a pair, in one line."""
    made, new = result.made, ""
    if made.candidates:
        seconds = sum(made.seconds.values())
        new = (
            f" ({made.passed} new: {made.candidates} candidates, {made.planned} planned, "
            f"{made.tested} tested, {100 * made.success_rate:.0f} % passed, {seconds:.0f} s)"
        )
    note = f": {result.reason}" if result.reason else ""
    return f"{result.hand} · {result.object_name}: {result.passed} grasps{new}{note}"


def progress_line(progress: Progress) -> str:
    """Rates and what is left, in one line."""
    eta = "?" if progress.eta_s is None else clock(progress.eta_s)
    return (
        f"{progress.rate:.2f}/s, {100 * progress.made.success_rate:.0f} % of the tested passed, "
        f"pair {progress.ended} of {progress.pairs}, {clock(progress.seconds)} "
        f"gone, {eta} to go"
    )


def clock(seconds: float | None) -> str:
    """Seconds as ``h:mm:ss``."""
    whole = round(seconds or 0)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


@contextmanager
def synth_display() -> Iterator[SynthDisplay]:
    """The display of ``gdg synth`` on stderr."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield SynthDisplay(console, None)
        return
    columns = (BarColumn(), TextColumn("{task.completed} grasps, {task.fields[rest]}"))
    with Bar(*columns, console=console) as bar:
        yield SynthDisplay(console, bar)
