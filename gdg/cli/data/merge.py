"""``gdg data merge``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("merge")
@click.argument("paths", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of the union.")
def merge(paths: tuple[Path, ...], out: Path) -> None:
    """Unite the datasets in PATHS; every grasp is kept once.

    Files appear whole or not at all, and a merge that was interrupted goes on where it stopped.
    """
    from gdg.cli.progress import bars
    from gdg.data.merge import merge_datasets

    with bars() as progress:
        task = progress.add_task("shards", total=None)
        done = merge_datasets(
            paths, out, lambda count, total: progress.update(task, completed=count, total=total)
        )
    notes = (
        (done.present, "there already"),
        (done.repeated, "in several inputs"),
    )
    listed = "".join(f", {count} shards {what}" for count, what in notes if count)
    click.echo(
        f"{done.shards} shards with {done.grasps} grasps written{listed}; {done.dropped} duplicate "
        f"grasps dropped: {out}"
    )
