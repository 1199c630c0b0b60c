"""Makes the grasp dataset that gdg's own networks are trained on; one command, resumable.

    python tools/make_dataset.py OUT [--published FOLDER] [setting=value ...]

It is ``gdg synth`` with five bundled hands and every bundled train object. FOLDER holds the 58
meshes that GenDexGrasp used (``splits.json`` and ``objects.json`` with ``file`` per name); its 48
train objects join under their published names (``contactdb+banana``), by links in OUT-meshes. Test
objects are never touched. Settings go to ``gdg synth`` after the recipe's own, so they win:

    python tools/make_dataset.py runs/dataset hand=barrett workers=8

Run the same command again after anything: it goes on where it stopped. See docs/dataset.md.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from gdg.cli import main as gdg
from gdg.errors import GdgError

HANDS = ("allegro", "shadowhand", "barrett", "ezgripper", "robotiq_3finger")
RECIPE = ("n=64", "shard=64", "max_shards=8", "simulator.trials=decisive", "seed=0")
#: Where gdg looks for objects beside its own.
VARIABLE = "GDG_OBJECTS_PATH"


def main() -> None:
    """Links the published meshes under their names, and runs ``gdg synth``."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path, help="folder of the dataset")
    parser.add_argument("--published", type=Path, metavar="FOLDER", help="the published meshes")
    parser.add_argument("settings", nargs="*", help="of gdg synth, key=value")
    given = parser.parse_intermixed_args()
    if wrong := [word for word in given.settings if "=" not in word]:
        parser.error(f"'{wrong[0]}': settings are written key=value")
    objects = ["train"]
    if given.published is not None:
        folder = given.out.with_name(f"{given.out.name}-meshes").resolve()
        try:
            objects += link_published(given.published, folder)
        except GdgError as error:
            parser.error(str(error))
        os.environ[VARIABLE] = os.pathsep.join(filter(None, [str(folder), os.getenv(VARIABLE)]))
    words = (f"hand={','.join(HANDS)}", f"object={','.join(objects)}", f"out={given.out}")
    sys.argv = ["gdg", "synth", *words, *RECIPE, *given.settings]
    gdg()


def link_published(source: Path, folder: Path) -> list[str]:
    """Links the train meshes of ``source`` in ``folder``, where gdg finds them by name.

    Raises:
        GdgError: ``source`` is not laid out as described above.
    """
    try:
        names = json.loads((source / "splits.json").read_text(encoding="utf-8"))["train"]
        files = json.loads((source / "objects.json").read_text(encoding="utf-8"))
        meshes = {name: (source / files[name]["file"]).resolve(strict=True) for name in names}
    except OSError as error:
        raise GdgError(f"--published {source}: {error.filename}: {error.strerror}") from error
    except (ValueError, LookupError, TypeError) as error:
        raise GdgError(
            f"--published {source}: splits.json or objects.json is malformed: {error!r}"
        ) from error
    folder.mkdir(parents=True, exist_ok=True)
    for name, mesh in meshes.items():
        link = folder / f"{name}{mesh.suffix}"
        if not link.is_symlink() or link.resolve() != mesh:
            link.unlink(missing_ok=True)
            link.symlink_to(mesh)
    return names


if __name__ == "__main__":
    main()
