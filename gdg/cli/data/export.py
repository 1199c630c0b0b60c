"""``gdg data export``. Light: what it needs is imported when it runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gdg.cli.data.finding import finds_hands_and_objects, layouts_help, lookup_of
from gdg.data.layouts import LAYOUTS
from gdg.errors import GdgError

if TYPE_CHECKING:
    from gdg.data.dataset import ShardInfo
    from gdg.data.layouts.foreign import PairToExport
    from gdg.data.layouts.lookup import Lookup
    from gdg.hands.hand import Hand
    from gdg.kinds.distance import Distance
    from gdg.kinds.hand_model import HandModel

_HELP = """Write the grasps of the dataset in the folder PATH in another layout.

Only grasps that passed their test are written (all, where none was tested). What the layout has no
place for is told.
"""


@click.command("export", help=f"{_HELP}\n\b\nLayouts:\n\n{layouts_help()}")
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--layout", type=click.Choice(list(LAYOUTS)),
    help="Needed, unless --out ends with .parquet (compact).",
)  # fmt: skip
@click.option(
    "--out", required=True, type=click.Path(path_type=Path),
    help="Folder to write to; for compact, the file.",
)  # fmt: skip
@click.option("--only-hand", multiple=True, metavar="NAME", help="Only this hand; repeatable.")
@click.option("--failed-too", is_flag=True, help="Write grasps that failed their test, too.")
@click.option(
    "--distance", default="aligned", metavar="NAME[/PRESET]",
    help="cmap: the distance that contact maps are made with; default: aligned.",
)  # fmt: skip
@finds_hands_and_objects
def export(
    path: Path,
    layout: str | None,
    out: Path,
    only_hand: tuple[str, ...],
    failed_too: bool,
    distance: str,
    hands: tuple[str, ...],
    objects: tuple[str, ...],
    meshes: str,
) -> None:
    """Decides on the layout and writes it."""
    if layout is None and out.suffix == ".parquet":
        layout = "compact"
    if layout is None:
        raise GdgError(f"which layout? Write --layout {', '.join(LAYOUTS)}.")
    from gdg.data.layouts.exporting import chosen_shards

    if out.resolve().is_relative_to(path.resolve()):
        raise GdgError(f"--out {out}: is inside of the dataset {path}; write to another place.")
    lookup = lookup_of(hands, objects, meshes)
    chosen = chosen_shards(path, only_hand)
    if layout == "compact":
        _export_compact(chosen, out, failed_too)
        return
    if out.is_file():
        raise GdgError(f"--out {out}: is a file; give a folder.")
    _export(layout, chosen, lookup, out, failed_too, distance)


def _export_compact(chosen: list[ShardInfo], out: Path, failed_too: bool) -> None:
    from gdg.data.layouts.compact import write_compact
    from gdg.data.layouts.exporting import valid_grasps

    if out.is_dir() or out.suffix != ".parquet":
        raise GdgError(f"--out {out}: the compact layout is one file; write --out NAME.parquet.")
    if out.exists() and not _is_compact(out):
        raise GdgError(f"--out {out}: is there already and no compact file; give another name.")
    count = write_compact(out, ((info, valid_grasps(info, failed_too)) for info in chosen))
    size = out.stat().st_size
    click.echo(f"{count} grasps, {size / 1e6:.2f} MB ({size / count:.0f} bytes each): {out}")
    click.echo(
        "Not in the file, but computed anew by gdg data import: contact points, metrics, drive "
        "targets. Not in the file: energies, the planner's status, each verdict's pushes and lift."
    )


def _is_compact(path: Path) -> bool:
    """Whether a file is one that this command wrote, by its metadata alone."""
    import json

    import pyarrow.parquet as pq

    from gdg.data.layouts.compact import METADATA_KEY, SCHEMA
    from gdg.data.shards import UNREADABLE

    try:
        stored = pq.read_metadata(path).metadata or {}
        header = json.loads(stored.get(METADATA_KEY, b"null"))
    except UNREADABLE:
        return False
    return isinstance(header, dict) and header.get("schema") == SCHEMA


def _export(
    layout: str,
    chosen: list[ShardInfo],
    lookup: Lookup,
    out: Path,
    failed_too: bool,
    distance: str,
) -> None:
    from gdg.data.layouts.dexgraspnet import write_dexgraspnet
    from gdg.data.layouts.exporting import dropped_fields, pairs_to_export
    from gdg.data.layouts.multidex import write_multidex

    metric = _distance(distance) if layout == "cmap" else None
    pairs = pairs_to_export(chosen, lookup, failed_too)
    writers: dict[str, Callable[[], list[Path]]] = {
        "multidex": lambda: write_multidex(pairs, out),
        "dexgraspnet": lambda: write_dexgraspnet(pairs, out),
        "cmap": lambda: _write_cmap(pairs, lookup, out, metric),
    }
    written = writers[layout]()
    count = sum(len(pair.grasps) for pair in pairs)
    click.echo(f"{count} grasps in {len(written)} files: {out}")
    dropped = dropped_fields(pairs, ("energies",) if layout == "dexgraspnet" else ())
    click.echo(f"The layout has no place for, so left out: {dropped}.")
    for name, root in dict.fromkeys((p.hand.name, p.hand.spec.root_link) for p in pairs):
        click.echo(f"Poses of '{name}' are of its root link '{root}'.")


def _write_cmap(
    pairs: list[PairToExport], lookup: Lookup, out: Path, metric: Distance | None
) -> list[Path]:
    from gdg.data.layouts.cmap import write_cmap
    from gdg.data.layouts.exporting import contact_maps_for

    assert metric is not None
    maps = contact_maps_for(metric, _models(), lookup)
    return write_cmap(pairs, out, maps, metric.label)


def _models() -> Callable[[Hand], HandModel]:
    """Makes the tensors of each hand once."""
    import torch

    from gdg.pipeline.jobs import DEFAULTS
    from gdg.registry import get_registry

    record = get_registry().find("hand-model", DEFAULTS["hand_model"])
    made: dict[str, HandModel] = {}

    def model(hand: Hand) -> HandModel:
        if hand.content_hash not in made:
            device = torch.device("cpu")
            made[hand.content_hash] = record.load()(record.options(), hand, device)
        return made[hand.content_hash]

    return model


def _distance(word: str) -> Distance:
    """The distance that ``aligned`` or ``aligned/paper`` means."""
    from gdg.registry import get_registry
    from gdg.validation import validated

    name, _, preset = word.partition("/")
    record = get_registry().find("distance", name)
    options = {"preset": preset} if preset else {}
    return record.load()(validated(record.options, options, f"--distance {word}"))
