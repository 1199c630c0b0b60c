"""Files that are either complete or absent, whatever kills the process."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yields a temporary path in the same folder, renamed to ``path`` if the body succeeds.

    On any exception (a full disk, Ctrl-C) the temporary file is removed and ``path`` stays as
    it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path
    try:
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix
        )
        os.close(handle)
        temporary = Path(name)
        yield temporary
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        if str(error.filename or "").startswith(str(path.parent / f".{path.name}.")):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        if temporary != path:
            temporary.unlink(missing_ok=True)


def write_text_atomically(path: Path, text: str) -> None:
    """Writes UTF-8 text so that a reader never sees half of it."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
