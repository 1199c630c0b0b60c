"""Layouts in which others publish grasps, and gdg's compact one. Light: imports no torch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gdg.errors import GdgError

#: Layout -> what its files hold.
LAYOUTS = {
    "multidex": (
        "MultiDex: HAND/HAND.pt with 'info' and 'metadata', a list of (q, object, hand); q is the "
        "root's translation (3), the first two columns of its rotation (6) and the joints in the "
        "order of the URDF's chain. No verdicts."
    ),
    "cmap": (
        "CMapDataset: cmap_dataset.pt with a list of (contact map, q, object, hand), "
        "object_point_clouds.pt, split_train_validate_objects.json. Also read: the lists of "
        "(q, object, hand) with Euler angles that D(R,O) made of it."
    ),
    "dexgraspnet": (
        "DexGraspNet: OBJECT.npy per object, a list of dictionaries with 'qpos' (joints by name, "
        "the root as WRJTx… and Euler angles WRJRx…), 'scale' of the mesh, energies. One hand, "
        "which the files do not name. No verdicts."
    ),
    "compact": (
        "gdg's own: every valid grasp of a dataset in one Parquet file with a summary of its "
        "verdict, about 80 bytes each; importing it measures the grasps anew."
    ),
}
MULTIDEX_NAMES = "robot_object_names.json"
CMAP_FILE = "cmap_dataset.pt"
CLOUDS_FILE = "object_point_clouds.pt"
SPLIT_FILE = "split_train_validate_objects.json"


def detect_layout(paths: Sequence[Path]) -> str:
    """The layout that files or a folder obviously have, by their names.

    Raises:
        GdgError: they could be of several layouts, or of none.
    """
    found = {_layout_of(path) for path in paths}
    if len(found) == 1:
        return found.pop()
    raise GdgError(
        f"the files have different layouts ({', '.join(sorted(found))}); import them one by one."
    )


def _layout_of(path: Path) -> str:
    names = {path.name}
    if path.is_dir():
        names = {file.name for file in (*path.iterdir(), *path.glob("*/*.pt"))}
    suffixes = {Path(name).suffix for name in names}
    if CMAP_FILE in names:
        return "cmap"
    for suffix, layout in ((".npy", "dexgraspnet"), (".pt", "multidex"), (".parquet", "compact")):
        if suffix in suffixes:
            return layout
    raise GdgError(
        f"{path}: gdg can't tell its layout; write --layout {' or '.join(LAYOUTS)} "
        f"(see gdg data import --help)."
    )
