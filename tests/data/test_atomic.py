"""A file is the old one or the new one, never half of it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gdg.data.atomic import atomic_path, write_text_atomically
from gdg.data.validate import LEFTOVER


@pytest.fixture
def target(tmp_path: Path) -> Path:
    path = tmp_path / "grasps.json"
    path.write_text("old")
    return path


def assert_untouched(target: Path) -> None:
    assert target.read_text() == "old"
    assert list(target.parent.iterdir()) == [target]


def test_a_file_is_replaced_and_nothing_else_is_left(target: Path):
    write_text_atomically(target, "new, with ümlaut")
    assert target.read_text(encoding="utf-8") == "new, with ümlaut"
    assert list(target.parent.iterdir()) == [target]


def test_missing_folders_are_made(tmp_path: Path):
    write_text_atomically(tmp_path / "a" / "b" / "c.txt", "x")
    assert (tmp_path / "a" / "b" / "c.txt").read_text() == "x"


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit, MemoryError])
def test_an_exception_half_way_keeps_the_old_file(target: Path, error: type[BaseException]):
    def interrupted() -> None:
        with atomic_path(target) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        interrupted()
    assert_untouched(target)


def test_a_full_disk_keeps_the_old_file(target: Path, monkeypatch: pytest.MonkeyPatch):
    def full(self: Path, *args: object, **kwargs: object) -> int:
        with self.open("w") as stream:
            stream.write("ha")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space left"):
        write_text_atomically(target, "half")
    assert_untouched(target)


def test_a_failing_rename_keeps_the_old_file(target: Path, monkeypatch: pytest.MonkeyPatch):
    def broken(*args: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(PermissionError):
        write_text_atomically(target, "new")
    assert_untouched(target)


def test_a_reader_sees_the_old_file_until_the_new_one_is_complete(target: Path):
    with atomic_path(target) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
        assert temporary.parent == target.parent
        assert temporary.suffix == target.suffix
        assert temporary.name.startswith(".")
    assert target.read_text() == "new"


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_the_umask_decides_who_may_read_the_file(target: Path, umask: int, mode: int):
    before = os.umask(umask)
    try:
        write_text_atomically(target, "new")
    finally:
        os.umask(before)
    assert target.stat().st_mode & 0o777 == mode


def test_a_temporary_file_is_known_as_a_leftover(target: Path):
    with atomic_path(target) as temporary:
        assert LEFTOVER.fullmatch(temporary.name)
