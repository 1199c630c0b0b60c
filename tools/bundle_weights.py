"""Puts trained weights and their cards into the plugins that they belong to.

    python tools/bundle_weights.py runs/weights

Takes every finished run COMPONENT-NAME of the folder whose component has a plugin here
(``flow-full``, ``graspcvae-shadowhand``) and writes ``plugins/…_COMPONENT/weights/NAME``.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

PLUGINS = Path(__file__).resolve().parents[1] / "plugins"
#: The line of a card that shows a picture, which is not bundled.
CURVES = "![Learning curves](curves.png)\n\n"


def main() -> None:
    """Copies what is finished, and says what."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", type=Path, help="folder with the runs of gdg train")
    for run in sorted(parser.parse_args().runs.iterdir()):
        component, _, name = run.name.partition("-")
        plugins = list(PLUGINS.glob(f"*_{component}"))
        model = run / "model.safetensors"
        if len(plugins) != 1 or not model.is_file():
            continue
        folder = plugins[0] / "weights"
        folder.mkdir(exist_ok=True)
        shutil.copyfile(model, folder / f"{name}.safetensors")
        card = (run / "model_card.md").read_text(encoding="utf-8")
        (folder / f"{name}.md").write_text(card.replace(CURVES, ""), encoding="utf-8")
        print(f"{folder / name}.safetensors: {model.stat().st_size / 2**20:.1f} MB")


if __name__ == "__main__":
    main()
