"""``gdg synth``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from gdg.cli.settings import configs_from, takes_settings
from gdg.pipeline.jobs import SYNTH_DEFAULTS, SynthJob
from gdg.yaml_files import read_yaml_mapping

#: Settings that may be lists in a config file, as a run's own ``config.yaml`` has them.
SPANNING = ("hand", "object")


@click.command()
@takes_settings(SynthJob, SYNTH_DEFAULTS)
def synth(settings: tuple[str, ...], files: tuple[Path, ...]) -> None:
    """Synthesise tested grasps for hands and objects (commas span the pairs).

    Shards are written whole; a run that was interrupted goes on where it stopped.
    """
    words = [*_spans_of(files, settings), *settings]
    configs = configs_from(SynthJob, SYNTH_DEFAULTS, files, words)
    from gdg.cli.synth_display import synth_display
    from gdg.pipeline.synth import run_synth

    with synth_display() as display:
        results, folder = run_synth(configs, display)
    total = sum(result.passed for result in results)
    new = sum(result.made.passed for result in results)
    click.echo(
        f"{total} grasps of {len(results)} pairs, {new} of them new, in {display.seconds:.0f} s "
        f"({new / max(display.seconds, 1e-9):.2f} per second): {folder}"
    )


def _spans_of(files: Sequence[Path], settings: Sequence[str]) -> list[str]:
    """Hands and objects that files list, as words; those that the user's words name win."""
    given = {word.partition("=")[0].strip() for word in settings}
    lists: dict[str, list[Any]] = {}
    for path in files:
        tree = read_yaml_mapping(path)
        for key in SPANNING:
            value = tree.get(key)
            if isinstance(value, list):
                lists[key] = value
            elif value is not None:
                lists.pop(key, None)
    # quoted: a path may hold commas
    return [
        f"{key}={','.join(json.dumps(str(value), ensure_ascii=False) for value in values)}"
        for key, values in lists.items()
        if key not in given
    ]
