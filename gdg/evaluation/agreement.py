"""How far simulators agree about the same grasps."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gdg.data.atomic import write_text_atomically
from gdg.data.json_values import finite_or_none
from gdg.data.verdict import Verdict
from gdg.evaluation.cell import Result
from gdg.evaluation.rows import POOLED, flat
from gdg.evaluation.tables import markdown_table, number, percent, span
from gdg.metrics import Rate, cohen_kappa

#: What a passing grasp's outcome is called beside the failures' names.
PASS = "pass"
#: All grasps of a comparison.
ALL = "all"

#: The verdicts of two simulators on one grasp.
_Pair = tuple[Verdict, Verdict]


@dataclass(frozen=True)
class Confusion:
    """How often two simulators said yes and no to the same grasps.

    Attributes:
        both: both let the grasp pass.
        only_first: only the first did.
        only_second: only the second did.
        neither: neither did.
    """

    both: int
    only_first: int
    only_second: int
    neither: int

    @classmethod
    def of(cls, pairs: Sequence[_Pair]) -> Confusion:
        """Counts verdicts."""
        counts = Counter((first.success, second.success) for first, second in pairs)
        orders = ((True, True), (True, False), (False, True), (False, False))
        return cls(*(counts[order] for order in orders))

    @property
    def same(self) -> Rate:
        """Grasps on which both said the same."""
        n = self.both + self.only_first + self.only_second + self.neither
        return Rate(self.both + self.neither, n)

    @property
    def kappa(self) -> float:
        """Cohen's kappa; NaN where chance alone makes them agree."""
        return cohen_kappa(self.both, self.only_first, self.only_second, self.neither)

    @property
    def p_value(self) -> float:
        """Exact McNemar test: how likely so one-sided differences are if neither is stricter."""
        n, k = self.only_first + self.only_second, min(self.only_first, self.only_second)
        tail = sum(math.comb(n, i) for i in range(k + 1)) / 2**n
        return min(1.0, 2 * tail)

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        counts = {name: getattr(self, name) for name in CONFUSION}
        return {
            **counts,
            "same": self.same.as_dict(),
            "kappa": self.kappa,
            "p_value": self.p_value,
        }


#: The counts of a ``Confusion``, in order.
CONFUSION = ("both", "only_first", "only_second", "neither")


@dataclass(frozen=True)
class Agreement:
    """Two simulators (or two settings of one) on the same grasps, under the same protocol.

    Attributes:
        first: one simulator, with those of its options that differ between them.
        second: the other.
        where: ``all``, or the settings of the grasps in question.
        matrix: all these grasps.
        stable: those whose trials all agree in both simulators: where a tiny shift of the hand
            does not change the verdict, it is the simulators that differ.
        outcomes: (outcome of the first, of the second, grasps): ``pass`` or the failure's name,
            the commonest first.
    """

    first: str
    second: str
    where: str
    matrix: Confusion
    stable: Confusion
    outcomes: tuple[tuple[str, str, int], ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as they stand in ``agreement.json``."""
        return {
            "first": self.first,
            "second": self.second,
            "where": self.where,
            "matrix": self.matrix.as_dict(),
            "stable": self.stable.as_dict(),
            "outcomes": [list(outcome) for outcome in self.outcomes],
        }


def agreements(results: Sequence[Result]) -> list[Agreement]:
    """Every pair of simulators of a grid: on all its grasps, then by setting where these differ.

    Empty where the grid has one simulator only. Grasps are the same where the plan's key is.
    """
    tested = [(r, flat(r.cell.config.as_tree())) for r in results if r.grasps is not None]
    names = _names([tree for _, tree in tested])
    found = []
    for first, second in itertools.combinations(dict.fromkeys(names), 2):
        groups = _pairs(tested, names, first, second)
        together = [pair for pairs in groups.values() for pair in pairs]
        parts = {ALL: together, **(groups if len(groups) > 1 else {})}
        found += [_agreement(first, second, where, pairs) for where, pairs in parts.items()]
    return [agreement for agreement in found if agreement.matrix.same.n]


def _agreement(first: str, second: str, where: str, pairs: Sequence[_Pair]) -> Agreement:
    counts = Counter((_outcome(a), _outcome(b)) for a, b in pairs)
    settled = [(a, b) for a, b in pairs if a.stable is True and b.stable is True]
    outcomes = tuple((a, b, count) for (a, b), count in counts.most_common())
    return Agreement(first, second, where, Confusion.of(pairs), Confusion.of(settled), outcomes)


def _outcome(verdict: Verdict) -> str:
    return PASS if verdict.success else verdict.failure


def _names(trees: Sequence[dict[str, str]]) -> list[str]:
    """The simulator of each cell, with its options where one simulator has several."""
    by_name: dict[str, list[dict[str, str]]] = {}
    for tree in trees:
        by_name.setdefault(tree["simulator"], []).append(_options(tree))
    names = []
    for tree in trees:
        others, own = by_name[tree["simulator"]], _options(tree)
        differing = [k for k in own if any(other[k] != own[k] for other in others)]
        words = [f"{key.removeprefix('simulator.')}={own[key]}" for key in differing]
        names.append(" ".join([tree["simulator"], *words]))
    return names


def _options(tree: dict[str, str]) -> dict[str, str]:
    return {key: value for key, value in tree.items() if key.startswith("simulator.")}


def _pairs(
    tested: Sequence[tuple[Result, dict[str, str]]], names: Sequence[str], first: str, second: str
) -> dict[str, list[_Pair]]:
    """Setting -> the verdicts of both simulators on each grasp."""
    sides: tuple[dict[str, tuple[Result, dict[str, str]]], ...] = ({}, {})
    for (result, tree), name in zip(tested, names, strict=True):
        if name in (first, second):
            sides[name == second][_circumstances(result, tree)] = result, tree
    shared = [key for key in sides[0] if key in sides[1]]
    trees = [sides[0][key][1] for key in shared]
    varying = [
        key
        for key in (trees[0] if trees else ())
        if key not in POOLED and not key.startswith("simulator")
        and len({tree.get(key) for tree in trees}) > 1
    ]  # fmt: skip
    groups: dict[str, list[_Pair]] = {}
    for key, tree in zip(shared, trees, strict=True):
        where = " · ".join(f"{name}={tree.get(name, '')}" for name in varying) or ALL
        (a, _), (b, _) = sides[0][key], sides[1][key]
        assert a.grasps is not None
        assert b.grasps is not None
        groups.setdefault(where, []).extend(zip(a.grasps.verdicts, b.grasps.verdicts, strict=True))
    return groups


def _circumstances(result: Result, tree: dict[str, str]) -> str:
    """Equal for the same grasps under the same protocol, whatever the simulator."""
    job = {key: tree[key] for key in ("protocol", "refine")}
    return json.dumps([result.cell.plan_key, job])


def agreement_lines(agreement: Agreement) -> list[str]:
    """An agreement as Markdown that reads well on a terminal, too."""
    first, second, matrix = agreement.first, agreement.second, agreement.matrix
    low_high = span(matrix.same.interval)
    lines = [
        f"## {first} and {second}: {agreement.where}",
        "",
        markdown_table(
            ["", f"{second} passes", f"{second} fails"],
            [
                [f"{first} passes", str(matrix.both), str(matrix.only_first)],
                [f"{first} fails", str(matrix.only_second), str(matrix.neither)],
            ],
        ),
        f"The same verdict on {percent(matrix.same.share)} % of {matrix.same.n} grasps "
        f"(95 %: {low_high}), Cohen's kappa {number(matrix.kappa, 2)}; McNemar p = "
        f"{number(matrix.p_value, 3)} that neither is stricter.",
    ]
    if agreement.stable.same.n:
        stable = agreement.stable
        lines.append(
            f"Of the {stable.same.n} grasps whose trials all agree in both, "
            f"{percent(stable.same.share)} % (95 %: {span(stable.same.interval)}), kappa "
            f"{number(stable.kappa, 2)}."
        )
    rows = [[a, b, str(count)] for a, b, count in agreement.outcomes]
    return [*lines, "", markdown_table([first, second, "grasps"], rows)]


def write_agreements(folder: Path, found: Sequence[Agreement]) -> None:
    """Writes ``agreement.json`` and ``agreement.md``."""
    tree = finite_or_none([agreement.as_dict() for agreement in found])
    write_text_atomically(folder / "agreement.json", json.dumps(tree, indent=1) + "\n")
    text = "\n".join("\n".join(agreement_lines(agreement)) for agreement in found)
    write_text_atomically(folder / "agreement.md", f"# Agreement of simulators\n\n{text}")
