"""Makes a hand folder from a bare URDF or MJCF file."""

from __future__ import annotations

import contextlib
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gdg.errors import GdgError, GdgErrors
from gdg.hands.hand import Hand, load_hand
from gdg.hands.intake import Intake, take_in
from gdg.hands.manifest_text import manifest_text
from gdg.hands.propose import Proposal, propose
from gdg.hands.spec import MANIFEST, NAME
from gdg.kinds.hand_model import HandModel
from gdg.text import one_line

#: Characters that mean something to Markdown in the middle of a line.
MARKDOWN = re.compile(r"[\\`*\[\]<>|]")


@dataclass(frozen=True)
class NewHand:
    """A hand folder that was just made.

    Attributes:
        hand: the hand, loaded from its folder.
        intake: what became of the description, repairs included.
        proposal: what was decided, and how sure it is.
    """

    hand: Hand
    intake: Intake
    proposal: Proposal


def create_hand(
    source: Path,
    folder: Path,
    name: str,
    build: Callable[[Hand], HandModel],
    *,
    root: str | None = None,
    package_paths: Sequence[Path] = (),
    say: Callable[[str], None] = lambda text: None,
) -> NewHand:
    """Writes ``folder`` with manifest, URDF, meshes and README.

    The folder appears when it is complete; on a failure nothing is left behind.

    Args:
        source: URDF or MJCF file, untrusted.
        folder: must bear the hand's name, and not exist or be empty.
        name: of the hand; see ``name_from``.
        build: makes a hand's model.
        root: keep only this link and what hangs on it.
        package_paths: where ROS packages lie whose meshes the file names.
        say: called with what is being done.

    Raises:
        GdgError: the folder is taken or has another name, or the description can't be read or
            understood.
    """
    if not re.fullmatch(NAME, name):
        raise GdgError(
            f"hand name '{name}': write lower-case letters, digits, - and _, e.g. "
            f"'{_made_from(name) or 'my_hand'}'."
        )
    if folder.resolve().name != name:
        raise GdgError(
            f"{folder}: the hand is called '{name}', and a hand and its folder bear one name. "
            f"Write --out {folder.parent / name}."
        )
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise GdgError(
            f"{folder}: exists already, and gdg overwrites no hand. Remove it, or choose another "
            f"place with --out."
        )
    try:
        with tempfile.TemporaryDirectory(prefix=f".{name}-", dir=_existing(folder)) as partial:
            work = Path(partial) / name
            say(f"reading {source}")
            intake = take_in(source, work, name, root, package_paths)
            say("gripping balls with it")
            with _naming(source, work):
                proposal = propose(work, name, intake, build)
                (work / MANIFEST).write_text(
                    manifest_text(proposal.spec, proposal.decisions), encoding="utf-8"
                )
                (work / "README.md").write_text(_readme(source, intake, proposal), encoding="utf-8")
                load_hand(work)
            _move(work, folder)
    except OSError as error:
        raise GdgError(f"{folder}: cannot be written: {error.strerror or error}.") from error
    return NewHand(load_hand(folder), intake, proposal)


def _existing(folder: Path) -> Path:
    """The nearest folder above that exists, which is on the same disk in all likelihood."""
    return next(above for above in folder.absolute().parents if above.exists())


@contextlib.contextmanager
def _naming(source: Path, work: Path) -> Iterator[None]:
    """Refusals name the user's file instead of those made from it, which are gone by then."""
    try:
        yield
    except GdgError as error:
        told = error.messages if isinstance(error, GdgErrors) else (str(error),)
        urdf = str(work / f"{work.name}.urdf")
        messages = [text.replace(urdf, str(source)).replace(f"{work}/", "") for text in told]
        raise GdgErrors(messages) from error


def _move(work: Path, folder: Path) -> None:
    """Puts a finished folder where none is, or fills the empty one that is there."""
    if folder.exists():
        for entry in work.iterdir():
            shutil.move(entry, folder / entry.name)
    else:
        folder.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(work, folder)


def name_from(path: Path) -> str:
    """A hand's name made from that of its file: lower case, letters, digits, - and _.

    Raises:
        GdgError: nothing is left of it.
    """
    name = _made_from(path.name.partition(".")[0])
    if not name:
        raise GdgError(f"{path}: gives no name for the hand; write one after the file.")
    return name


def _made_from(text: str) -> str:
    """What of a text can be a hand's name; maybe nothing."""
    return re.sub(r"[^a-z0-9_-]+", "_", text.lower()).strip("_-")


def _readme(source: Path, intake: Intake, proposal: Proposal) -> str:
    spec, structure = proposal.spec, proposal.structure
    lines = [
        f"# {_escaped(spec.title or spec.name)}",
        "",
        f"Made by `gdg hands new` from {_code(source.name)}. {_escaped(intake.source)}",
        f"Licence: {_escaped(spec.provenance.licence)}.",
        "",
        f"Palm: {_code(structure.palm)}. Wrist joints: {_names(structure.wrist)}.",
        "",
        "| finger | joints | last link |",
        "| --- | --- | --- |",
    ]
    for number, finger in enumerate(structure.fingers, start=1):
        lines.append(f"| {number} | {_names(finger.joints)} | {_names(finger.distal)} |")
    lines += ["", "Changed in the description:", ""]
    lines += [f"- {_escaped(repair)}" for repair in intake.repairs] or ["- nothing"]
    return "\n".join(lines) + "\n"


def _names(names: Sequence[str]) -> str:
    return ", ".join(map(_code, names)) or "none"


def _code(name: str) -> str:
    """A foreign name as code, where it can't end the code or the cell of a table."""
    return _escaped(name) if set("`|") & set(name) else f"`{one_line(name)}`"


def _escaped(text: str) -> str:
    """Foreign text without links, pictures, HTML and whatever else Markdown would make of it."""
    return MARKDOWN.sub(r"\\\g<0>", one_line(text))
