"""What the project says of itself: each sentence with the check of stored rows that can refute it."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from experiments import work_precision
from experiments.catalogue import load
from experiments.drawing.tables import flat, show
from experiments.measuring.metrics import ROUND_OFF
from experiments.measuring.states import CLOSE, WIDE, methods_on
from integrators.interface import INVARIANTS
from integrators.problem.top import TOPS
from integrators.registry import BUILT_IN, METHODS, available
from report.claims import Claim, NoData, Verdict, at_least, at_most, compare, on, spans, steps, tops, values, within

ULP = 2 * ROUND_OFF
RATIO, TARGET = "times as long as the exact step inside", "error at most"  # columns of the table of perturbed tops
RANDOM_TOPS = tuple(f"random{i:03d}" for i in range(200))


Tables = dict[str, pd.DataFrame]
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


def orders_as_claimed(rows: pd.DataFrame) -> Verdict:
    """The largest distance of a measured order from its claim, over methods of finite order with a fixed step."""
    orders = table("phase", "orders")(rows)
    orders = orders[orders.claimed != "exact"]
    hidden = sorted(set(orders[orders.hidden].method))
    finite = orders[(orders.points >= 3) & ~orders.hidden]
    away = (finite.measured - finite.claimed.astype(float)).abs()
    if away.empty:
        raise NoData("no order was measured")
    worst = finite.loc[away.idxmax()]
    if (rows.part == "order").any():  # off single steps every order can be measured; off runs order 20 cannot
        unseen = sorted(set(orders.method) - set(finite.method) - set(hidden))
        if unseen:
            return Verdict(None, 0.15, False, f"no order was measured of {', '.join(unseen)}")
    note = f"{finite.method.nunique()} methods; worst: {worst.method}, {worst.state}"
    if hidden:
        note += f"; steeper, the leading term being too small to show above round-off: {', '.join(hidden)}"
    return Verdict(float(away.max()), 0.15, bool(away.max() <= 0.15), note)


def taken_by_theory(rows: pd.DataFrame) -> Verdict:
    """The least share of a measured error that theory takes away, over runs whose errors say something."""
    measured = set(rows[rows.part == "theory"].method)
    stepping = {name for name, method in methods_on().items() if method.control == "step" and method.order is not None}
    asked = stepping & set(BUILT_IN)  # of a plug-in there is no theory
    if missing := sorted(asked - measured):
        raise NoData(f"not held against theory: {', '.join(missing)}")
    found = table("phase", "theory")(rows)
    judged = found[found.method.isin(asked) & found["in range"].eq(True)]
    if unseen := sorted(asked - set(judged.method)):
        return Verdict(None, 0.98, False, f"no prediction, or no error in range, of {', '.join(unseen)}", sign="≥")
    worst = judged.loc[judged["share left"].fillna(np.inf).idxmax()]
    note = f"{len(judged)} runs of {len(asked)} methods; worst: {worst.method}, {worst.state}, h = {show(worst.h)}"
    if without := int((found.method.isin(asked) & found["in range"].isna()).sum()):
        note += f"; no prediction for {without} more, where the series does not converge"
    taken = 1.0 - float(worst["share left"])
    return Verdict(taken, 0.98, taken >= 0.98, note, sign="≥")


def kept_as_claimed(rows: pd.DataFrame) -> Verdict:
    """The largest growth exponent of anything a method claims to keep and does not itself call biased."""
    found = all_methods(table("drift", "verdicts")(rows))
    asked = found[found.claimed & (found["biased, as the method says"] == "")]
    if (asked.verdict == "failed").any():
        bad = asked[asked.verdict == "failed"].iloc[0]
        return Verdict(None, 0.75, False, f"{bad.method}: {bad.invariant} is not finite")
    walking = asked[~asked.verdict.isin(("exact", "round-off"))]  # of an error of a few ulps the slope says nothing
    if walking.empty:
        raise NoData("no claimed invariant moves by more than sixteen ulps")
    worst = walking.loc[walking.exponent.fillna(np.inf).idxmax()]  # one that cannot be measured does not pass
    excused = found[found.claimed & (found["biased, as the method says"] != "")]
    note = f"{len(asked)} claims of {found.method.nunique()} methods; worst: {worst.invariant} of {worst.method}"
    if len(excused):
        note += f"; called biased: {', '.join(f'{r.invariant} of {r.method}' for r in excused.itertuples())}"
    return Verdict(float(worst.exponent), 0.75, bool((walking.exponent < 0.75).all()), note, sign="<")


def all_methods(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows, if every method of the bench that can run here is among them. Plug-ins are judged where they have rows."""
    if missing := sorted(
        name for name in methods_on() if name in BUILT_IN and available(METHODS[name]) and name not in set(rows.method)
    ):
        raise NoData(f"not measured: {', '.join(missing)}")
    return rows


def kept_in_a_field(rows: pd.DataFrame) -> Verdict:
    """The largest error of what a method claims to keep on a top in a potential, in units of what round-off may make of it."""
    from experiments.measuring.check import BIAS, EPS, WALK

    found = table("perturbed", "kept")(rows)
    shares: dict[float, str] = {}
    for run in found.itertuples():
        for name in filter(None, run.claimed.split(", ")):
            bound = EPS * min(BIAS * run.steps, WALK * run.steps**0.5)
            shares[float(getattr(run, name)) / bound] = f"{name} of {run.method} on {run.state}"
    if not shares:
        raise NoData("no method that is loaded here claims to keep anything in a potential")
    worst = max(shares, key=lambda share: (not np.isfinite(share), share))
    note = f"{found.method.nunique()} methods on {found.state.nunique()} tops; worst: {shares[worst]}"
    return Verdict(worst, 1.0, bool(worst <= 1.0), note)


EXACT = ("backlund", "closed-form")


def against_others(good: pd.DataFrame, price: str) -> Iterator[tuple[float, str, float, pd.Series, pd.Series]]:
    """Of each run and error: its length, its top, the error, and what Bäcklund maps and methods not exact in time cost."""
    for (span, state), group in good.groupby(["span", "state"], sort=False):
        for target in work_precision.TARGETS:
            found = work_precision.best(group, target, price)
            yield span, state, target, found[found.family == "backlund"][price], found[~found.family.isin(EXACT)][price]


def lead(errors: dict[float, float], price: str, longest: bool) -> Callable[[pd.DataFrame], Verdict]:
    """How many times as long the cheapest method takes that is not exact in time as the cheapest Bäcklund map.

    errors : length of the runs, and the smallest error asked for. price : "seconds", or "total" with set-up. longest : the
    claim is that it reaches every error and is the cheapest (ratio above 1, the least is reported) or that it is not (below
    1, the largest is reported). Methods that never reach the target error are excluded.
    """

    def check(rows: pd.DataFrame) -> Verdict:
        good = work_precision.useful(all_methods(rows))
        ratios = {}
        for span, state, target, ours, others in against_others(good[good.span.isin(errors)], price):
            if target < errors[span]:
                continue
            if longest and ours.empty:
                return Verdict(0.0, 1.0, False, f"no error {show(target)} at t = {show(span)} on {state}")
            if len(ours) or len(others):
                ratio = others.min() / ours.min() if len(ours) and len(others) else np.inf if len(ours) else 0.0
                ratios[ratio] = f"error {show(target)} at t = {show(span)} on {state}, which {len(others)} others reach"
        told = min(ratios) if longest else max(ratios)
        holds = told > 1 if longest else told < 1
        return Verdict(float(told), 1.0, holds, ratios[told], sign=">" if longest else "<")

    return check


def headline_ratio(rows: pd.DataFrame) -> Verdict:
    """The time of heyoka over that of the exact step at half a nutation period per step; and at every step tried."""
    verdict = at_least(100.0, "ratio", part="headline", fraction=0.5)(rows)
    return verdict if verdict.value is None else replace(verdict, over=ratios_over_steps(rows))


def ratios_over_steps(rows: pd.DataFrame) -> str:
    """The least and the largest ratio of the headline runs, and at which steps; "" if there is one step only."""
    done = rows[rows.status == "done"]
    runs = values(done, "fraction", "ratio", part="headline")
    if len(runs) < 2:
        return ""
    (shortest, _), (longest, _) = runs.min(axis=0), runs.max(axis=0)
    least, most = (round(ratio) for ratio in (runs[:, 1].min(), runs[:, 1].max()))
    return f"{least}–{most}× at {show(shortest)} to {show(longest)} periods a step"


def more_accurate(rows: pd.DataFrame) -> Verdict:
    """Error of the exact step over that of heyoka, worst of the headline runs."""
    ours, theirs = values(rows, "backlund_error", "heyoka_error", part="headline").T
    worst = float((ours / theirs).max())
    return Verdict(worst, 1.0, worst < 1.0, sign="<")


def ensemble_step(rows: pd.DataFrame) -> float:
    """Time of a step of one of many tops over that of one top alone; the median over ensembles of a thousand and more.

    One disturbed sample decides nothing.
    """
    many = values(rows, "ns_per_step_and_core", part="tops", threads=1, tops=(1024, 4096, 8192, 65_536))
    return float(np.median(many) / np.median(values(rows, "pinned_ns", part="bound")))


def setup_in_steps(rows: pd.DataFrame) -> float:
    """The longest set-up of the exact step, in the quickest of its steps."""
    setups, steps = values(rows, "setup_us", "ns_per_step", part=("step", "periods"), method="backlund").T
    return float(1e3 * setups.max() / steps.min())


def batch_ratio(rows: pd.DataFrame, span: float = 1e4) -> float:
    """The least price of a top and a unit of time in heyoka's batches, over that of the exact step with no larger error."""
    rivals = rows[(rows.part == "rival") & (rows.span == span)]
    ours, theirs = (rivals[rivals.method == name] for name in ("backlund", "taylor"))
    if ours.empty or theirs.empty:
        raise NoData(f"the exact step and heyoka's batches were not both measured up to t = {show(span)}")
    ratios = []
    for run in theirs.itertuples():
        as_good = ours[ours.error <= run.error]
        ratios.append(run.ns_per_time / as_good.ns_per_time.min() if len(as_good) else 0.0)
    return float(min(ratios))


def long_run_lead(rows: pd.DataFrame) -> Verdict:
    """The error of the exact step where heyoka stops, after as long on the clock, over heyoka's there."""
    runs = rows[rows.part == "long"]
    if runs.empty or "method" not in runs:
        raise NoData("no long run")
    ours, theirs = (runs[runs.method == name].sort_values("t") for name in ("backlund", "taylor"))
    if ours.empty or theirs.empty or ours.steps.max() < 10**9:
        raise NoData("no run of 10⁹ steps")
    far, near = ours.iloc[-1], theirs.iloc[-1]
    note = f"exact step: error {far.error:.1e} at t = {far.t:.3g}; heyoka: {near.error:.1e} at t = {near.t:.3g}"
    return Verdict(float(far.error / near.error), 1.0, bool(far.error <= near.error and far.t > near.t), note)


def magnet_orders(rows: pd.DataFrame) -> Verdict:
    """The largest distance of a measured order from its claim, over the Bäcklund maps of the magnet and their rivals."""
    from integrators.paper.gaudin_methods import MAGNET_METHODS

    found = table("gaudin", "orders")(rows).set_index("variant").order
    claimed = {name: method.order for name, method in MAGNET_METHODS.items()}
    claimed |= {name: int(name.removeprefix("order ")) for name in found.index if name.startswith("order ")}
    away = {name: abs(found[name] - claimed[name]) for name in found.index if claimed.get(name)}
    if not away:
        raise NoData("no order was measured")
    worst = max(away, key=lambda name: (not np.isfinite(away[name]), away[name]))
    return Verdict(float(away[worst]), 0.15, bool(away[worst] <= 0.15), f"{len(away)} schemes; worst: {worst}")


def magnet_cost(rows: pd.DataFrame) -> float:
    """heyoka's price of a unit of time over that of the exact step of two units, least over the sizes of the magnet."""
    ratios = []
    for n in sorted({int(n) for (n,) in values(rows, "n", part="cost", variant="exact")}):
        ours, theirs = (
            values(rows, "ns_per_time", part="cost", n=n, variant=name).min() for name in ("exact", "taylor")
        )
        ratios.append(theirs / ours)
    return float(min(ratios))


CLAIMS = [
    Claim(
        "exact-in-time",
        "The Bäcklund step with λ(h) is the exact flow at any step size: its error is at most that of a change of the "
        "initial state by ten ulps. Steps from 0.03 to 11 units and from ¼ to 1½ nutation periods, up to 2000 steps, on "
        "every named top, 200 random ones and 32 close to the separatrix (quick profile: 16 and 8; up to t = 20 where the"
        " period is infinite).",
        "phase",
        at_most(10.0, "ulps", part="promise", state=(*TOPS, *RANDOM_TOPS, *CLOSE)),
        brief="At any step size, the Bäcklund step's error is that of round-off.",
        unit="ulps",
        about=("backlund",),
    ),
    Claim(
        "exact-in-time-wide",
        "The same holds with sixteen ulps on 200 tops with alpha of either sign and |J|²/(|alpha||x|) from 1e-3 to 1e3 "
        "(quick profile: 16 tops).",
        "phase",
        at_most(16.0, "ulps", part="promise", state=WIDE),
        unit="ulps",
        about=("backlund",),
    ),
    Claim(
        "invariants-for-ever",
        "The Bäcklund step keeps H, J3, C1 and C2 within 16 ulps of their scales over ten million steps of 1/8, on every "
        "top. It is pinned: moved back onto the invariants every eighth step.",
        "drift",
        within(16 * ULP, *INVARIANTS, part="time", method="backlund"),
        steps(10**7),
        brief="The Bäcklund step keeps all four invariants over ten million steps of 1/8.",
        unit="of scale",
        about=("backlund",),
    ),
    Claim(
        "unpinned",
        "Without pinning it keeps them within 1e-11 over the same runs.",
        "drift",
        within(1e-11, *INVARIANTS, part="time", method="backlund_unpinned"),
        steps(10**7),
        unit="of scale",
        about=("backlund_unpinned",),
    ),
    Claim(
        "unpinned-long-steps",
        "A million unpinned steps of 1.3 nutation periods each keep them within 1e-12, on 200 tops with alpha of either "
        "sign and |J|²/(|alpha||x|) from 1e-3 to 1e3 (quick profile: ten thousand steps, 16 tops).",
        "drift",
        within(1e-12, *INVARIANTS, part="long", method="backlund_unpinned", fraction=1.3),
        unit="of scale",
        about=("backlund_unpinned",),
    ),
    Claim(
        "unpinned-half-a-nutation",
        "As many steps of 0.51 and of 1 nutation periods on the same tops keep them within 2e-12.",
        "drift",
        within(2e-12, *INVARIANTS, part="long", method="backlund_unpinned", fraction=(0.51, 1.0)),
        unit="of scale",
        about=("backlund_unpinned",),
    ),
    Claim(
        "hundred-times-heyoka",
        "Over t = 10⁶ (quick profile: 10⁵) on the generic unit top, at half a nutation period per step, the Bäcklund step"
        " is at least 100 times faster than heyoka at machine epsilon. Set-up and call overhead count, compilation does "
        "not.",
        "cost",
        headline_ratio,
        brief="Over t = 10⁶, at two steps a nutation, heyoka takes many times as long.",
        unit="×",
        about=("backlund", "taylor"),
    ),
    Claim(
        "smaller-error",
        "In the same runs, at every step size tried, its error is the smaller one.",
        "cost",
        more_accurate,
        unit="of heyoka's",
        about=("backlund", "taylor"),
    ),
    Claim(
        "set-up",
        "Finding λ(h) and the constants of a step takes no longer than 5000 of the steps, once compiled. Steps up to 4 units "
        "and 2½ nutation periods; the call from Python is included.",
        "cost",
        compare(setup_in_steps, operator.le, 5000.0),
        unit="steps",
        about=("backlund",),
    ),
    Claim(
        "orders",
        "In a uniform field every method with a fixed step has the order it claims, within 0.15, or is steeper because its "
        "leading term is too small to show above round-off. Measured on single or few steps of eight tops. The page names the "
        "steeper ones.",
        "phase",
        orders_as_claimed,
        unit="(difference)",
    ),
    Claim(
        "theory",
        "Backward error analysis predicts the phase errors of every method that steps by h and is not exact. Over t = 512 "
        "it takes away at least 98 % of the error of the state, where that is between 1e-9 and 1e-2 and the power series of "
        "the local error converges.",
        "phase",
        taken_by_theory,
        unit="of the error",
    ),
    Claim(
        "claims-of-methods",
        "What a method claims to keep, it keeps over ten million steps (interpreted methods: 2000 to 20 000) with no more"
        " than a random walk of round-off: growth exponent below 0.75. Otherwise its record calls it biased and says why.",
        "drift",
        kept_as_claimed,
        steps(10**7),
        unit="(exponent)",
    ),
    Claim(
        "cheapest-long",
        "Over t = 10⁴, to any error from 1e-4 to 1e-12, and over t = 10⁶, to 1e-10, a Bäcklund map is the cheapest method"
        " but for other exact solutions. The tops are generic and, up to 10⁴, figure1. Set-up counts. Every other method takes"
        " longer or never gets there. (With steps of 16, 8, 4, … units no iterated map reached 1e-12 at t = 10⁶.)",
        "work_precision",
        lead({1e4: 1e-12, 1e6: 1e-10}, "total", longest=True),
        spans(1e4, 1e6),
        unit="times as long",
        about=("backlund",),
    ),
    Claim(
        "loses-short",
        "Over t = 10 the Bäcklund map loses at every error, set-up counted: another method's whole run takes less time. "
        "Most of the time of the Bäcklund run is Python around the call, not λ(h).",
        "work_precision",
        lead({10.0: 1e-12}, "total", longest=False),
        spans(10.0),
        brief="Over t = 10 the Bäcklund step loses to the fastest other method.",
        unit="of its time (best rival)",
        about=("backlund",),
    ),
    Claim(
        "perturbed-kept",
        "On tops in a potential every method keeps what it claims to keep there, as far as round-off allows: C1 and C2 "
        "for Poisson methods, H and J3 as the top conserves them.",
        "perturbed",
        kept_in_a_field,
        unit="of what round-off may do",
    ),
    Claim(
        "wins-perturbed",
        "Where the field is weak and the run long, the exact step inside a splitting wins. In a tide of 1e-4 of the weight "
        "or less, t = 1e4, error 1e-8, the best other method takes at least four times as long. All are compiled, set-up "
        "counts.",
        "perturbed",
        on(
            table("perturbed", "winners"),
            at_least(4.0, RATIO, state=("tide_1e-6", "weak_tide"), span=1e4, **{TARGET: 1e-8}),
        ),
        spans(1e4),
        brief="In a weak tide a splitting with it wins (t = 10⁴, error 10⁻⁸).",
        unit="times as long (best rival)",
        about=("backlund_splitting",),
    ),
    Claim(
        "loses-perturbed",
        "Where the field is strong, it loses. In a tide of a tenth of the weight and near a magnet, t = 1e3, errors 1e-6 to "
        "1e-10, another method takes less time.",
        "perturbed",
        on(
            table("perturbed", "winners"),
            at_most(1.0, RATIO, state=("strong_tide", "magnet"), span=1e3, **{TARGET: (1e-6, 1e-8, 1e-10)}),
        ),
        tops("strong_tide", "magnet"),
        brief="In strong fields this splitting loses (t = 1000, errors 10⁻⁶–10⁻¹⁰).",
        unit="of its time (best rival)",
        about=("backlund_splitting",),
    ),
    Claim(
        "midpoint-is-unbiased",
        "The implicit midpoint rule keeps H, C1 and C2 with no more than a random walk of round-off over ten million "
        "steps: growth exponent below 0.75.",
        "drift",
        on(
            table("drift", "verdicts"),
            at_most(0.75, "exponent", method="implicit_midpoint", invariant=("H", "C1", "C2")),
        ),
        steps(10**7),
        unit="(exponent)",
        about=("implicit_midpoint",),
    ),
    Claim(
        "midpoint-keeps-J3",
        "It keeps J3 to the last bit.",
        "drift",
        within(0.0, "J3", part="time", method="implicit_midpoint"),
        steps(10**7),
        unit="of scale",
        about=("implicit_midpoint",),
    ),
    Claim(
        "rk45-drifts",
        "Runge-Kutta with fixed steps loses energy steadily over ten million steps: exponent at least 0.75. This is the "
        "negative control: the test does detect drift.",
        "drift",
        on(table("drift", "verdicts"), at_least(0.75, "exponent", method="rk45_fixed", invariant="H")),
        steps(10**7),
        unit="(exponent)",
        about=("rk45_fixed",),
    ),
    Claim(
        "thin-adapter",
        "Over a long run the `taylor` method costs at most 5 % more than heyoka called directly.",
        "cost",
        at_most(1.05, "adapter_ratio", part="headline"),
        unit="of heyoka's time",
        about=("taylor",),
    ),
    Claim(
        "magnet",
        "The real map of the Gaudin magnet keeps every |s_j| and every H_j within 1e-12 of the size of its terms over "
        "more than 10⁵ steps, for 8 spins.",
        "gaudin",
        within(1e-12, "spins", "hamiltonians", part="time", n=8, variant=("order 2", "exact")),
        steps(10**5),
        unit="of scale",
    ),
    Claim(
        "magnet-any-step",
        "The exact step of the Gaudin magnet is found for every random magnet tried, and for every step of 1, 5, 20 and 80 "
        "units of time: 200 magnets each of 2, 3, 4, 5, 8 and 12 spins (quick profile: 4, 4 and 1 of 2, 3 and 8).",
        "gaudin",
        at_most(0.0, "failed", part="random"),
        unit="failed",
    ),
    Claim(
        "magnet-exact",
        "On the same magnets, after one such step, the spins differ from heyoka's by at most 1e-10.",
        "gaudin",
        within(1e-10, "error", part="random"),
    ),
    Claim(
        "magnet-long-steps",
        "On the same magnets, 10⁵ such steps keep every |s_j| and every H_j within 1e-11 of the size of its terms.",
        "gaudin",
        within(1e-11, "drift", part="random"),
        steps(10**5),
        unit="of scale",
    ),
    Claim(
        "magnet-orders",
        "A step of k Bäcklund maps has order 2k for the magnet, k = 1 … 4, and splittings and midpoint rules have the order "
        "they claim, within 0.15.",
        "gaudin",
        magnet_orders,
        unit="largest distance",
    ),
    Claim(
        "magnet-cost",
        "heyoka takes at least 20 times as long for two units of time as the exact step of two units, once that is prepared. "
        "This is the least ratio over the sizes of the magnet.",
        "gaudin",
        compare(magnet_cost, operator.ge, 20.0),
        unit="×",
    ),
    Claim(
        "magnet-set-up",
        "With 8 spins the exact step of the magnet loses, set-up counted, over every length tried, t = 64, 1024 and 16 384 "
        "(quick profile: 64): another method is quicker at every error.",
        "gaudin",
        on(table("gaudin", "work"), at_most(1.0, "with set-up")),
        spans(64.0),
        unit="of the exact step's time",
    ),
    Claim(
        "program-loses-digits",
        "On the data of the paper's Figure 2 its program loses at least twelve digits of |x|².",
        "paper",
        on(table("paper", "invariants"), at_least(1e-4, "C1", figure=2, form="paper's program")),
        unit="of scale",
        about=("backlund_textbook",),
    ),
    Claim(
        "real-form-keeps-them",
        "On the same data the real form of the same map, without pinning, loses only the last three or four digits.",
        "paper",
        on(table("paper", "invariants"), at_most(1e-12, *INVARIANTS, figure=2, form="real form")),
        unit="of scale",
    ),
    Claim(
        "ensemble-step",
        "Among a thousand tops and more, each with a torus and a λ(h) of its own, a pinned step of one takes at most a "
        "quarter of the time of a step of one top alone (one thread; median over 1024 to 65 536 tops).",
        "ensemble",
        compare(ensemble_step, operator.le, 0.25),
        unit="of a step alone",
        about=("backlund",),
    ),
    Claim(
        "ensemble-heyoka",
        "At t = 10⁴ heyoka in batch mode takes at least 50 times as long for a top and a unit of time, at no smaller "
        "error, set-up of both included.",
        "ensemble",
        compare(batch_ratio, operator.ge, 50.0),
        spans(1e4),
        unit="times as long",
        about=("backlund", "taylor"),
    ),
    Claim(
        "phase-of-the-pinned-step",
        "Pinned every eighth step, the phase of the exact step is off by at most 1e-16 of the time after ten million "
        "steps: root mean square over sixteen tops.",
        "round_off",
        on(table("round_off", "forms"), at_most(1e-16, "phase error / t", form="pinned, every 8", steps=10**7)),
        steps(10**7),
        unit="of the time",
        about=("backlund",),
    ),
    Claim(
        "forms-differ",
        "The same map with x assigned instead of incremented drifts in proportion to time: exponent of C1 at least 0.75 "
        "over the longest runs. Rounding depends on how the formula is coded.",
        "round_off",
        on(table("round_off", "forms"), at_least(0.75, "exponent of C1", form="x assigned", h=0.125)),
        unit="(exponent)",
    ),
    Claim(
        "long-run",
        "After 10⁹ steps the exact step's error is no larger than heyoka's after the same time on the clock, although "
        "heyoka has then reached an earlier time.",
        "round_off",
        long_run_lead,
        steps(10**9),
        unit="of heyoka's",
        about=("backlund", "taylor"),
    ),
]
