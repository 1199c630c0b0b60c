"""``gdg data import``. Light: what it needs is imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import gdg.data
from gdg.cli.data.finding import finds_hands_and_objects, layouts_help, lookup_of
from gdg.data.layouts import LAYOUTS, detect_layout
from gdg.errors import GdgError, raise_if_any

if TYPE_CHECKING:
    from gdg.data.layouts.lookup import Lookup

#: The word for the compact file that comes with gdg, and that file.
BUNDLED, BUNDLED_FILE = "bundled", Path(gdg.data.__path__[0]) / "bundled" / "grasps.parquet"
#: A file of many objects may give as many notes.
MAX_NOTES = 20
_HELP = """Make a gdg dataset of FILES (or folders of them) in another layout.

A hand must be the one that the files were made with: joints are matched by name where the files
name them (for the five hands of MultiDex gdg knows the names), otherwise taken in the order of the
chain, and poses are of the hand's root link. Hands and objects that are not found are listed at the
end (exit code 2); everything else is imported. The same command again goes on where it stopped.
Files are never run: what holds more than numbers and names is refused. The word "bundled" stands
for the compact file of tested grasps that comes with gdg.
"""


class _Files(click.Path):
    """An existing path, or the word for the bundled file."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return BUNDLED_FILE if value == BUNDLED else super().convert(value, param, ctx)


@click.command("import", help=f"{_HELP}\n\b\nLayouts:\n\n{layouts_help()}")
@click.argument(
    "files", nargs=-1, required=True, type=_Files(exists=True, path_type=Path), metavar="FILES"
)
@click.option("--layout", type=click.Choice(list(LAYOUTS)), help="By default told by the names.")
@click.option(
    "--out", required=True, type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the dataset.",
)  # fmt: skip
@finds_hands_and_objects
@click.option(
    "--own-order", is_flag=True,
    help="multidex, cmap: take the joints of the five MultiDex hands in the order of your folder's "
    "chain, whatever their names.",
)  # fmt: skip
@click.option("--simulate", is_flag=True, help="compact: test the grasps again, in simulation.")
@click.option(
    "--accept-changed", is_flag=True,
    help="compact: use a hand or object that has changed since; stored verdicts are dropped.",
)  # fmt: skip
@click.option("--workers", type=click.IntRange(1, 256), default=1, help="compact: processes.")
def import_(
    files: tuple[Path, ...],
    layout: str | None,
    out: Path,
    hands: tuple[str, ...],
    objects: tuple[str, ...],
    meshes: str,
    own_order: bool,
    simulate: bool,
    accept_changed: bool,
    workers: int,
) -> None:
    """Decides on the layout and runs its import."""
    chosen = layout or detect_layout(files)
    for given, name, where in (
        (own_order, "--own-order", ("multidex", "cmap")),
        (simulate, "--simulate", ("compact",)),
        (accept_changed, "--accept-changed", ("compact",)),
        (workers > 1, "--workers", ("compact",)),
    ):
        if given and chosen not in where:
            raise GdgError(f"{name}: is an option of the layout {' and '.join(where)} only.")
    lookup = lookup_of(hands, objects, meshes)
    if chosen == "compact":
        _rebuild(files, out, lookup, simulate, accept_changed, workers)
    else:
        _import(chosen, files, out, lookup, own_order)


def _import(layout: str, files: tuple[Path, ...], out: Path, lookup: Lookup, own: bool) -> None:
    from gdg.cli.progress import bars
    from gdg.data.layouts.cmap import read_cmap
    from gdg.data.layouts.dexgraspnet import read_dexgraspnet
    from gdg.data.layouts.importing import import_grasps
    from gdg.data.layouts.multidex import read_multidex

    readers = {
        "multidex": lambda path: read_multidex(path, own),
        "cmap": lambda path: read_cmap(path, own),
        "dexgraspnet": read_dexgraspnet,
    }
    sets, unreadable = [], []
    for file in files:
        try:
            sets += readers[layout](file)
        except GdgError as error:
            unreadable.append(str(error))
    with bars() as progress:
        task = progress.add_task("pairs", total=len(sets))
        report = import_grasps(
            layout, sets, lookup, out, lambda done, _: progress.update(task, completed=done)
        )
    _print_notes(report.notes)
    if report.pairs:
        click.echo(f"{report.grasps} grasps of {report.pairs} pairs imported: {out}")
    raise_if_any([*unreadable, *report.skipped])


def _print_notes(notes: list[str]) -> None:
    for note in notes[:MAX_NOTES]:
        click.echo(f"Note: {note}")
    if len(notes) > MAX_NOTES:
        click.echo(f"Note: and {len(notes) - MAX_NOTES} more of this kind.")


def _rebuild(
    files: tuple[Path, ...],
    out: Path,
    lookup: Lookup,
    simulate: bool,
    accept_changed: bool,
    workers: int,
) -> None:
    from gdg.cli.progress import bars
    from gdg.pipeline.rebuild import RebuildResult, rebuild_dataset, skipped

    results: list[RebuildResult] = []
    with bars() as progress:
        for file in files:
            task = progress.add_task(file.name, total=None)

            def report(done: int, total: int, _: RebuildResult, task: int = task) -> None:
                progress.update(task, completed=done, total=total)  # type: ignore[arg-type]

            results += rebuild_dataset(file, out, lookup, simulate, accept_changed, workers, report)
    _print_notes(list(dict.fromkeys(note for result in results for note in result.notes)))
    made = [result for result in results if not result.reason]
    if made:
        found = sum(result.found for result in made)
        already = f", {found} of them there already" if found else ""
        tested = ""
        if simulate:
            tested = f", {sum(result.passed for result in made)} pass again"
        count = sum(result.count for result in made)
        click.echo(f"{count} grasps of {len(made)} pairs rebuilt{already}{tested}: {out}")
    raise_if_any(skipped(results))
