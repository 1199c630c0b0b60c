"""Made-up hands whose palm, fingers and closing directions are known, each hard in its own way.

Every generator in ``HARD_HANDS`` gives a ``HardHand``: a bare URDF (no ``hand.yaml``) as data, with
its truth. ``write_hard_hand`` writes the URDF and its meshes into a folder; ``scramble`` gives the
same hand in other frame conventions, ``rename`` with names that say nothing::

    hand = scramble(HARD_HANDS["forearm"](), seed=3)
    urdf = write_hard_hand(hand, tmp_path)

As generated, anthropomorphic hands have their fingers along +z, the palm facing +x and a right
hand's thumb on the +y side; grippers face +z. Sizes are those of real hands, metres.
"""

from __future__ import annotations

from collections.abc import Callable

from hard_hands.anthropomorphic import (
    bare_roots,
    flexion_first,
    forearm,
    four_fingers,
    left_hand,
    many_shapes,
    millimetre_meshes,
    negative_closes,
    right_hand,
    split_palm,
    symmetric_limits,
    thumb_beside,
    two_and_thumb,
    underactuated,
)
from hard_hands.around_a_palm import (
    adapter_plate,
    continuous_joints,
    three_opposed,
    three_spread_first,
    three_symmetric,
)
from hard_hands.files import urdf_text, write_hard_hand
from hard_hands.grippers import (
    four_bar,
    jaw_and_fixed_jaw,
    jaws_both_driven,
    jaws_mimic,
    outstretched,
)
from hard_hands.hand import HardHand
from hard_hands.retold import rename, scramble

__all__ = [
    "HARD_HANDS",
    "HardHand",
    "rename",
    "scramble",
    "urdf_text",
    "write_hard_hand",
]

HARD_HANDS: dict[str, Callable[[], HardHand]] = {
    make.__name__: make
    for make in (
        jaws_mimic,
        jaws_both_driven,
        jaw_and_fixed_jaw,
        four_bar,
        outstretched,
        three_symmetric,
        three_spread_first,
        three_opposed,
        continuous_joints,
        adapter_plate,
        right_hand,
        left_hand,
        symmetric_limits,
        negative_closes,
        underactuated,
        thumb_beside,
        two_and_thumb,
        flexion_first,
        four_fingers,
        forearm,
        bare_roots,
        millimetre_meshes,
        many_shapes,
        split_palm,
    )
}
