"""The contact-map networks that the method's authors released: their tensor names and facts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from torch import Tensor

#: The release's maps: aligned distance with the factor 10.
DISTANCE = "aligned/release"
SOURCE = "github.com/tengyu-liu/GenDexGrasp"

#: SHA-256 of the known files -> (checkpoint's name, hands that it never saw).
KNOWN: dict[str, tuple[str, tuple[str, ...]]] = {
    "2faebada9bea41760458b0ab56f8e32cc351c57805a4e206a685f0f9940ee247": ("SqrtFullRobots", ()),
    "2db0ca320d0b71e810e338c6604b026730f5add1cc8dcf994aee630289df1f54": (
        "SqrtUnseenBarrett",
        ("barrett",),
    ),
    "3ef63d03d6fbc77d0ae060e58921c61c82b79060c46012afd0036227f937b17f": (
        "SqrtUnseenEzgripper",
        ("ezgripper",),
    ),
    "4ac54db407148c5de1b40b32fa9dfe3b8dc57ef46ea7284aa015ec5600214a8b": (
        "SqrtUnseenShadowhand",
        ("shadowhand",),
    ),
}

#: Our group of shared layers -> (the release's convolutions, its batch norms, how many).
_GROUPS = {
    "encoder.layers": ("encoder.conv_layers", "encoder.bn_layers", 3),
    "decoder.pointwise": ("decoder.pointwise_conv_layers", "decoder.pointwise_bn_layers", 2),
    "decoder.overall": ("decoder.global_conv_layers", "decoder.global_bn_layers", 2),
    "decoder.layers": ("decoder.decoder_conv_layers", "decoder.decoder_bn_layers", 4),
}
_HEADS = {"encoder.mean": "encoder_z_means", "encoder.log_variance": "encoder_z_logvars"}
_NORM = ("weight", "bias", "running_mean", "running_var", "num_batches_tracked")


def _names() -> Iterator[tuple[str, str]]:
    for ours, (convolution, norm, count) in _GROUPS.items():
        for index in range(count):
            for part in ("weight", "bias"):
                yield f"{ours}.{index}.linear.{part}", f"{convolution}.{index}.{part}"
            for part in _NORM:
                yield f"{ours}.{index}.norm.{part}", f"{norm}.{index}.{part}"
    for ours, theirs in _HEADS.items():
        for part in ("weight", "bias"):
            yield f"{ours}.{part}", f"{theirs}.{part}"


#: Our tensor name -> the release's, all 81.
TENSOR_NAMES = dict(_names())


def to_our_layout(name: str, tensor: Tensor) -> Tensor:
    """A released tensor as ours: a 1×1 convolution's weight (out, in, 1) becomes (out, in)."""
    is_convolution = name.endswith("linear.weight") and tensor.ndim == 3 and tensor.shape[2] == 1
    return tensor[:, :, 0] if is_convolution else tensor


def provenance(sha256: str) -> dict[str, Any]:
    """What is known of a released file; of any other ``.pth`` that nothing is known."""
    if sha256 not in KNOWN:
        return {"source": "unknown", "note": "training data unknown: may have seen any object"}
    name, held_out_hands = KNOWN[sha256]
    return {
        "source": SOURCE,
        "checkpoint": name,
        "held_out_hands": list(held_out_hands),
        "note": "selected on a validation set with all five hands and the ten test objects",
    }
