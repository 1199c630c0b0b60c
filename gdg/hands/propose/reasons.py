"""Says what was decided about a hand, how sure it is, and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gdg.hands.decisions import Decision
from gdg.hands.propose.closing import Closing
from gdg.hands.propose.palm import PalmFace
from gdg.hands.propose.postures import Postures
from gdg.hands.propose.probe import Grips
from gdg.hands.propose.structure import Structure
from gdg.hands.spec import HandSpec

#: How sure a decision is where nothing is measured, chosen for its verdict (``Decision.verdict``):
#: what a mistake would be rare in, the palm's link and regions on every finger's tip ...
STRUCTURAL = 0.95
#: ... what was found by trying or is taken over: links that touch, efforts ...
FOUND = 0.9
#: ... that a joint without part in closing has none ...
REST_CERTAINTY = 0.7
#: ... estimates of force limits, and regions that some fingers lack.
ESTIMATED, INCOMPLETE = 0.5, 0.4
#: The closed posture: this for grips of energy 0, less by the second figure per unit of their mean
#: energy (below about 1 all fingers touch), within the third figures.
CLOSED_CERTAINTY, PER_ENERGY, CERTAINTIES = 1.1, 0.3, (0.1, 0.99)
SIDES = {1: "closes with larger values", -1: "closes with smaller values", 0: "rests"}


@dataclass(frozen=True)
class Found:
    """What a proposal rests on.

    Attributes:
        structure: palm, fingers, wrist.
        closings: per actuated joint, which way it closes.
        grips: the balls held.
        face: the palm.
        postures: open and closed.
        stated: per actuated joint, whether the description states a plausible force limit.
    """

    structure: Structure
    closings: tuple[Closing, ...]
    grips: Grips
    face: PalmFace
    postures: Postures
    stated: dict[str, bool]


def explain(spec: HandSpec, found: Found) -> tuple[Decision, ...]:
    """One decision per field of the manifest that was chosen, in its order."""
    return (
        *_palm(spec, found),
        *(_joint(spec, found, closing) for closing in found.closings),
        _closed(spec, found),
        _regions(spec, found),
        Decision(
            "allowed_self_contacts",
            f"{len(spec.allowed_self_contacts)} pairs",
            FOUND,
            "they overlap in the open posture or in most others",
        ),
        _drives(spec, found),
    )


def _palm(spec: HandSpec, found: Found) -> Iterable[Decision]:
    sure, fingers = found.face.certainty, len(found.structure.fingers)
    what = "1 finger moves on it" if fingers == 1 else f"{fingers} fingers branch from it"
    yield Decision("palm.link", spec.palm.link, STRUCTURAL, what)
    yield Decision("palm.normal", _listed(spec.palm.normal), sure, found.face.reason)
    why = "the palm's surface under the balls that it holds"
    yield Decision("palm.center", _listed(spec.palm.center), sure, why)


def _joint(spec: HandSpec, found: Found, closing: Closing) -> Decision:
    why = f"moves what it touches with a cosine of {closing.straightness:+.2f} into the balls"
    if closing.joint in found.structure.wrist:
        why = "lies between the root and the palm"
    elif closing.sign == 0:
        why = "does not press the fingers into the balls"
    first, last = spec.open[closing.joint], spec.closed[closing.joint]
    path = f"{first:g} to {last:g}" if closing.sign else f"at {first:g}"
    sure = closing.certainty if closing.sign else REST_CERTAINTY
    return Decision(f"joint {closing.joint}", f"{SIDES[closing.sign]}, {path}", sure, why)


def _closed(spec: HandSpec, found: Found) -> Decision:
    met = [f"'{first}' and '{second}'" for first, second in found.postures.met]
    named = ", ".join(met[:2]) + (", …" if len(met) > 2 else "")
    until = f"fingers meet ({named})" if met else "the joints are near their limits"
    energy = float(found.grips.energy.mean())
    sure = float(np.clip(CLOSED_CERTAINTY - PER_ENERGY * energy, *CERTAINTIES))
    return Decision("closed", f"{len(spec.closed)} joints", sure, f"closes until {until}")


def _regions(spec: HandSpec, found: Found) -> Decision:
    regions, fingers = spec.contact_regions, found.structure.fingers
    tips = [finger for finger in fingers if any(link in regions for link in finger.distal)]
    why = f"{len(tips)} of {len(fingers)} fingers have one on their last link"
    value = f"{sum(map(len, regions.values()))} on {len(regions)} links"
    if len(tips) < len(fingers):
        return Decision("contact_regions", value, INCOMPLETE, why + "; draw the others by hand")
    return Decision("contact_regions", value, STRUCTURAL, why)


def _drives(spec: HandSpec, found: Found) -> Decision:
    value = f"at most {spec.drives.default.force_limit:g} for most joints"
    unknown = [joint for joint, known in found.stated.items() if not known]
    if not unknown:
        return Decision("drives", value, FOUND, "efforts of the description")
    named = ", ".join(unknown[:4]) + (", …" if len(unknown) > 4 else "")
    why = f"estimates: the description states no plausible effort for {named}"
    return Decision("drives", value, ESTIMATED, why)


def _listed(vector: Sequence[float]) -> str:
    return "[" + ", ".join(f"{value:g}" for value in vector) + "]"
