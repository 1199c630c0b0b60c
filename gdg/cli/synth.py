"""``gdg synth``."""

from __future__ import annotations

from pathlib import Path

import click

from gdg.cli.settings import configs_from, takes_settings
from gdg.pipeline.jobs import SYNTH_DEFAULTS, SynthJob


@click.command()
@takes_settings(SynthJob, SYNTH_DEFAULTS)
def synth(settings: tuple[str, ...], files: tuple[Path, ...]) -> None:
    """Synthesise tested grasps for hands and objects (commas span the pairs).

    Shards are written whole; a run that was interrupted goes on where it stopped.
    """
    configs = configs_from(SynthJob, SYNTH_DEFAULTS, files, settings)
    import time

    from rich.console import Console

    from gdg.cli.progress import bars
    from gdg.pipeline.synth import PairResult, run_synth

    console, started, count = Console(), time.perf_counter(), 0
    with bars() as progress:
        task = progress.add_task("pairs", total=len(configs))

        def report(result: PairResult) -> None:
            nonlocal count
            count += result.passed
            rate = f"{result.passed} grasps, {result.tested} tested, {result.candidates} candidates"
            note = f": {result.reason}" if result.reason else ""
            progress.console.print(f"{result.hand} · {result.object_name}: {rate}{note}")
            progress.advance(task)

        results, folder = run_synth(configs, report)
    seconds = time.perf_counter() - started
    total = sum(result.passed for result in results)
    console.print(f"{total} grasps of {len(results)} pairs in {seconds:.0f} s: {folder}")
