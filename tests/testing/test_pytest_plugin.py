"""Third parties run the conformance kit by an option or a setting of pytest."""

from __future__ import annotations

import subprocess
import sys

import pytest
from gripper import write_gripper

pytest_plugins = ["pytester"]


def test_hands_and_components_are_checked_by_options(pytester: pytest.Pytester):
    folder = write_gripper(pytester.path)
    manifest = folder / "hand.yaml"
    manifest.write_text(manifest.read_text().replace("[0, 0, 1]", "[0, 0, -1]"))
    pytester.makepyfile("def test_of_its_own(): pass")
    result = pytester.runpytest_subprocess(
        "--gdg-hand", "alegro", "--gdg-hand", str(folder), "-v",
        "--gdg-component", "distance/aligned preset=paper",
        "--gdg-component", "distance/alinged",
        "--gdg-component", "distance/aligned gama=1",
    )  # fmt: skip
    result.stdout.fnmatch_lines(
        [
            "hand alegro::can be loaded FAILED*",
            "hand alegro::palm SKIPPED (it can't be loaded)*",
            f"*hand {folder}::can be loaded PASSED*",
            f"*hand {folder}::palm FAILED*",
            "distance aligned preset=paper::gradient PASSED*",
            "distance alinged::can be loaded FAILED*",
            "*distance aligned gama=1::can be loaded FAILED*",
            "*Unknown hand 'alegro'*",
            "*two_jaws/hand.yaml: palm.normal: must point out of the palm*",
            "*Did you mean 'aligned'*",
            "*gama: there is no such option*",
            "*HandWarning: *two_jaws.urdf: links 'left', 'right': no mass is given*",
        ]
    )
    assert "test_of_its_own" not in result.stdout.str()
    assert "Traceback" not in result.stdout.str()
    assert result.ret == pytest.ExitCode.TESTS_FAILED


def test_settings_are_checked_in_a_whole_run_and_left_out_when_tests_are_named(
    pytester: pytest.Pytester,
):
    write_gripper(pytester.path / "hands")
    pytester.makeini(
        "[pytest]\ngdg_hands =\n  hands/*\n  arms/*\ngdg_components =\n  distance/euclidean"
    )
    pytester.makepyfile("def test_of_its_own(): pass")
    result = pytester.runpytest_subprocess("-k", "own or gradient or closed", "-v")
    outcomes = result.parseoutcomes()
    assert (outcomes["passed"], outcomes.get("failed", 0)) == (4, 0)
    result.stdout.fnmatch_lines(
        [
            "*collected * items / * deselected / 4 selected*",
            "hand hands/two_jaws::closed posture PASSED*",
            "distance euclidean::gradient PASSED*",
        ]
    )
    result.stdout.fnmatch_lines(["*gdg_hands: no hand folder matches 'arms/[*]'*"])
    named = pytester.runpytest_subprocess(
        "test_settings_are_checked_in_a_whole_run_and_left_out_when_tests_are_named.py"
    )
    named.assert_outcomes(passed=1)


def test_components_are_handed_those_that_are_named(pytester: pytest.Pytester):
    result = pytester.runpytest_subprocess(
        "--gdg-component", "fitter/adam particles=2 steps=2 distance=euclidean",
        "--gdg-component", "fitter/adam distance=euclidaen", "-k", "one or loaded",
    )  # fmt: skip
    outcomes = result.parseoutcomes()
    assert (outcomes["passed"], outcomes["failed"], outcomes["skipped"]) == (2, 1, 1)
    result.stdout.fnmatch_lines(["*Did you mean 'euclidean'*"])


@pytest.mark.parametrize("given", ["distanse/aligned", "aligned", "distance/"])
def test_a_kind_that_does_not_exist_is_a_usage_error(given: str, pytester: pytest.Pytester):
    result = pytester.runpytest_subprocess("--gdg-component", given)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*must be written KIND/NAME*"])


def test_the_plugin_imports_nothing_until_it_is_asked_to_check():
    code = (
        "import sys; before = set(sys.modules); import gdg.testing.pytest_plugin; "
        "print(*sorted(m for m in set(sys.modules) - before if m.startswith('gdg')))"
    )
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert finished.stdout.split() == [
        "gdg", "gdg.errors", "gdg.testing", "gdg.testing.findings", "gdg.testing.pytest_plugin",
    ]  # fmt: skip
