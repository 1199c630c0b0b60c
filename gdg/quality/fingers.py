"""Which finger a link belongs to."""

from __future__ import annotations

from gdg.hands.hand import Hand


def fingers_of_links(hand: Hand) -> dict[str, str | None]:
    """Link -> the first link of its finger, or None for the palm and what carries it.

    The palm is the rigid body of the palm's link; a finger is what hangs by one moving joint on
    the palm or on a body between it and the root.
    """
    joint_of = {joint.child: joint for joint in hand.urdf.joints.values()}
    body = dict(zip(hand.link_names, hand.bodies, strict=True))
    trunk = {body[hand.urdf.root]}
    link = hand.spec.palm.link
    while link in joint_of:
        trunk.add(body[link])
        link = joint_of[link].parent
    found: dict[str, str | None] = {}
    for name, joint in ((name, joint_of.get(name)) for name in _parents_first(hand)):
        if body[name] in trunk:
            found[name] = None
        else:
            assert joint is not None  # only the root has none, and it is of the trunk
            found[name] = found[joint.parent] or name
    return found


def _parents_first(hand: Hand) -> list[str]:
    return [hand.urdf.root, *(joint.child for joint in hand.urdf.joints.values())]
