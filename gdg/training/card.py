"""The model card: what was trained, on what, how well it does, what it is for and not for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_CARD = """\
# {name}

{what} `{component}`, trained by gdg {gdg_version}{for_hand} on grasps whose contact maps are of the
distance `{distance}`. Use it with `{kind}={component}` and
`{kind}.weights=<path of the .safetensors file>`.

| network | |
|---|---|
| component | {component} ({component_version}) |
| parameters | {parameters:,} |
| options | {component_options} |

| data | |
|---|---|
| made by | {recipe} |
| hands | {hands} |
| held-out hands | {held_out_hands} |
| held-out objects | {held_out_objects} |
| split | {split}{split_hash} |
| train objects ({train_object_count}) | {train_objects} |
| validation objects ({validation_object_count}) | {validation_objects} |
| grasps, train / validation | {train_items} / {validation_items} |
| data (SHA-256) | `{data_sha256}` |

| training | |
|---|---|
| epochs trained / exported | {epochs} / {exported_epoch} (`keep={keep}`{patience}) |
| batch, learning rate, seed | {batch}, {learning_rate:g}, {seed} |
| points per item, balance | {points}, {balance} |
| augmentation | {augmentation} |
| average of the weights | {ema} |
| wall time of the last fit | {seconds:.0f} s on {device}, precision {precision} |

{figures}

![Learning curves](curves.png)

## Hands

| hand | train / validation grasps | content (SHA-256) |
|---|---|---|
{hand_rows}

## Objects

| object | train / validation grasps | content (SHA-256) |
|---|---|---|
{object_rows}

## Intended use

{use}

## Limits

- No test object was seen: neither in training nor in the choice of the exported epoch. The hands
  and objects listed as held out were not seen either.
- What comes out for objects far from the training objects in size is not to be trusted (metres
  matter: the network sees absolute coordinates), nor for objects away from the object frame's
  origin{orientation}.
- The grasps were learned from simulation alone: rigid objects, known shape, no sensor noise beyond
  the augmentation above.{few}
"""

_USES = {
    "generator": (
        "Proposes contact maps on objects of known shape; a fitter then moves any hand to them, "
        "also one that is not listed here. The grasps want to be tested in simulation, as "
        "`gdg grasp` does, before a robot tries them."
    ),
    "planner": (
        "Plans grasps of the hand `{hand}` on objects of known shape; of no other hand. The "
        "grasps want to be tested in simulation, as `gdg grasp` does, before a robot tries them."
    ),
}
#: Fewer validation objects than this say little.
FEW_OBJECTS = 3


def model_card(name: str, known: Mapping[str, Any]) -> str:
    """The Markdown text.

    Args:
        name: heading.
        known: what ``run_training`` stores beside the weights.
    """
    listed = {key: ", ".join(value) or "none" for key, value in known.items() if _is_list(value)}
    kind, hand = known["kind"], known["hand"]
    return _CARD.format(
        **{
            **known,
            **listed,
            "name": name,
            "what": {"generator": "Contact-map generator", "planner": "Planner"}[kind],
            "for_hand": f" for the hand `{hand}`" if hand else "",
            "component_options": _options(known["component_options"]),
            "train_object_count": len(known["train_objects"]),
            "validation_object_count": len(known["validation_objects"]),
            "exported_epoch": known["exported_epoch"] + 1,
            "split_hash": f" (`{known['split_sha256']}`)" if known["split_sha256"] else "",
            "patience": f", `patience={known['patience']}`" if known["patience"] else "",
            "augmentation": _options(known["augment"]),
            "ema": f"exponential, decay {known['ema_decay']:g}" if known["ema_decay"] else "none",
            "figures": _figures(known),
            "hand_rows": _rows(known["hand_items"], known["hand_hashes"]),
            "object_rows": _rows(known["object_items"], known["object_hashes"]),
            "use": _USES[kind].format(hand=hand),
            "orientation": _orientation(known["augment"]["rotation"]),
            "few": _few(known),
        }
    )


def _is_list(value: object) -> bool:
    return isinstance(value, list)


def _options(options: Mapping[str, Any]) -> str:
    return ", ".join(f"`{name}={value}`" for name, value in options.items()) or "none"


def _figures(known: Mapping[str, Any]) -> str:
    """Figures of the exported epoch on the validation objects."""
    figures = {k: v for k, v in known["figures"].items() if k.startswith("val_")}
    if not figures:
        return "Not measured on validation objects: there were none."
    rows = "\n".join(f"| `{name}` | {value:.4f} |" for name, value in sorted(figures.items()))
    return (
        "On the validation objects, at the exported epoch (`val_recon` chose it, the lower the "
        f"better):\n\n| figure | value |\n|---|---|\n{rows}"
    )


def _rows(items: Mapping[str, list[int]], hashes: Mapping[str, str]) -> str:
    return "\n".join(
        f"| {name} | {counts[0]} / {counts[1]} | `{hashes[name][:16]}…` |"
        for name, counts in sorted(items.items())
    )


def _orientation(rotation: str) -> str:
    return {
        "none": ", nor for objects turned otherwise than the training objects, which were not "
        "turned in training",
        "yaw": ", nor for objects turned about other axes than z",
        "full": "",
    }[rotation]


def _few(known: Mapping[str, Any]) -> str:
    count = len(known["validation_objects"])
    if count >= FEW_OBJECTS:
        return ""
    return f"\n- With {count} validation object(s) the figures above say little about new objects."
