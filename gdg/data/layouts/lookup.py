"""Finds the hands and objects that files of other layouts name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from gdg.errors import GdgError
from gdg.folders import HANDS, OBJECTS, FolderKind
from gdg.hands.hand import Hand, find_hand
from gdg.objects.model import ObjectModel, find_object

#: In a pattern of mesh files: the object's name; of ``ycb+pear``, only ``pear``; only ``ycb``.
OBJECT, NAME, DATASET = "{object}", "{name}", "{dataset}"


@dataclass
class Lookup:
    """Loads each hand and object once, by the words that the user gave for its name.

    Attributes:
        hands: name in the file -> name or folder; "" stands for every hand without a word.
        objects: name in the file -> name, folder or mesh file.
        meshes: pattern of mesh files such as ``objects/{dataset}/{name}.stl``, or "".
    """

    hands: dict[str, str] = field(default_factory=dict)
    objects: dict[str, str] = field(default_factory=dict)
    meshes: str = ""
    _hands: dict[str, Hand] = field(default_factory=dict)
    _object: tuple[str, ObjectModel] | None = None

    def words(self) -> tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...], str]:
        """The words alone, hashable; ``Lookup.of_words`` makes a lookup of them again."""
        return tuple(self.hands.items()), tuple(self.objects.items()), self.meshes

    @staticmethod
    def of_words(
        words: tuple[tuple[tuple[str, str], ...], tuple[tuple[str, str], ...], str],
    ) -> Lookup:
        """A lookup that has loaded nothing yet."""
        hands, objects, meshes = words
        return Lookup(dict(hands), dict(objects), meshes)

    def hand_word(self, name: str, known_as: str = "") -> str:
        """What to load a hand by; ``known_as`` is what a dataset has recorded.

        Raises:
            GdgError: the file names no hand, and the user gave none, or its name can't be printed.
        """
        _check_printable("hand", name)
        word = self.hands.get(name) or self.hands.get("") or known_as or _bare("hand", name)
        if not word:
            raise GdgError("the files do not name the hand; give it: --hand NAME or --hand FOLDER")
        return word

    def object_word(self, name: str, known_as: str = "") -> str:
        """What to load an object by; ``known_as`` is what a file or dataset says beside its name.

        Raises:
            GdgError: the pattern gives a mesh file that does not exist, or the name can't be
                printed.
        """
        _check_printable("object", name)
        if name in self.objects:
            return self.objects[name]
        if not self.meshes:
            return known_as or _bare("object", name)
        path = _filled(self.meshes, known_as or name)
        if not Path(path).expanduser().is_file():
            raise GdgError(f"object '{name}': there is no mesh {path}.")
        return path

    def hand_place(self, name: str, known_as: str = "") -> str:
        """``hand_word`` as a dataset keeps it: a name, or a path that holds in any folder."""
        return _place(HANDS, self.hand_word(name, known_as))

    def object_place(self, name: str, known_as: str = "") -> str:
        """``object_word`` as a dataset keeps it: a name, or a path that holds in any folder."""
        return _place(OBJECTS, self.object_word(name, known_as))

    def hand(self, name: str, known_as: str = "") -> Hand:
        """The hand of a name in a file."""
        word = self.hand_word(name, known_as)
        if word not in self._hands:
            self._hands[word] = find_hand(word)
        return self._hands[word]

    def object(self, name: str, known_as: str = "", scale: float = 1.0) -> ObjectModel:
        """The object of a name in a file; only the last one is kept in memory."""
        word = self.object_word(name, known_as)
        key = f"{scale!r} {word}"
        if self._object is None or self._object[0] != key:
            try:
                self._object = (key, find_object(word, scale))
            except GdgError as error:
                if name in self.objects or self.meshes:
                    raise
                raise GdgError(
                    f"{error} Or write --object {name}=PATH, or --meshes PATTERN."
                ) from error
        return self._object[1]


def _check_printable(noun: str, name: str) -> None:
    if not name.isprintable():
        raise GdgError(f"{noun} {name[:80]!r}: the name has characters that can't be printed.")


def _place(kind: FolderKind, word: str) -> str:
    found = kind.find(word)
    return str(found.path) if found.tier == "path" else word


def _filled(pattern: str, name: str) -> str:
    dataset, _, own = name.rpartition("+")
    for place, text in ((OBJECT, name), (NAME, own), (DATASET, dataset)):
        pattern = pattern.replace(place, text)
    return pattern


def _bare(noun: str, name: str) -> str:
    """A name that a file gives, unless it would be taken for a path."""
    if (
        "/" in name
        or "\\" in name
        or name.startswith((".", "~"))
        or Path(name).suffix.lower() in (OBJECTS.bare_suffixes)
    ):
        raise GdgError(
            f"{noun} '{name[:80]}': a file may not say where to look; write --{noun} NAME=PATH."
        )
    return name


def words_by_name(words: Iterable[str], option: str, lone: bool = False) -> dict[str, str]:
    """``NAME=WORD`` words as a mapping; with ``lone``, a word without ``=`` has the name "".

    Raises:
        GdgError: a word has no name, or a name stands twice.
    """
    mapping: dict[str, str] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            name, value = "", word
        if not value or not (name or (lone and not equals)):
            raise GdgError(f"{option} {word}: write {option} NAME=FOLDER.")
        if name in mapping:
            raise GdgError(f"{option} {word}: '{name or word}' is given twice.")
        mapping[name] = value
    return mapping
