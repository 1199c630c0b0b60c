"""``gdg data split``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("split")
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="The lock file, NAME.lock.yaml."
)
@click.option("--name", help="Name of the split; default: that of the file.")
@click.option("--held-out-hand", "held_out", metavar="HAND", multiple=True, help="May be repeated.")
@click.option(
    "--validation",
    type=click.FloatRange(0, 1, max_open=True),
    default=0.1,
    show_default=True,
    help="Share of the train objects that choose the best epoch.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
def split(
    path: Path, out: Path, name: str | None, held_out: tuple[str, ...], validation: float, seed: int
) -> None:
    """Write a lock file that divides the objects and hands of the dataset in PATH.

    Test objects of the catalogue are always test objects. gdg train split=FILE keeps to it, by
    names and by contents.
    """
    from gdg.data.shards import shards
    from gdg.splits import SUFFIX, save_split
    from gdg.splits.make import make_split

    chosen = name or out.name.removesuffix(SUFFIX).removesuffix(".yaml").removesuffix(".yml")
    found = shards(path)
    lock = make_split(found, chosen, held_out=held_out, validation=validation, seed=seed)
    save_split(lock, out)
    objects, hands = lock.objects, lock.hands
    click.echo(
        f"{out}: objects {len(objects.train)} train, {len(objects.validation)} validation, "
        f"{len(objects.test)} test; hands {len(hands.train)} train, {len(hands.held_out)} held out"
    )
    click.echo(f"Use it: gdg train data={path} split={out}")
