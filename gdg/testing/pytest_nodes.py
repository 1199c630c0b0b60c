"""What pytest collects for the conformance kit: a hand or component, and its checks."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, Generic, TypeVar

import pytest

from gdg.components import KINDS, config_key
from gdg.errors import GdgError
from gdg.folders import HANDS
from gdg.pipeline.jobs import DEFAULTS
from gdg.testing.checks import Check, attempt, check_name, run_check
from gdg.testing.component import KITS, component_case
from gdg.testing.findings import Finding, error, errors_in
from gdg.testing.hand import CHECKS as HAND_CHECKS
from gdg.testing.hand import Inspection, load_case
from gdg.yaml_files import parse_yaml

Case = TypeVar("Case")


class HandWarning(UserWarning):
    """Something about a hand that a person should look at."""


class Failed(Exception):
    """What a check found, told without a traceback."""


class Checked(pytest.Collector, Generic[Case]):
    """A hand or a component: its first item says whether it can be used, the others check it."""

    def collect(self) -> list[pytest.Item]:
        """One item that loads it, and one per check."""
        return [
            Loads.from_parent(self, name="can be loaded"),
            *(
                CheckItem.from_parent(self, name=check_name(check), check=check)
                for check in self.checks
            ),
        ]

    @property
    @abstractmethod
    def checks(self) -> Sequence[Check[Case, Any]]:
        """What is checked."""

    @cached_property
    @abstractmethod
    def loaded(self) -> tuple[Case | None, list[str]]:
        """What the checks are given, or None and why not."""

    @abstractmethod
    def problems(self, check: Check[Case, Any], case: Case) -> list[str]:
        """What one check finds wrong."""


class _Item(pytest.Item):
    parent: Checked[Any]

    def reportinfo(self) -> tuple[Any, None, str]:
        """The name under which the item is reported."""
        return self.path, None, f"{self.parent.name}: {self.name}"

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """The findings alone; anything else with its traceback."""
        if isinstance(excinfo.value, Failed):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)


class Loads(_Item):
    """Passes if the hand or component can be loaded."""

    def runtest(self) -> None:
        """Raises with every reason why not."""
        _fail(self.parent.loaded[1])


class CheckItem(_Item):
    """One check."""

    def __init__(self, *, check: Check[Any, Any], **kwargs: Any):
        super().__init__(**kwargs)
        self.check = check

    def runtest(self) -> None:
        """Raises with everything that the check finds."""
        case, _ = self.parent.loaded
        if case is None:
            pytest.skip("it can't be loaded")
        _fail(self.parent.problems(self.check, case))


def _fail(problems: list[str]) -> None:
    if problems:
        raise Failed("\n".join(problems))


class CheckedHand(Checked[Any]):
    """A hand folder."""

    def __init__(self, *, given: str, **kwargs: Any):
        super().__init__(**kwargs)
        self.given = given

    @property
    def checks(self) -> Sequence[Check[Any, Finding]]:
        """The checks of hands."""
        return HAND_CHECKS

    @cached_property
    def loaded(self) -> tuple[Any, list[str]]:
        """The hand with its model."""
        try:
            folder = HANDS.find(self.given).path
        except GdgError as mistake:
            return None, [str(mistake)]
        inspected: Inspection = load_case(folder)
        return inspected.case, [str(finding) for finding in inspected.findings]

    def problems(self, check: Check[Any, Finding], case: Any) -> list[str]:
        """Errors; warnings appear in pytest's summary of warnings."""
        findings = attempt(check, case, lambda text: error("", text))
        for finding in findings:
            if finding.severity == "warning":
                warnings.warn(HandWarning(str(finding)), stacklevel=1)
        return [str(finding) for finding in errors_in(findings)]


class CheckedComponent(Checked[Any]):
    """A component with options."""

    def __init__(self, *, kind: str, component: str, words: Sequence[str], **kwargs: Any):
        super().__init__(**kwargs)
        self.kind, self.component, self.words = kind, component, words

    @property
    def checks(self) -> Sequence[Check[Any, str]]:
        """The checks of its kind."""
        return KITS[self.kind][1]

    @cached_property
    def loaded(self) -> tuple[Any, list[str]]:
        """The built component with what it is tried on."""

        def build(words: Sequence[str]) -> Iterable[Any]:
            options, uses = _settings(words)
            return [component_case(self.kind, self.component, uses, options)]

        (found,) = attempt(build, self.words, Failed)
        return (None, [str(found)]) if isinstance(found, Failed) else (found, [])

    def problems(self, check: Check[Any, str], case: Any) -> list[str]:
        """What is told, each after the check's name."""
        return run_check(check, case)


def checked_hand(session: pytest.Session, label: str, given: str) -> CheckedHand:
    """Collects the checks of the hand that a name or a folder's path means."""
    name = f"hand {label}"
    return CheckedHand.from_parent(session, name=name, nodeid=name, given=given)


def checked_component(
    session: pytest.Session, kind: str, component: str, words: tuple[str, ...]
) -> CheckedComponent:
    """Collects the checks of a component with ``key=value`` options."""
    name = f"{kind} {' '.join((component, *words))}"
    return CheckedComponent.from_parent(
        session, name=name, nodeid=name, kind=kind, component=component, words=words
    )


def _settings(words: Sequence[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Own options, and components to use with theirs, from ``key=value`` words.

    Raises:
        GdgError: a word without ``=``, or a value that is no YAML.
    """
    options: dict[str, Any] = {}
    uses: dict[str, Any] = {}
    kinds = {config_key(kind): kind for kind in KINDS}
    for word in words:
        key, equals, text = word.partition("=")
        if not equals:
            raise GdgError(f"'{word}' must be written key=value.")
        head, _, option = key.partition(".")
        value = parse_yaml(text, word)
        if head in kinds:
            used = uses.setdefault(kinds[head], {"name": DEFAULTS[head]})
            used[option or "name"] = value
        else:
            options[key] = value
    return options, uses
