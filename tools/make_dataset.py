"""Makes the grasp dataset that gdg's own networks are trained on; one command, resumable.

    python tools/make_dataset.py OUT [--published FOLDER] [setting=value ...]

It is ``gdg synth`` with five bundled hands and every bundled train object. FOLDER holds the 58
meshes that GenDexGrasp used (``splits.json`` and ``objects.json`` with ``file`` per name); its 48
train objects join under their published names (``contactdb+banana``). Test objects are never
touched. Settings go to ``gdg synth`` after the recipe's own, so they win. See docs/dataset.md.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

from gdg.cli.synth import synth

HANDS = ("allegro", "shadowhand", "barrett", "ezgripper", "robotiq_3finger")
RECIPE = ("n=64", "shard=64", "max_shards=8", "simulator.trials=decisive", "seed=0")


def main() -> None:
    """Links the published meshes under their names, and runs ``gdg synth``."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--published", type=Path)
    parser.add_argument("settings", nargs="*")
    given = parser.parse_intermixed_args()
    objects = ["train"]
    if given.published is not None:
        objects += link_published(given.published, given.out.with_name(given.out.name + "-meshes"))
    words = (f"hand={','.join(HANDS)}", f"object={','.join(objects)}", f"out={given.out}")
    synth([*words, *RECIPE, *given.settings])


def link_published(source: Path, folder: Path) -> list[str]:
    """Links the train meshes of ``source`` in ``folder``, where gdg will find them by name."""
    names = json.loads((source / "splits.json").read_text())["train"]
    files = json.loads((source / "objects.json").read_text())
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        mesh = (source / files[name]["file"]).resolve()
        link = folder / f"{name}{mesh.suffix}"
        if not link.is_symlink():
            link.symlink_to(mesh)
    os.environ["GDG_OBJECTS_PATH"] = str(folder.resolve())
    return names


if __name__ == "__main__":
    main()
