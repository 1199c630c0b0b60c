"""The model card: what was trained, on what, and how well it reconstructs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_CARD = """\
# {name}

Contact-map generator `{generator}`, trained by gdg {gdg_version} on maps of the distance
`{distance}`. Use it with `generator={generator} generator.weights=<path of the .safetensors file>`.

| training | |
|---|---|
| hands | {hands} |
| held-out hands | {held_out_hands} |
| split | {split}{split_hash} |
| train objects ({train_object_count}) | {train_objects} |
| validation objects ({validation_object_count}) | {validation_objects} |
| maps, train / validation | {train_maps} / {validation_maps} |
| epochs trained / exported | {epochs} / {exported_epoch} (`keep={keep}`) |
| batch, learning rate, seed | {batch}, {learning_rate:g}, {seed} |
| points per item | {points} |
| wall time of the last fit | {seconds:.0f} s on {device} |
| data (SHA-256) | `{data_sha256}` |

Reconstruction error on the validation objects (the weighted root mean square that it was trained
with, lower is better): {val_recon}.

No test object was seen: neither in training nor in the choice of the exported epoch. The hands
listed as held out were not seen either. Contact maps generated for objects far from the training
objects in size (metres matter: the network sees absolute coordinates) or away from the object
frame's origin are not to be trusted.
"""


def model_card(name: str, metadata: Mapping[str, Any]) -> str:
    """The Markdown text.

    Args:
        name: heading.
        metadata: what ``run_training`` stores beside the weights.
    """
    listed = {
        key: ", ".join(value) or "none"
        for key, value in metadata.items()
        if isinstance(value, list)
    }
    recon = metadata["val_recon"]
    return _CARD.format(
        **{
            **metadata,
            **listed,
            "name": name,
            "train_object_count": len(metadata["train_objects"]),
            "validation_object_count": len(metadata["validation_objects"]),
            "exported_epoch": metadata["exported_epoch"] + 1,
            "split_hash": f" (`{metadata['split_sha256']}`)" if metadata["split_sha256"] else "",
            "val_recon": "not measured" if recon is None else f"{recon:.4f}",
        }
    )
