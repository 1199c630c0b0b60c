"""Writes ``hand.yaml`` for people: comments, short lines, and how sure each proposal is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from gdg.hands.decisions import Decision
from gdg.hands.spec import Drive, HandSpec
from gdg.text import one_line
from gdg.yaml_files import dump_yaml


def manifest_text(spec: HandSpec, decisions: Sequence[Decision] = ()) -> str:
    """The text of a manifest, which ``gdg.hands.spec.read_spec`` reads back as ``spec``.

    Args:
        spec: what to write.
        decisions: become comments at what they are about.
    """
    about = {decision.subject: decision for decision in decisions}
    lines = [
        f"# {one_line(spec.title or spec.name)}. Lengths in metres, angles in radians.",
        *_pairs({"name": spec.name, "title": one_line(spec.title), "urdf": spec.urdf}),
        *_comment("Which shapes of the URDF count: collision or visual."),
        *_pairs({"geometry": spec.geometry, "root_link": spec.root_link}),
        *_palm(spec, about),
        *_joints(spec, about),
        *_regions(spec, about.get("contact_regions")),
        *_self_contacts(spec, about.get("allowed_self_contacts")),
        *_drives(spec, about.get("drives")),
        "provenance:",
        *_pairs({name: one_line(text) for name, text in spec.provenance}, indent=2),
    ]
    return "\n".join(lines) + "\n"


def _palm(spec: HandSpec, about: Mapping[str, Decision]) -> Iterable[str]:
    yield from _comment(
        "The palm's surface, in its link's frame; the normal points out of the hand."
    )
    yield "palm:"
    for field in ("link", "normal", "center"):
        yield from _decided(about.get(f"palm.{field}"), 2)
        yield f"  {field}: {_scalar(getattr(spec.palm, field))}"


def _joints(spec: HandSpec, about: Mapping[str, Decision]) -> Iterable[str]:
    yield from _comment("Actuated joints in the order of every joint vector.")
    yield "joints:"
    for joint in spec.joints:
        yield f"  - {_scalar(joint)}"
        decision = about.get(f"joint {joint}")
        if decision is not None:
            text = f"{decision.value} ({decision.verdict}: {decision.reason})"
            yield f"    # {one_line(text)}"
    yield from _comment("A joint with the same value in open and closed takes no part in closing.")
    yield from _decided(about.get("closed"), 0)
    for which in ("open", "closed"):
        yield f"{which}:"
        yield from _pairs(getattr(spec, which), indent=2)


def _regions(spec: HandSpec, decision: Decision | None) -> Iterable[str]:
    yield from _comment(
        "Where the hand may touch: four corners each, link frame, counter-clockwise from outside."
    )
    yield from _decided(decision, 0)
    if not spec.contact_regions:
        yield "contact_regions: {}"
        return
    yield "contact_regions:"
    for link, regions in spec.contact_regions.items():
        yield f"  {_scalar(link)}:"
        for a, b, c, d in regions:
            yield f"    - [{_scalar(a)}, {_scalar(b)},"
            yield f"       {_scalar(c)}, {_scalar(d)}]"


def _self_contacts(spec: HandSpec, decision: Decision | None) -> Iterable[str]:
    if not spec.allowed_self_contacts:
        return
    yield from _comment("Links that touch by construction, beyond neighbours in the chain.")
    yield from _decided(decision, 0)
    yield "allowed_self_contacts:"
    for pair in spec.allowed_self_contacts:
        yield f"  - {_scalar(pair)}"


def _drives(spec: HandSpec, decision: Decision | None) -> Iterable[str]:
    yield from _comment(
        "Stiffness N m/rad, damping N m s/rad, force limit N m (sliding: N/m, N s/m, N)."
    )
    yield from _decided(decision, 0)
    yield "drives:"
    yield f"  default: {_drive(spec.drives.default)}"
    if spec.drives.joints:
        yield "  joints:"
        for joint, drive in spec.drives.joints.items():
            yield f"    {_scalar(joint)}: {_drive(drive)}"


def _drive(drive: Drive) -> str:
    return (
        f"{{stiffness: {drive.stiffness:g}, damping: {drive.damping:g}, "
        f"force_limit: {drive.force_limit:g}}}"
    )


def _decided(decision: Decision | None, indent: int) -> Iterable[str]:
    if decision is not None:
        yield f"{' ' * indent}# {decision.verdict}: {one_line(decision.reason)}"


def _comment(text: str) -> Iterable[str]:
    return [f"# {text}"]


def _pairs(values: Mapping[str, Any], indent: int = 0) -> Iterable[str]:
    for key, value in values.items():
        yield f"{' ' * indent}{_scalar(key)}: {_scalar(value)}"


def _scalar(value: Any) -> str:
    """A value on one line, quoted where YAML needs it, be it in a list or not."""
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(_scalar(item) for item in value) + "]"
    if isinstance(value, float):
        return f"{value:.6g}"
    text = dump_yaml([value]).removeprefix("- ").removesuffix("\n")
    # YAML breaks long text into lines, and brackets and commas end plain text within a list
    broken = "\n" in text or (text == value and set(text) & set(",[]{}:?"))
    return _quoted(value) if isinstance(value, str) and broken else text


def _quoted(text: str) -> str:
    """Text in double quotes on one line."""
    return '"' + "".join(c if _stands_for_itself(c) else f"\\U{ord(c):08x}" for c in text) + '"'


def _stands_for_itself(character: str) -> bool:
    return character.isprintable() and character not in '"\\'
