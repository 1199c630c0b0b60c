"""Writes ``constraints.txt``: the versions, in this environment, of all that gdg may install.

    python tools/write_constraints.py

Run it, with Python 3.11 or later, in an environment in which all tests pass. Local version labels
(``+cpu``) are dropped, so that pip takes the build that the machine's index offers.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

import tomllib
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]


def collect(
    requirements: Iterable[str], extras: frozenset[str], found: dict[str, set[str]]
) -> None:
    """Adds, recursively, the distributions that the requirements bring here with their extras.

    Args:
        requirements: as they stand in metadata.
        extras: extras of the distribution that has these requirements.
        found: name -> extras seen so far; added to.
    """
    for text in requirements:
        requirement = Requirement(text)
        marker, name = requirement.marker, canonicalize_name(requirement.name)
        if marker and not any(marker.evaluate({"extra": extra}) for extra in extras | {""}):
            continue
        seen = found.setdefault(name, set())
        if not seen or not requirement.extras <= seen:
            seen.update({"", *requirement.extras})
            collect(metadata.requires(name) or (), frozenset(seen), found)


def main() -> None:
    """Writes the file."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = project["optional-dependencies"].values()
    found: dict[str, set[str]] = {}
    collect(
        [*project["dependencies"], *(r for extra in optional for r in extra)], frozenset(), found
    )
    pins = [f"{name}=={metadata.version(name).partition('+')[0]}" for name in sorted(found)]
    header = "# Tested together; written by tools/write_constraints.py."
    (ROOT / "constraints.txt").write_text("\n".join([header, *pins, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
