"""What the project says of itself: each sentence with the bounds on stored rows that can refute it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd

from lagrange_bench.experiments import heavy_top, work_precision
from lagrange_bench.experiments.catalogue import load
from lagrange_bench.experiments.drawing.tables import flat, show
from lagrange_bench.experiments.measuring.metrics import ROUND_OFF
from lagrange_bench.experiments.measuring.states import CLOSE, RANDOM, WIDE, methods_on
from lagrange_bench.integrators.interface import INVARIANTS
from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.integrators.registry import BUILT_IN, METHODS, available
from lagrange_bench.report.claims import Bound, Claim, Found, NoData, Refuted, select, values

ULP = 2 * ROUND_OFF
RATIO, TARGET = "times as long as the exact step inside", "error at most"  # columns of the table of perturbed tops
RANDOM_TOPS = tuple(f"random{i:03d}" for i in range(200))
THEORY_TOPS = ("generic", "figure1", "fast", "through_pole")
EXACT = ("backlund", "closed-form")
SPACINGS = (0.125, 0.5, 0.95, 2.5)  # of the output, in nutation periods
MAGNETS = (2, 3, 4, 5, 8, 12)  # their numbers of spins


Tables = dict[str, pd.DataFrame]
Measure = Callable[[pd.DataFrame], Any]
_TABLES: dict[str, tuple[pd.DataFrame, Tables]] = {}  # of each experiment the rows judged last, and their tables


def keep(experiment: str, rows: pd.DataFrame, made: Tables) -> None:
    """Hand the claims the tables of these rows: several ask for the same, and the page has made them already."""
    _TABLES[experiment] = (rows, made)


def table(experiment: str, name: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """The named table an experiment makes of its rows."""

    def derive(rows: pd.DataFrame) -> pd.DataFrame:
        if experiment not in _TABLES or _TABLES[experiment][0] is not rows:
            made = load(experiment).tables(rows)
            keep(experiment, rows, {each: flat(frame) for each, frame in made.items()})
        found = _TABLES[experiment][1].get(name, pd.DataFrame())
        if found.empty:
            raise NoData(f"no table {name!r}")
        return found

    return derive


def entries(experiment: str, name: str, *columns: str, **where: Any) -> Measure:
    """Columns of a table, in the lines with the given fields."""
    return lambda rows: values(table(experiment, name)(rows), *columns, **where)


# ---------------------------------------------------------------- claims about all methods at once


def orders_as_claimed(rows: pd.DataFrame) -> Found:
    """Distances of measured orders from those claimed, over methods of finite order with a fixed step."""
    orders = table("phase", "orders")(rows)
    orders = orders[(orders.claimed != "exact") & orders.state.str.endswith("8 tops")]
    if orders.empty:
        raise NoData("no order was measured")
    hidden = sorted(set(orders[orders.hidden].method))
    finite = orders[~orders.hidden]
    if (finite.points < 3).any():
        raise Refuted(f"no order was measured of {', '.join(finite[finite.points < 3].method)}")
    away = (finite.measured - finite.claimed.astype(float)).abs()
    note = f"orders of {len(finite)} methods with a fixed step; worst: {finite.method[away.fillna(np.inf).idxmax()]}"
    if hidden:
        note += f"; steeper, the leading term being too small to show above round-off: {', '.join(hidden)}"
    return Found(away, note)


def taken_by_theory(rows: pd.DataFrame) -> Found:
    """The share of a measured error that theory takes away, of each run whose error says something."""
    stepping = {name for name, method in methods_on().items() if method.control == "step" and method.order is not None}
    asked = stepping & set(BUILT_IN)  # of a plug-in there is no theory
    if missing := sorted(asked - set(rows[rows.part == "theory"].method)):
        raise NoData(f"not held against theory: {', '.join(missing)}")
    found = table("phase", "theory")(rows)
    judged = found[found.method.isin(asked) & found["in range"].eq(True)]
    if unseen := sorted(asked - set(judged.method)):
        raise Refuted(f"no prediction, or no error in range, of {', '.join(unseen)}")
    worst = judged.loc[judged["share left"].fillna(np.inf).idxmax()]
    note = f"{len(judged)} runs of {len(asked)} methods with a fixed step; "
    note += f"worst: {worst.method}, {worst.state}, h = {show(worst.h)}"
    if without := int((found.method.isin(asked) & found["in range"].isna()).sum()):
        note += f"; no prediction for {without} more, where the series does not converge"
    return Found(1.0 - judged["share left"], note)


def kept_as_claimed(rows: pd.DataFrame) -> Found:
    """Growth exponents of what methods claim to conserve and do not themselves call biased."""
    found = all_methods(table("drift", "verdicts")(rows))
    asked = found[found.claimed & (found["biased, as the method says"] == "")]
    if (asked.verdict == "failed").any():
        bad = asked[asked.verdict == "failed"].iloc[0]
        raise Refuted(f"{bad.method}: {bad.invariant} is not finite")
    walking = asked[~asked.verdict.isin(("exact", "round-off"))]  # of an error of a few ulps the slope says nothing
    if walking.empty:
        raise NoData("no claimed invariant moves by more than sixteen ulps")
    worst = walking.loc[walking.exponent.fillna(np.inf).idxmax()]  # one that cannot be measured does not pass
    excused = found[found.claimed & (found["biased, as the method says"] != "")]
    note = f"{len(asked)} invariants claimed by {asked.method.nunique()} methods; worst: {worst.invariant} of {worst.method}"
    if len(excused):
        note += f"; called biased: {', '.join(f'{r.invariant} of {r.method}' for r in excused.itertuples())}"
    return Found(walking.exponent, note)


def all_methods(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, if every method of the bench that can run here is among them. Plug-ins are judged where they have rows."""
    if missing := sorted(
        name for name in methods_on() if name in BUILT_IN and available(METHODS[name]) and name not in set(rows.method)
    ):
        raise NoData(f"not measured: {', '.join(missing)}")
    return rows


OF_BODIES = (
    "rattle",
    "simo_wong",
    "lie_midpoint",
    "generalized_alpha",
)  # of order 2, the usual ones in multibody dynamics
BODY_STEPS = {
    case: until / 2 ** heavy_top.POWERS[case][-2] for case, until in heavy_top.UNTIL.items()
}  # the last step but one


def of_whole_body(
    case: str,
    above: tuple[tuple[str, ...], str],
    below: tuple[tuple[str, ...], str],
    sign: str,
    limit: float,
    what: str,
) -> Bound:
    """Errors of methods over those of others at one step on a heavy top: `above` and `below` are methods and their column."""
    where = {"case": case, "h": BODY_STEPS[case], "method": tuple(dict.fromkeys((*above[0], *below[0])))}

    def ratios(rows: pd.DataFrame) -> np.ndarray:
        found = [
            values(rows, column, case=case, h=BODY_STEPS[case], method=name).ravel()
            for names, column in (above, below)
            for name in names
        ]
        numbers, count = np.array(found), len(above[0])
        return (numbers[:count, None] / numbers[None, count:]).ravel()

    return Bound(ratios, sign, limit, "×", where, what=what, ranged=True)


def kept_in_a_field(rows: pd.DataFrame) -> Found:
    """Errors of what methods claim to conserve on tops in a potential, in units of what round-off may make of them."""
    from lagrange_bench.experiments.measuring.check import BIAS, EPS, WALK

    found = table("perturbed", "kept")(rows)
    names, shares = [], []
    for run in found.itertuples():
        for name in filter(None, run.claimed.split(", ")):
            names.append(f"{name} of {run.method} on {run.state}")
            shares.append(float(getattr(run, name)) / (EPS * min(BIAS * run.steps, WALK * run.steps**0.5)))
    if not shares:
        raise NoData("no method that is loaded here claims to conserve anything in a potential")
    worst = names[int(np.argmax(np.nan_to_num(shares, nan=np.inf)))]
    return Found(shares, f"{found.method.nunique()} methods on {found.state.nunique()} tops; worst: {worst}")


TO_TOLERANCE = {
    "part": "tolerance",
    "field": ("random tides", "random charges"),
    "span": (300.0, 3e3, 1e4),
    "tol": (1e-6, 1e-8),
    "tops": 60,
}


def worst_to_tolerance(rows: pd.DataFrame) -> Found:
    """The largest errors in units of the one asked for."""
    found = table("perturbed", "tolerances")(rows)
    return Found(
        found["largest error / tol"], f"{found.answered.sum()} runs; {found.chaotic.sum()} chaotic ones left out"
    )


def refused_tolerances(rows: pd.DataFrame) -> float:
    found = table("perturbed", "tolerances")(rows)
    return float(found.refused.sum() / (found.refused.sum() + found.answered.sum()))


def expected_errors(rows: pd.DataFrame) -> float:
    """Of how many runs the error expected is within a factor of ten of the true one."""
    found = table("perturbed", "tolerances")(rows)
    return float((found["expected within a factor of ten"] * found.answered).sum() / found.answered.sum())


# ---------------------------------------------------------------- who is quicker


def against_others(good: pd.DataFrame, price: str) -> Iterator[tuple[float, str, float, pd.Series, pd.Series]]:
    """Of each run and error: its length, its top, the error, and what Bäcklund maps and methods not exact in time cost."""
    for (span, state), group in good.groupby(["span", "state"], sort=False):
        for target in work_precision.TARGETS:
            found = work_precision.best(group, target, price)
            yield span, state, target, found[found.family == "backlund"][price], found[~found.family.isin(EXACT)][price]


def lead(*errors: tuple[float, float, float]) -> Measure:
    """How many times as long the best method takes that is not exact in time as the best Bäcklund map, set-up counted.

    errors : (length of the runs, largest, smallest error) asked for. The ratio is 0 where no Bäcklund map gets there, ∞ where
    no other method does.
    """

    def measure(rows: pd.DataFrame) -> Found:
        good = work_precision.useful(all_methods(rows))
        ratios = {}
        for span, state, target, ours, others in against_others(good, "total"):
            if any(span == length and least <= target <= most for length, most, least in errors):
                ratio = others.min() / ours.min() if len(ours) and len(others) else np.inf if len(ours) else 0.0
                ratios[f"error {show(target)} at t = {show(span)} on {state}, which {len(others)} others reach"] = ratio
        if not ratios:
            raise NoData("no runs of these lengths")
        return Found(list(ratios.values()), f"closest: {min(ratios, key=lambda run: abs(np.log(ratios[run] or 1e-9)))}")

    return measure


def lead_bound(sign: str, limit: float, what: str, *errors: tuple[float, float, float]) -> Bound:
    """A bound on `lead` over the tops generic and figure1, its least and largest value shown."""
    spans = tuple(dict.fromkeys(span for span, _, _ in errors))
    where = {"span": spans if len(spans) > 1 else spans[0], "state": ("generic", "figure1")}
    return Bound(lead(*errors), sign, limit, "×", where, what=what, ranged=True)


def per_state(rows: pd.DataFrame) -> Found:
    """Time of heyoka over that of the exact step, from one output state to the next."""
    ratio, steps, ours, theirs = values(rows, "ratio", "steps", "backlund_s", "heyoka_s", part="headline").T
    return Found(ratio, f"a state takes {_range(1e9 * ours / steps)} ns, with heyoka {_range(1e6 * theirs / steps)} µs")


def _range(numbers: np.ndarray) -> str:
    least, most = (show(float(number)) for number in (numbers.min(), numbers.max()))
    return least if least == most else f"{least}–{most}"


def relative_error(rows: pd.DataFrame) -> np.ndarray:
    """Errors of the exact step over those of heyoka."""
    ours, theirs = values(rows, "backlund_error", "heyoka_error", part="headline").T
    return np.asarray(ours / theirs)


def setup_in_steps(rows: pd.DataFrame) -> np.ndarray:
    """Set-ups of the exact step, in the quickest of its steps."""
    setups, steps = values(rows, "setup_us", "ns_per_step", part=("step", "periods"), method="backlund").T
    return np.asarray(1e3 * setups / steps.min())


def batch_ratios(rows: pd.DataFrame) -> np.ndarray:
    """The price of a top and a unit of time in heyoka's batches, over that of the best exact step with no larger error."""
    ours, theirs = (values(rows, "ns_per_time", "error", part="rival", method=name) for name in ("backlund", "taylor"))
    return np.array([price / min(ours[ours[:, 1] <= error, 0], default=np.inf) for price, error in theirs])


def long_run_lead(rows: pd.DataFrame) -> Found:
    """The error of the exact step after its last step over heyoka's where that stops, after as long on the clock."""
    runs = [select(rows, part="long", method=name).sort_values("t") for name in ("backlund", "taylor")]
    if any(run.empty for run in runs):
        raise NoData("the exact step and heyoka did not both run")
    far, near = (run.iloc[-1] for run in runs)
    if not far.t > near.t:
        raise Refuted(f"heyoka reached t = {show(near.t)}, the exact step t = {show(far.t)}")
    note = f"exact step: error {show(far.error)} at t = {show(far.t)}; heyoka: {show(near.error)} at t = {show(near.t)}"
    return Found([far.error / near.error], note)


def magnet_orders(rows: pd.DataFrame) -> Found:
    """Distances of measured orders from those claimed, over the Bäcklund maps of the magnet and their rivals."""

    found = table("gaudin", "orders")(rows).set_index("variant").order
    claimed = {name: METHODS[name].order for name in found.index if name in METHODS}
    claimed |= {name: int(name.removeprefix("order ")) for name in found.index if name.startswith("order ")}
    away = {name: abs(found[name] - claimed[name]) for name in found.index if claimed.get(name)}
    if not away:
        raise NoData("no order was measured")
    worst = max(away, key=lambda name: (not np.isfinite(away[name]), away[name]))
    return Found(list(away.values()), f"{len(away)} schemes; worst: {worst}")


def magnet_cost(rows: pd.DataFrame) -> list[float]:
    """heyoka's price of a unit of time over that of the exact step of two units, of each size of the magnet."""
    ratios = []
    for n in sorted({int(n) for (n,) in values(rows, "n", part="cost", variant="exact")}):
        ours, theirs = (
            values(rows, "ns_per_time", part="cost", n=n, variant=name).min() for name in ("exact", "taylor")
        )
        ratios.append(float(theirs / ours))
    return ratios


# ---------------------------------------------------------------- the claims

EVERY_TOP = {"part": "time", "state": (*TOPS, *RANDOM)}
LONG_STEPS = {"part": "long", "state": WIDE, "fraction": (0.51, 1.0, 1.3)}
RANDOM_MAGNETS = {"part": "random", "n": MAGNETS, "h": (1, 5, 20, 80)}
WEAK, STRONG = ("tide_1e-6", "weak_tide"), ("strong_tide", "magnet")


def race(span: float | tuple[float, ...], state: str | tuple[str, ...], *targets: float, **bound: Any) -> Bound:
    """How many times as long the best other method takes as the exact step inside a splitting, set-up counted."""
    measure = entries("perturbed", "winners", RATIO, span=span, state=state, **{TARGET: targets})
    return Bound(measure, where={"part": "work", "span": span, "state": state}, unit="×", ranged=True, **bound)


CLAIMS = [
    Claim(
        "exact-in-time",
        "exactness",
        "One Bäcklund step with λ(h) is the exact motion over the time h, however long h is. Its error is at most what a "
        "change of the initial state by ten ulps would make, on every named top, 200 random ones and 32 close to the "
        "separatrix. On 200 tops of every kind it is sixteen ulps: alpha of either sign, |J|²/(|alpha||x|) from 1e-3 to 1e3. "
        "Steps are from 0.03 to 11 units and from ¼ to 1½ nutation periods, up to 2000 of them (up to t = 20 where the period "
        "is infinite).",
        "phase",
        (
            Bound(("ulps",), "≤", 10.0, "ulps", {"part": "promise", "state": (*TOPS, *RANDOM_TOPS, *CLOSE)}),
            Bound(("ulps",), "≤", 16.0, "ulps", {"part": "promise", "state": WIDE}, what="every kind"),
        ),
        brief="One Bäcklund step of any length is exact but for round-off.",
        about=("backlund",),
    ),
    Claim(
        "exact-for-long",
        "exactness",
        "The pinned Bäcklund step stays exact in runs of 10⁷ and 10⁹ steps of 1/8. After 10⁷ its phase is off by at most "
        "1e-16 of the time: root mean square over sixteen random tops. After 10⁹ on the generic top its error is no larger "
        "than heyoka's after the same time on the clock, although heyoka has then reached an earlier time.",
        "round_off",
        (
            Bound(
                entries("round_off", "forms", "phase error / t", form="pinned, every 8", h=0.125),
                "≤",
                1e-16,
                "of the time",
                {"part": "drift", "form": "pinned, every 8", "h": 0.125, "state": RANDOM},
                steps=10**7,
                what="phase",
            ),
            Bound(
                long_run_lead,
                "≤",
                1.0,
                "of heyoka's",
                {"part": "long", "method": ("backlund", "taylor")},
                steps=10**9,
                what="error",
            ),
        ),
        about=("backlund", "taylor"),
    ),
    Claim(
        "invariants-for-ever",
        "conservation",
        "The pinned Bäcklund step conserves H, J3, C1 and C2 within 16 ulps of their scales over ten million steps of 1/8, on "
        "every named top and sixteen random ones. Pinned: moved back onto the invariants every eighth step.",
        "drift",
        (Bound(INVARIANTS, "≤", 16 * ULP, "of scale", {**EVERY_TOP, "method": "backlund"}, steps=10**7),),
        brief="The pinned Bäcklund step conserves all four invariants over ten million steps.",
        about=("backlund",),
    ),
    Claim(
        "unpinned",
        "conservation",
        "Without pinning the Bäcklund step conserves H, J3, C1 and C2 within 1e-11 over ten million steps of 1/8, on every "
        "named top and sixteen random ones. It does so within 2e-12 over a million steps of 0.51, 1 and 1.3 nutation periods, "
        "on 200 tops with alpha of either sign and |J|²/(|alpha||x|) from 1e-3 to 1e3.",
        "drift",
        (
            Bound(
                INVARIANTS,
                "≤",
                1e-11,
                "of scale",
                {**EVERY_TOP, "method": "backlund_unpinned"},
                steps=10**7,
                what="short steps",
            ),
            Bound(
                INVARIANTS,
                "≤",
                2e-12,
                "of scale",
                {**LONG_STEPS, "method": "backlund_unpinned"},
                steps=10**6,
                what="long steps",
            ),
        ),
        about=("backlund_unpinned",),
    ),
    Claim(
        "claims-of-methods",
        "conservation",
        "Every method conserves what it claims to, over ten million steps of 1/8 (interpreted methods: 2000 to 20 000), with "
        "no more than a random walk of round-off: on sixteen random tops the error grows with an exponent below 0.75. "
        "Otherwise the method's record calls it biased and says why. The test does detect drift: Runge-Kutta of order 5 with "
        "a fixed step loses energy with an exponent of at least 0.75.",
        "drift",
        (
            Bound(kept_as_claimed, "<", 0.75, "", {"part": "time", "state": RANDOM}, steps=10**7, what="exponent"),
            Bound(
                entries("drift", "verdicts", "exponent", method="rk45_fixed", invariant="H"),
                "≥",
                0.75,
                "",
                {"part": "time", "state": RANDOM, "method": "rk45_fixed"},
                steps=10**7,
                what="rk45_fixed",
            ),
        ),
        about=("rk45_fixed", "implicit_midpoint"),
    ),
    Claim(
        "cost-of-a-state",
        "cost",
        "Over t = 1e6 on the generic top, with a state every 0.125, 0.5, 0.95 or 2.5 nutation periods, heyoka at machine "
        "epsilon takes at least 40 times as long for each state as the Bäcklund step, and its error at the end is larger. "
        "heyoka's time is that of its own steps to the end, without output. Set-up and calls count, compilation does not.",
        "cost",
        (
            Bound(per_state, "≥", 40.0, "×", {"part": "headline", "fraction": SPACINGS}, ranged=True),
            Bound(relative_error, "<", 1.0, "of heyoka's", {"part": "headline", "fraction": SPACINGS}, what="error"),
        ),
        brief="A state costs heyoka many times a Bäcklund step, over t = 10⁶.",
        about=("backlund", "taylor"),
    ),
    Claim(
        "set-up",
        "cost",
        "Finding λ(h) and the constants of a Bäcklund step takes no longer than 5000 of its steps, once compiled. Steps are "
        "up to 4 units and 2½ nutation periods long; the call from Python is included.",
        "cost",
        (Bound(setup_in_steps, "≤", 5000.0, "steps", {"part": ("step", "periods"), "method": "backlund"}),),
        about=("backlund",),
    ),
    Claim(
        "long-and-short-runs",
        "cost",
        "Set-up counted, the Bäcklund maps win long runs and lose short ones against every method that is not exact in time. "
        "Over t = 1e4, to errors from 1e-4 to 1e-12 on the tops generic and figure1, and over t = 1e6, to errors from 1e-4 to "
        "1e-10 on generic, the best other method takes at least ten times as long, or never gets there. At t = 100 and errors "
        "from 1e-8 to 1e-12 it takes longer. At t = 100 and an error of 1e-4, and at t = 10 and every error from 1e-4 to "
        "1e-12, it takes less time: most of a short Bäcklund run is Python around the call.",
        "work_precision",
        (
            lead_bound("≥", 10.0, "t = 10⁴, 10⁶", (1e4, 1e-4, 1e-12), (1e6, 1e-4, 1e-10)),
            lead_bound(">", 1.0, "t = 100", (100.0, 1e-8, 1e-12)),
            lead_bound("<", 1.0, "lost", (10.0, 1e-4, 1e-12), (100.0, 1e-4, 1e-4)),
        ),
        brief="Set-up counted, Bäcklund steps win long runs and lose those of t = 10.",
        about=("backlund",),
    ),
    Claim(
        "many-tops",
        "cost",
        "For many tops on one core, up to t = 1e4, heyoka in batch mode takes at least 50 times as long for a top and a unit "
        "of time as Bäcklund steps whose error is no larger, at every tolerance from 1e-3 to machine epsilon. Set-up of both "
        "counts.",
        "ensemble",
        (
            Bound(
                batch_ratios,
                "≥",
                50.0,
                "×",
                {"part": "rival", "span": 1e4, "method": ("backlund", "taylor")},
                ranged=True,
            ),
        ),
        about=("backlund", "taylor"),
    ),
    Claim(
        "kept-in-a-field",
        "fields",
        "On the ten tops in potentials every method conserves what it claims to conserve there, as far as round-off allows, "
        "over a million steps of 1/8 (interpreted methods: fewer): C1 and C2 for Poisson methods, H and J3 as the top "
        "conserves them.",
        "perturbed",
        (
            Bound(
                kept_in_a_field,
                "≤",
                1.0,
                "of what round-off may do",
                {"part": "drift", "state": tuple(PERTURBED_TOPS)},
                steps=10**6,
            ),
        ),
    ),
    Claim(
        "weak-and-strong-fields",
        "fields",
        "A splitting with the exact step inside (`backlund_splitting`) wins long runs in weak fields, and loses in strong "
        "ones. In a tide of 1e-4 of the weight or less the best other method takes at least three times as long at t = 1e4, "
        "for errors from 1e-4 to 1e-10. At t = 1000 it takes 0.8 times as long or more: at an error of 1e-4 nobody wins. It "
        "takes less time on a fast top at t = 1000, for errors of 1e-4 and 1e-6, and in a tide of a tenth of the weight and "
        "near a magnet, at both lengths, for errors from 1e-6 to 1e-10. All are compiled, set-up counts.",
        "perturbed",
        (
            race(1e4, WEAK, 1e-4, 1e-6, 1e-8, 1e-10, sign="≥", limit=3.0, what="weak, t = 10⁴"),
            race(1e3, WEAK, 1e-4, 1e-6, 1e-8, 1e-10, sign="≥", limit=0.8, what="weak, t = 1000"),
            race(1e3, "fast_tide", 1e-4, 1e-6, sign="<", limit=1.0, what="fast, t = 1000"),
            race((1e3, 1e4), STRONG, 1e-6, 1e-8, 1e-10, sign="<", limit=1.0, what="strong"),
        ),
        brief="Splittings with the exact step win long runs in weak fields, lose in strong ones.",
        about=("backlund_splitting",),
    ),
    Claim(
        "tolerance-is-honest",
        "fields",
        "Asked for an error of 1e-6 or 1e-8, `backlund_splitting` gives a state that is wrong by at most ten times as much, or "
        "refuses. It refuses at most a fifth of the runs, and 95 % of the errors it expects are within a factor of ten of the "
        "true ones. These are 60 random tops each in tides and near charges of 1e-6 to 1e-2, at t = 300, 3000 and 1e4; chaotic "
        "motions are left out.",
        "perturbed",
        (
            Bound(worst_to_tolerance, "≤", 10.0, "of the error asked for", TO_TOLERANCE),
            Bound(refused_tolerances, "≤", 0.2, "", TO_TOLERANCE, what="share refused"),
            Bound(expected_errors, "≥", 0.95, "", TO_TOLERANCE, what="share expected"),
        ),
        about=("backlund_splitting",),
    ),
    Claim(
        "heavy-top-splitting",
        "fields",
        "On the heavy top of Brüls, Cardona and Arnold, 2^15 steps in 2 s, the splitting into free top and kick, `strang`, errs "
        "at most a hundredth as much in position as RATTLE, Simo and Wong's method, the Lie midpoint and generalized-α, all of "
        "order 2. Without symmetry the lead shrinks: on Kovalevskaya's body it errs over a tenth as much as the Lie midpoint. "
        "RK4 in quaternions errs less on a top that spins slowly.",
        "heavy_top",
        (
            of_whole_body("bruels", (OF_BODIES, "position"), (("strang",), "position"), "≥", 100.0, "fast"),
            of_whole_body(
                "kovalevskaya", (("lie_midpoint",), "position"), (("strang",), "position"), "<", 10.0, "asymmetric"
            ),
            of_whole_body("slow", (("rk4",), "position"), (("strang",), "position"), "<", 1.0, "slow"),
        ),
    ),
    Claim(
        "position-and-rotation",
        "fields",
        "Position and rotation rank methods differently, and what keeps the energy need not follow. On the heavy top of Brüls, "
        "Cardona and Arnold, 2^15 steps in 2 s, RATTLE errs at least 300 times as much in rotation (rad) as in position (m), "
        "the Lie midpoint at most 3 times. Simo and Wong's method, which keeps the energy to round-off, errs at least 10 000 "
        "times as much in position as RK4, which does not.",
        "heavy_top",
        (
            of_whole_body("bruels", (("rattle",), "rotation"), (("rattle",), "position"), "≥", 300.0, "RATTLE"),
            of_whole_body(
                "bruels", (("lie_midpoint",), "rotation"), (("lie_midpoint",), "position"), "≤", 3.0, "Lie midpoint"
            ),
            Bound(
                ("energy",),
                "≤",
                1e-13,
                "of scale",
                {"case": "bruels", "h": BODY_STEPS["bruels"], "method": "simo_wong"},
                what="energy",
            ),
            of_whole_body("bruels", (("simo_wong",), "position"), (("rk4",), "position"), "≥", 1e4, "Simo and Wong"),
        ),
    ),
    Claim(
        "magnet-exact",
        "magnets",
        "The exact step of the Gaudin magnet is found for every one of 200 random magnets each of 2, 3, 4, 5, 8 and 12 spins, "
        "and for every step of 1, 5, 20 and 80 units of time. After one such step the spins differ from heyoka's by at most "
        "1e-10.",
        "gaudin",
        (
            Bound(("failed",), "≤", 0.0, "not found", RANDOM_MAGNETS),
            Bound(("error",), "≤", 1e-10, "", RANDOM_MAGNETS, what="difference"),
        ),
    ),
    Claim(
        "magnet-invariants",
        "magnets",
        "Bäcklund maps of the Gaudin magnet conserve every |s_j| and every H_j over 10⁵ steps. Relative to the size of their "
        "terms they do so within 1e-11 on 200 random magnets each of 2, 3, 4, 5, 8 and 12 spins, in exact steps of 1 to 80 "
        "units, and within 1e-12 on a central-spin magnet of 8 spins, in exact steps of 2 units and steps of order 2 of ¼.",
        "gaudin",
        (
            Bound(("drift",), "≤", 1e-11, "of scale", RANDOM_MAGNETS, steps=10**5, what="random"),
            Bound(
                ("spins", "hamiltonians"),
                "≤",
                1e-12,
                "of scale",
                {"part": "time", "n": 8, "variant": ("order 2", "exact")},
                steps=10**5,
                what="central spin",
            ),
        ),
    ),
    Claim(
        "magnet-cost",
        "magnets",
        "The exact step of the Gaudin magnet is cheap to take and dear to prepare. Once it is prepared, heyoka takes at least "
        "20 times as long for a unit of time, with 2, 3, 8 and 32 spins and steps of 2 units. Set-up counted, another method "
        "takes less time with 8 spins over t = 64, 1024 and 16 384, at every error from 1e-4 to 1e-10.",
        "gaudin",
        (
            Bound(
                magnet_cost,
                "≥",
                20.0,
                "×",
                {"part": "cost", "n": (2, 3, 8, 32), "variant": ("exact", "taylor")},
                what="prepared",
                ranged=True,
            ),
            Bound(
                entries("gaudin", "work", "with set-up"),
                "<",
                1.0,
                "×",
                {"part": "work", "span": (64.0, 2.0**10, 2.0**14)},
                what="with set-up",
                ranged=True,
            ),
        ),
        brief="A magnet's exact step is cheap once prepared, but loses with its set-up.",
    ),
    Claim(
        "magnet-orders",
        "magnets",
        "On the Gaudin magnet of 8 spins a step of k Bäcklund maps has order 2k, k = 1 … 4, and splittings and midpoint rules "
        "have the order they claim, within 0.15.",
        "gaudin",
        (Bound(magnet_orders, "≤", 0.15, "difference", {"part": "h"}),),
    ),
    Claim(
        "orders",
        "method",
        "In a uniform field every method with a fixed step has the order it claims, within 0.15, or is steeper because its "
        "leading term is too small to show above round-off. Orders are measured on single or few steps of eight tops. The "
        "page names the steeper ones.",
        "phase",
        (Bound(orders_as_claimed, "≤", 0.15, "difference", {"part": "order"}),),
    ),
    Claim(
        "theory",
        "method",
        "The predicted states (`predicted_phase(…).states(t)`) say where every method with a fixed step is that is not exact. "
        "Over t = 512 on the tops generic, figure1, fast and through_pole they account for at least 98 % of the method's error, "
        "where that is between 1e-9 and 1e-2 and the power series of the local error converges.",
        "phase",
        (Bound(taken_by_theory, "≥", 0.98, "of the error", {"part": "theory", "state": THEORY_TOPS}),),
    ),
    Claim(
        "form-of-the-map",
        "method",
        "How the map is coded decides about its round-off. On the data of the paper's Figure 2, 4000 steps with λ = 500 + "
        "5000i, the paper's program loses at least twelve digits of |x|². The real form of the same map, without pinning, "
        "loses only the last three or four digits of H, J3, C1 and C2.",
        "paper",
        (
            Bound(
                entries("paper", "invariants", "C1", figure=2, form="paper's program"),
                "≥",
                1e-4,
                "of scale",
                {"figure": 2, "form": "paper's program"},
                what="program",
            ),
            Bound(INVARIANTS, "≤", 1e-12, "of scale", {"figure": 2, "form": "real form"}, what="real form"),
        ),
        about=("backlund_textbook",),
    ),
]
