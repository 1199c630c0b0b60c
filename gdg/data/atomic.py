"""Files that are either complete or absent, whatever kills the process."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yields a temporary path in the same folder, renamed to ``path`` if the body succeeds.

    On any exception (a full disk, Ctrl-C) the temporary file is removed and ``path`` stays as
    it was. The umask decides who may read the file, as with any new one.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path
    try:
        temporary = _new_file(path)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        if str(error.filename or "").startswith(str(path.parent / f".{path.name}.")):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        if temporary != path:
            temporary.unlink(missing_ok=True)


def _new_file(path: Path) -> Path:
    """An empty file beside ``path``, with a hidden name and the permissions of any new file."""
    while True:
        temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}{path.suffix}")
        try:
            # not mkstemp, whose files only their owner may read: here the umask decides
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except FileExistsError:
            continue
        return temporary


def write_text_atomically(path: Path, text: str) -> None:
    """Writes UTF-8 text so that a reader never sees half of it."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
