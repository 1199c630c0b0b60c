"""Prints the tables of a dataset and draws its pictures; refreshes docs/dataset.md.

    python docs/figures/dataset.py RUN_FOLDER [--write] [--no-pictures]

RUN_FOLDER is what ``tools/make_dataset.py`` wrote, finished or not. Pictures go to docs/images;
``--write`` puts the tables between the two marks in docs/dataset.md. Published meshes are found
in RUN_FOLDER-meshes, where the recipe links them.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path

from dataset_pictures import draw_pictures
from dataset_statistics import STAGES, PairFacts, hands_of, read_pairs, tables
from pages import write_tables

from gdg.data.info import dataset_info
from gdg.data.shards import shard_files

DOCS = Path(__file__).resolve().parents[1]
PAGE, IMAGES = DOCS / "dataset.md", DOCS / "images"


def main() -> None:
    """Reads, prints, writes, draws."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", action="store_true", help="put the tables into docs/dataset.md")
    parser.add_argument("--no-pictures", action="store_true")
    parser.add_argument("--images", type=Path, default=IMAGES)
    given = parser.parse_args()
    meshes = given.folder.resolve().with_name(given.folder.resolve().name + "-meshes")
    if meshes.is_dir():
        os.environ.setdefault("GDG_OBJECTS_PATH", str(meshes))
    pairs = read_pairs(given.folder)
    text = f"{summary(given.folder, pairs)}\n\n{tables(pairs)}"
    print(text)
    if given.write:
        write_tables(PAGE, text)
    if not given.no_pictures:
        for path in draw_pictures(pairs, given.images):
            print(f"{path.name}: {path.stat().st_size // 1000} kB")


def summary(folder: Path, pairs: Sequence[PairFacts]) -> str:
    """One paragraph: how much there is, and what it took."""
    found = dataset_info(folder).total()
    seconds = sum(pair.counts.seconds.get(stage, 0.0) for pair in pairs for stage in STAGES)
    return (
        f"{sum(map(len, pairs)):,} passing grasps of {len(hands_of(pairs))} hands on "
        f"{len({pair.object_name for pair in pairs})} objects ({len(pairs)} pairs) in "
        f"{found.shards:,} shards, {found.bytes / 1e6:.1f} MB; {seconds / 3600:.1f} hours of one "
        f"worker{_written(folder)}. Tables of {time.strftime('%Y-%m-%d')}."
    )


def _written(folder: Path) -> str:
    """How long the writing took, pauses included; "" for a copy, whose times say nothing."""
    times = [path.stat().st_mtime for path in shard_files(folder)]
    if not (folder / "synth.json").is_file():
        return ""
    return f", {(max(times) - min(times)) / 3600:.1f} hours from the first shard to the last"


if __name__ == "__main__":
    main()
