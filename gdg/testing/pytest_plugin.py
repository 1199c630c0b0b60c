"""The conformance kit in pytest: each check of a hand or component is one test.

Loaded in every pytest run where gdg is installed, so it imports only pytest until it is asked to
check something::

    pytest --gdg-hand hands/acme
    pytest --gdg-component "fitter/my-fitter steps=5 distance=euclidean"

or for good, in ``pyproject.toml``::

    [tool.pytest.ini_options]
    gdg_hands = ["hands/*"]
    gdg_components = ["distance/my-distance"]
"""

from __future__ import annotations

import warnings

import pytest

HAND_HELP = "check the hand in this folder, or of this name (may be given again)"
COMPONENT_HELP = (
    "check this component, KIND/NAME, with options after it: "
    "'fitter/my-fitter steps=5 distance=euclidean' (may be given again)"
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options and settings that name what to check."""
    group = parser.getgroup("gdg", "conformance of hands and components")
    group.addoption("--gdg-hand", action="append", default=[], metavar="HAND", help=HAND_HELP)
    group.addoption(
        "--gdg-component", action="append", default=[], metavar="KIND/NAME", help=COMPONENT_HELP
    )
    parser.addini("gdg_hands", "patterns of hand folders to check", type="linelist")
    parser.addini("gdg_components", "components to check, KIND/NAME", type="linelist")


def pytest_configure(config: pytest.Config) -> None:
    """Runs the named checks alone, unless files or tests are given beside them."""
    if _named(config, "--gdg-hand") + _named(config, "--gdg-component") and not _has_files(config):
        config.args = []


@pytest.hookimpl(tryfirst=True)  # before -k and -m choose among the items
def pytest_collection_modifyitems(
    session: pytest.Session, config: pytest.Config, items: list[pytest.Item]
) -> None:
    """Adds one item per check of everything that was named.

    What the settings name is left out when hands, components, files or tests are given on the
    command line.
    """
    hands = {given: given for given in _named(config, "--gdg-hand")}
    components = _named(config, "--gdg-component")
    if not (hands or components or _has_files(config)):
        hands = _folders(config)
        components = _setting(config, "gdg_components")
    asked = [_component(text) for text in dict.fromkeys(components)]
    if not (hands or asked):
        return
    from gdg.testing.pytest_nodes import checked_component, checked_hand

    found: list[pytest.Collector] = [checked_hand(session, *hand) for hand in hands.items()]
    found += [checked_component(session, *component) for component in asked]
    for collector in found:
        report = session.ihook.pytest_make_collect_report(collector=collector)
        session.ihook.pytest_collectreport(report=report)  # so that pytest counts the items
        items += report.result


def _component(text: str) -> tuple[str, str, tuple[str, ...]]:
    """Kind, name and the words after them."""
    from gdg.components import KINDS
    from gdg.errors import did_you_mean

    what, *words = text.split() or [text]
    kind, _, name = what.partition("/")
    if kind not in KINDS or not name:
        hint = did_you_mean(kind, KINDS)
        raise pytest.UsageError(f"gdg component '{what}' must be written KIND/NAME.{hint}")
    return kind, name, tuple(words)


def _has_files(config: pytest.Config) -> bool:
    return config.args_source == pytest.Config.ArgsSource.ARGS


def _named(config: pytest.Config, option: str) -> list[str]:
    return [str(given) for given in config.getoption(option) or ()]


def _setting(config: pytest.Config, name: str) -> list[str]:
    return [line for line in config.getini(name) if line]


def _folders(config: pytest.Config) -> dict[str, str]:
    """Hand folders that the settings' patterns match, by their path from the settings' file."""
    root = config.inipath.parent if config.inipath else config.rootpath
    found: dict[str, str] = {}
    for pattern in _setting(config, "gdg_hands"):
        matching = [path for path in sorted(root.glob(pattern)) if (path / "hand.yaml").is_file()]
        found |= {path.relative_to(root).as_posix(): str(path) for path in matching}
        if not matching:
            text = f"gdg_hands: no hand folder matches '{pattern}' in {root}"
            warnings.warn(pytest.PytestConfigWarning(text), stacklevel=1)
    return found
