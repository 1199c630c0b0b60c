"""Hands and objects are found in tiers, the nearest first, and nothing is imported."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from gripper import write_gripper

from gdg.errors import GdgError
from gdg.folders import HANDS, OBJECTS, TIERS, FolderKind

KIND = FolderKind("gadget", "gadget.yaml", "GDG_TEST_GADGETS", "gdg_test.gadgets", (".stl",))


@pytest.fixture(autouse=True)
def user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty user tier and environment."""
    directory = tmp_path / "user-data"
    monkeypatch.setattr(FolderKind, "user_directory", lambda self: directory)
    monkeypatch.delenv(KIND.variable, raising=False)
    return directory


def gadget(directory: Path, name: str) -> Path:
    folder = directory / name
    folder.mkdir(parents=True)
    (folder / KIND.marker).touch()
    return folder


def search(monkeypatch: pytest.MonkeyPatch, *directories: Path) -> None:
    for directory in directories:
        directory.mkdir(exist_ok=True)
    monkeypatch.setenv(KIND.variable, os.pathsep.join(map(str, directories)))


def install(
    site: Path, monkeypatch: pytest.MonkeyPatch, distribution: str, package: str, value: str = ""
) -> Path:
    """A distribution whose package raises when it is imported."""
    info = site / f"{distribution.replace('-', '_')}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{KIND.group}]\ndata = {value or package}\n")
    root = site / package
    root.mkdir(parents=True)
    (root / "__init__.py").write_text("raise RuntimeError('imported')\n")
    monkeypatch.syspath_prepend(str(site))
    return root


def test_the_bundled_hands_and_objects_are_found():
    assert {"allegro", "barrett"} <= set(HANDS.all())
    assert HANDS.find("allegro").tier == "bundled"
    assert OBJECTS.find("mug").path.name == "mug"


def test_the_nearest_tier_wins_and_shows_what_it_hides(
    tmp_path: Path, user: Path, monkeypatch: pytest.MonkeyPatch
):
    package = install(tmp_path / "site", monkeypatch, "acme-gadgets", "acme_gadgets")
    bundled = install(tmp_path / "site2", monkeypatch, "gdg", "gdg_test_bundled")
    expected = [gadget(tmp_path / "env", "g"), gadget(user, "g"), gadget(package, "g")]
    expected.append(gadget(bundled, "g"))
    search(monkeypatch, tmp_path / "env")
    found = KIND.find("g")
    assert (found.tier, found.path) == ("environment", expected[0])
    assert found.shadows == tuple(expected[1:])
    assert found.twins == ()
    (expected[0] / KIND.marker).unlink()
    assert (KIND.find("g").tier, KIND.find("g").origin) == ("user", str(user))
    (expected[1] / KIND.marker).unlink()
    assert (KIND.find("g").tier, KIND.find("g").origin) == ("package", "acme-gadgets")
    (expected[2] / KIND.marker).unlink()
    assert KIND.find("g").tier == "bundled"


def test_packages_are_located_without_being_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    package = install(tmp_path / "site", monkeypatch, "acme-gadgets", "acme_gadgets")
    folder = gadget(package, "claw")
    assert KIND.find("claw").path == folder
    assert "acme_gadgets" not in sys.modules


def test_a_folder_deep_in_a_package_is_located_without_importing_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    package = install(tmp_path / "site", monkeypatch, "acme", "acme_all", "acme_all.robot.hands")
    folder = gadget(package / "robot" / "hands", "claw")
    assert KIND.find("claw").path == folder
    assert "acme_all" not in sys.modules


def test_an_entry_point_to_a_lost_package_breaks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    install(tmp_path / "site", monkeypatch, "acme", "acme_here", "acme_lost")
    assert KIND.all() == {}


def test_twins_in_one_tier_are_an_error_only_when_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    first, second = gadget(tmp_path / "a", "g"), gadget(tmp_path / "b", "g")
    gadget(tmp_path / "b", "other")
    search(monkeypatch, tmp_path / "a", tmp_path / "b")
    assert KIND.all()["g"].twins == (second,)
    assert KIND.find("other")
    with pytest.raises(GdgError, match="gadget 'g' stands twice in the tier 'environment'") as info:
        KIND.find("g")
    assert str(first) in str(info.value)
    assert str(second) in str(info.value)
    assert KIND.find(str(second)).path == second


def test_one_directory_listed_twice_or_linked_is_no_twin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    gadget(tmp_path / "a", "g")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    search(monkeypatch, tmp_path / "a", tmp_path / "a", tmp_path / "link")
    assert KIND.find("g").twins == ()


def test_a_folder_and_a_bare_mesh_of_one_name_are_twins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    gadget(tmp_path / "a", "g")
    (tmp_path / "a" / "g.stl").touch()
    search(monkeypatch, tmp_path / "a")
    with pytest.raises(GdgError, match="stands twice"):
        KIND.find("g")


def test_a_directory_of_the_environment_that_is_none_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv(KIND.variable, str(tmp_path / "lost"))
    with pytest.raises(GdgError, match=r"GDG_TEST_GADGETS: '.*lost' is not a directory"):
        KIND.find("g")
    folder = gadget(tmp_path, "here")
    assert KIND.find(str(folder)).path == folder


def test_empty_parts_of_the_environment_variable_are_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    gadget(tmp_path / "a", "g")
    monkeypatch.setenv(KIND.variable, f"{os.pathsep}{tmp_path / 'a'}{os.pathsep}")
    assert KIND.find("g")


def test_the_home_directory_is_expanded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = gadget(tmp_path / "mine", "g")
    assert KIND.find("~/mine/g").path == folder
    monkeypatch.setenv(KIND.variable, "~/mine")
    assert KIND.find("g").path == folder


def test_explicit_paths_come_before_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    near, far = gadget(tmp_path, "g"), gadget(tmp_path / "env", "g")
    search(monkeypatch, tmp_path / "env")
    assert KIND.find("./g").path == near
    assert KIND.find("g").path == far
    assert KIND.find("./g").tier == "path"
    monkeypatch.chdir(near)
    assert KIND.find(".").path == near
    (tmp_path / KIND.marker).touch()
    assert KIND.find("..").path == tmp_path


def test_a_folder_in_the_working_directory_is_found_by_its_bare_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    assert KIND.find(gadget(tmp_path, "g").name).tier == "path"


def test_a_bare_mesh_stands_for_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "part.STL").touch()
    assert KIND.find(str(tmp_path / "part.STL")).name == "part"
    search(monkeypatch, tmp_path)
    assert KIND.find("part").path == tmp_path / "part.STL"


def test_hidden_files_are_no_gadgets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    gadget(tmp_path / "a", ".trash")
    (tmp_path / "a" / "._part.stl").touch()
    search(monkeypatch, tmp_path / "a")
    assert KIND.all() == {}


def test_an_unknown_name_gets_a_suggestion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    gadget(tmp_path / "a", "gripper")
    search(monkeypatch, tmp_path / "a")
    with pytest.raises(GdgError, match=r"Unknown gadget 'griper'\. Did you mean 'gripper'\?"):
        KIND.find("griper")


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ("./lost", "there is no such file or folder"),
        ("~no-such-user/x", "there is no such file or folder"),
        ("lost.stl", "there is no such file or folder"),
        ("./empty", "the folder has no gadget.yaml"),
        ("empty", "the folder has no gadget.yaml"),
        ("notes.txt", "is a file, not a folder with gadget.yaml or a mesh (.stl)"),
        ("./notes.txt", "is a file, not a folder with gadget.yaml or a mesh (.stl)"),
        ("x" * 300, "File name too long"),
        ("x" * 300 + ".stl", "File name too long"),
        ("a\0b", "Unknown gadget"),
        ("", "gadget ''"),
    ],
)
def test_what_is_no_gadget_is_explained(
    given: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").touch()
    with pytest.raises(GdgError) as caught:
        KIND.find(given)
    assert reason in str(caught.value)


def test_a_urdf_in_place_of_a_hand_folder_is_told_to_make_one(tmp_path: Path):
    (tmp_path / "my.urdf").touch()
    with pytest.raises(GdgError, match=r"gdg hands new FILE"):
        HANDS.find(str(tmp_path / "my.urdf"))


# -- all tiers of hands, from the shell --------------------------------------------------------


@dataclass(frozen=True)
class Tiers:
    """A hand of one name in every tier, and a shell that sees some of them."""

    folder: Path
    #: Tier -> folder of the hand; in the bundled tier it is gdg's own.
    hands: dict[str, Path]

    def run(self, *command: str, tiers: tuple[str, ...], path: str = "") -> Outcome:
        """Runs ``gdg`` in ``folder``, where only the given tiers have the hand."""
        variables = {
            "GDG_HANDS_PATH": path or (str(self.folder / "env") if "environment" in tiers else ""),
            "XDG_DATA_HOME": str(self.folder / "data") if "user" in tiers else "/nowhere",
            "PYTHONPATH": str(self.folder / "site") if "package" in tiers else "",
            "COLUMNS": "2000",
        }
        finished = subprocess.run(
            [sys.executable, "-c", "from gdg.cli import main; main()", *command],
            cwd=self.folder, env={**os.environ, **variables}, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        return Outcome(finished.returncode, finished.stdout, finished.stderr)

    def line(self, tiers: tuple[str, ...]) -> str:
        """The hand's line in ``gdg hands list``."""
        lines = self.run("hands", "list", tiers=tiers).out.splitlines()
        return next(line for line in lines if line.startswith("barrett "))


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str


def stand_in(directory: Path, tier: str) -> Path:
    """The two jaws under the name of a bundled hand."""
    made = write_gripper(directory).rename(directory / "barrett")
    manifest = made / "hand.yaml"
    text = manifest.read_text().replace("name: two_jaws", "name: barrett")
    manifest.write_text(text.replace("title: Two parallel jaws", f"title: that of {tier}"))
    return made


@pytest.fixture(scope="module")
def tiers(tmp_path_factory: pytest.TempPathFactory) -> Tiers:
    folder = tmp_path_factory.mktemp("tiers")
    package = folder / "site" / "acme_hands"
    info = folder / "site" / "acme_hands-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-hands\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[gdg.hands]\nacme = acme_hands\n")
    hands = {
        "path": stand_in(folder / "mine", "path"),
        "environment": stand_in(folder / "env", "environment"),
        "user": stand_in(folder / "data" / "gdg" / "hands", "user"),
        "package": stand_in(package, "package"),
        "bundled": HANDS.find("barrett").path,
    }
    return Tiers(folder, hands)


@pytest.mark.parametrize("nearest", range(len(TIERS)), ids=TIERS)
def test_gdg_hands_list_shows_the_nearest_hand_and_what_it_hides(tiers: Tiers, nearest: int):
    line = tiers.line(TIERS[nearest:])
    assert f" {TIERS[nearest]} " in line
    title = "Barrett" if TIERS[nearest] == "bundled" else f"that of {TIERS[nearest]}"
    assert title in line
    for tier in TIERS[nearest + 1 :]:
        assert str(tiers.hands[tier]) in line.partition("hides")[2]
    assert ("hides" in line) == (nearest + 1 < len(TIERS))
    assert "TWICE" not in line


def test_a_path_comes_before_every_tier(tiers: Tiers):
    shown = tiers.run("hands", "show", "./mine/barrett", tiers=TIERS)
    assert "that of path" in shown.out


def test_two_hands_of_one_name_in_one_tier_are_refused_when_that_name_is_used(
    tiers: Tiers, tmp_path: Path
):
    other, first = stand_in(tmp_path, "another folder"), tiers.hands["environment"]
    both = f"{first.parent}{os.pathsep}{tmp_path}"
    listed = tiers.run("hands", "list", tiers=(), path=both)
    assert listed.code == 0
    assert f"TWICE: also {other}" in listed.out
    refused = tiers.run("grasp", "hand=barrett", "object=mug", tiers=(), path=both)
    assert refused.code == 2
    assert "hand 'barrett' stands twice in the tier 'environment'" in refused.err
    assert str(first) in refused.err
    assert str(other) in refused.err
    assert "Traceback" not in refused.err
    by_path = tiers.run("hands", "show", str(other), tiers=(), path=both)
    assert "that of another folder" in by_path.out
