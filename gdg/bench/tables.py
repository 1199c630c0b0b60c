"""The tables: their rows, the published numbers, and what the paper claims of them. Light.

Figures are those of GenDexGrasp (Li et al., ICRA 2023), tables I to III.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gdg.errors import GdgError, did_you_mean

SOURCE = "Li et al., GenDexGrasp, ICRA 2023"


@dataclass(frozen=True)
class Published:
    """What the paper reports of one row.

    Attributes:
        success: per cent.
        diversity_rad: standard deviation of the joint values of passing grasps.
        seconds: per grasp.
        at_least: whether the seconds are a lower bound.
    """

    success: float
    diversity_rad: float | None = None
    seconds: float | None = None
    at_least: bool = False


@dataclass(frozen=True)
class Method:
    """One row of a table.

    Attributes:
        label: unique in its table.
        hand: name of the hand.
        words: settings that make the row.
        published: the paper's numbers; None for a row that the paper does not have.
        weights: name of the generator's weights, or "" where the row needs none.
        distance: of the maps that these are trained on.
        planner_weights: whether the planner has weights of its own, one set per hand.
        most: grasps that the method finds per object at most, or 0 where there is no such limit.
        quick: settings of ``--quick`` for this row alone.
        fixed: component groups that are part of the method: of the user's settings, those of these
            groups don't count in the row.
    """

    label: str
    hand: str
    words: tuple[str, ...]
    published: Published | None = None
    weights: str = ""
    distance: str = "aligned"
    planner_weights: bool = False
    most: int = 0
    quick: tuple[str, ...] = ()
    fixed: tuple[str, ...] = ()

    @property
    def held_out(self) -> str:
        """Name of the hand that the weights must not have seen, or ""."""
        return self.weights.partition("without-")[2]

    @property
    def planner(self) -> str:
        """Name of the row's planner."""
        names = [word.partition("=")[2] for word in self.words if word.startswith("planner=")]
        return names[0]


@dataclass(frozen=True)
class Claim:
    """Something that the paper says of two rows, in a form that numbers can contradict.

    Attributes:
        text: the sentence.
        measure: ``success`` (difference of shares), ``diversity`` (difference in rad) or ``speed``
            (log of how many times less the first row takes).
        first: label of a row.
        second: label of the row that it is compared with.
        margin: the claim holds if the first exceeds the second by more than this, in the
            measure's unit; below 0 for *not much worse*.
        others: further pairs of rows; the claim is about the mean over all pairs.
    """

    text: str
    measure: Literal["success", "diversity", "speed"]
    first: str
    second: str
    margin: float = 0.0
    others: tuple[tuple[str, str], ...] = ()

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Labels of all rows, each with that of the row that it is compared with."""
        return ((self.first, self.second), *self.others)


@dataclass(frozen=True)
class BenchTable:
    """A table of the paper.

    Attributes:
        name: what users type.
        title: above it.
        methods: its rows, in the paper's order.
        claims: what the paper says of them.
    """

    name: str
    title: str
    methods: tuple[Method, ...]
    claims: tuple[Claim, ...]


#: The row of the paper's method, in its own settings.
PUBLISHED = "GenDexGrasp, as published"
#: Hands of tables II and III, with the paper's success of: aligned distance and hand not seen in
#: training; Euclidean distance, likewise; aligned distance and hand seen.
HANDS = {
    "ezgripper": (38.59, 29.53, 43.44),
    "barrett": (70.31, 52.19, 71.72),
    "shadowhand": (77.19, 58.91, 77.03),
}
#: An unseen hand that costs no more than this costs little.
LITTLE = 0.05
#: ln of how many times faster than force-closure search the paper's method is, at least.
MUCH_FASTER = 4.605
_DFC_QUICK = ("planner.batch=16", "planner.steps=60", "planner.max_batches=1")
_ADAPT_QUICK = ("planner.adapt_steps=20",)
_UNIGRASP_QUICK = ("planner.width=16", "planner.branch=4", "planner.starts=4", "planner.steps=20")


#: GenDexGrasp's own settings where our defaults are others: those of its authors' code, but for the
#: joint limits, which are part of the energy as in the paper.
AS_PUBLISHED = (
    "generator=cvae", "generator.temperature=1", "fitter=adam", "fitter.particles=32",
    "fitter.steps=100", "fitter.learning_rate=0.005", "fitter.start=sphere",
    "fitter.start_factor=1", "fitter.sharpen=true", "fitter.extra_weight=1",
    "fitter.limit_weight=1",
    "fitter.search_every=1", "fitter.penetration=nearest",
    "fitter.penetration_weight=1", "fitter.penetration_ramp=1", "fitter.self_weight=0",
    "fitter.keep=1", "planner.maps=1", "planner.rank=energy", "planner.close=false",
)  # fmt: skip
_FIT_QUICK = ("fitter.particles=8", "fitter.steps=30")


def _unigrasp(top: int, success: float, diversity_rad: float, seconds: float | None) -> Method:
    return Method(
        f"UniGrasp top-{top}",
        "shadowhand",
        ("planner=unigrasp", f"planner.top={top}"),
        Published(success, diversity_rad, seconds),
        planner_weights=True,
        most=top,
        quick=_UNIGRASP_QUICK,
    )


def _ours(
    label: str, hand: str, weights: str, distance: str = "aligned", success: float | None = None
) -> Method:
    """Our planner in its default settings, beside the paper's success."""
    words = ("planner=contact-map", f"distance={distance}")
    published = None if success is None else Published(success)
    return Method(label, hand, words, published, weights=weights, distance=distance)


def _claims_of_hands(text: str, how: str, other: str, margin: float = 0.0) -> tuple[Claim, ...]:
    """A claim about the success of each hand's two rows, and about all hands together."""
    (first, second), *more = pairs = [(f"{hand}, {how}", f"{hand}, {other}") for hand in HANDS]
    together = Claim(f"{text}, over all hands", "success", first, second, margin, tuple(more))
    each = (
        Claim(f"{text}: {hand}", "success", *pair, margin)
        for hand, pair in zip(HANDS, pairs, strict=True)
    )
    return (together, *each)


TABLE_1 = BenchTable(
    "table1",
    "Methods on ShadowHand, which GenDexGrasp has not seen in training",
    (
        Method(
            "DFC",
            "shadowhand",
            ("planner=dfc",),
            Published(79.53, 0.344, 1800.0, at_least=True),
            quick=_DFC_QUICK,
        ),
        Method(
            "GraspCVAE",
            "shadowhand",
            ("planner=graspcvae", "planner.adapt=false"),
            Published(19.38, 0.340, 0.012),
            planner_weights=True,
        ),
        Method(
            "GraspCVAE, adapted",
            "shadowhand",
            ("planner=graspcvae", "planner.adapt=true"),
            Published(22.03, 0.355, 43.2),
            planner_weights=True,
            quick=_ADAPT_QUICK,
        ),
        _unigrasp(1, 80.0, 0.000, 9.33),
        _unigrasp(8, 50.0, 0.167, None),
        _unigrasp(32, 48.4, 0.202, None),
        Method(
            PUBLISHED,
            "shadowhand",
            ("planner=contact-map", "distance=aligned", *AS_PUBLISHED),
            Published(77.19, 0.207, 16.4),
            weights="without-shadowhand",
            quick=_FIT_QUICK,
            fixed=("generator", "fitter"),
        ),
        _ours("gdg", "shadowhand", "without-shadowhand"),
    ),
    (
        Claim("GenDexGrasp comes within 5 points of DFC's success", "success",
              PUBLISHED, "DFC", -LITTLE),
        Claim("GenDexGrasp succeeds more often than GraspCVAE", "success",
              PUBLISHED, "GraspCVAE"),
        Claim("GenDexGrasp succeeds more often than GraspCVAE with adaptation", "success",
              PUBLISHED, "GraspCVAE, adapted"),
        Claim("Adaptation makes GraspCVAE succeed more often", "success",
              "GraspCVAE, adapted", "GraspCVAE"),
        Claim("GenDexGrasp succeeds more often than UniGrasp top-32", "success",
              PUBLISHED, "UniGrasp top-32"),
        Claim("UniGrasp top-1 succeeds more often than top-32", "success",
              "UniGrasp top-1", "UniGrasp top-32"),
        Claim("DFC's grasps are more diverse than GenDexGrasp's", "diversity",
              "DFC", PUBLISHED),
        Claim("GenDexGrasp's grasps are more diverse than UniGrasp's top-32", "diversity",
              PUBLISHED, "UniGrasp top-32"),
        Claim("GenDexGrasp is at least 100 times as fast as DFC", "speed",
              PUBLISHED, "DFC", MUCH_FASTER),
    ),
)  # fmt: skip

TABLE_2 = BenchTable(
    "table2",
    "Aligned and Euclidean distance on hands not seen in training",
    tuple(
        _ours(f"{hand}, {distance}", hand, weights, distance, success)
        for hand, (aligned, euclidean, _) in HANDS.items()
        for distance, success, weights in (
            ("aligned", aligned, f"without-{hand}"),
            ("euclidean", euclidean, f"euclidean-without-{hand}"),
        )
    ),
    _claims_of_hands(
        "With gdg's fit the aligned distance succeeds more often", "aligned", "euclidean"
    ),
)

TABLE_3 = BenchTable(
    "table3",
    "Hands seen and not seen in training",
    tuple(
        _ours(f"{hand}, {how}", hand, weights, success=success)
        for hand, (unseen, _, seen) in HANDS.items()
        for how, success, weights in (("seen", seen, "full"), ("unseen", unseen, f"without-{hand}"))
    ),
    _claims_of_hands(
        "With gdg's fit, a hand that was not seen costs at most 5 points", "unseen", "seen", -LITTLE
    ),
)

TABLES = {table.name: table for table in (TABLE_1, TABLE_2, TABLE_3)}


def find_table(name: str) -> BenchTable:
    """The table of a name.

    Raises:
        GdgError: there is none of that name (with a suggestion).
    """
    if name not in TABLES:
        raise GdgError(f"Unknown table '{name}'.{did_you_mean(name, TABLES)}")
    return TABLES[name]
