"""Draws the picture of every bundled hand: ``hands/<name>/picture.png``.

python tools/render_hands.py            all hands
python tools/render_hands.py barrett    some of them
"""

from __future__ import annotations

import sys
from pathlib import Path

from gdg.hands.hand import load_hand
from gdg.report.hand_sheet import hand_picture
from gdg.testing.fixtures import model_of

HANDS = Path(__file__).resolve().parents[1] / "hands"
SURFACE_POINTS = 2000


def main(names: list[str]) -> None:
    """Draws the named hands, or all."""
    folders = sorted(manifest.parent for manifest in HANDS.glob("*/hand.yaml"))
    unknown = set(names) - {folder.name for folder in folders}
    if unknown:
        sys.exit(f"no such hand in {HANDS}: {', '.join(sorted(unknown))}")
    for folder in folders:
        if not names or folder.name in names:
            path = folder / "picture.png"
            hand_picture(model_of(load_hand(folder), SURFACE_POINTS), path)
            print(f"{path.relative_to(HANDS.parent)}: {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
