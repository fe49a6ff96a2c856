"""What the project says of itself: each sentence with the check of stored rows that can refute it."""

from __future__ import annotations

import importlib
from collections.abc import Callable

import pandas as pd

from experiments.metrics import ROUND_OFF
from experiments.states import RANDOM
from integrators.interface import INVARIANTS
from report.claims import Claim, NoData, Verdict, at_least, at_most, on, values, within

ULP = 2 * ROUND_OFF


def table(experiment: str, name: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    """The named table an experiment makes of its rows."""

    def derive(rows: pd.DataFrame) -> pd.DataFrame:
        made = importlib.import_module(f"experiments.{experiment}").tables(rows)
        if name not in made or made[name].empty:
            raise NoData(f"no table {name!r}")
        return made[name]

    return derive


def orders_as_claimed(rows: pd.DataFrame) -> Verdict:
    """The largest distance of a measured order from its claim, over methods of finite order with a fixed step."""
    orders = table("phase", "orders")(rows)
    finite = orders[(orders.claimed != "exact") & (orders.points >= 3)]
    away = (finite.measured - finite.claimed.astype(float)).abs()
    if away.empty:
        raise NoData("no order was measured")
    worst = finite.loc[away.idxmax()]
    unseen = sorted(set(orders[orders.claimed != "exact"].method) - set(finite.method) - {"taylor_fixed"})
    if unseen:
        raise NoData(f"no order was measured of {', '.join(unseen)}")
    note = f"worst: {worst.method} on {worst.state}"
    return Verdict(float(away.max()), 0.15, bool(away.max() <= 0.15), note)


def long_enough(length: int, check: Callable[[pd.DataFrame], Verdict]) -> Callable[[pd.DataFrame], Verdict]:
    """The check, if the rows hold runs of at least so many steps."""

    def checked(rows: pd.DataFrame) -> Verdict:
        if not (rows.get("steps", pd.Series(dtype=float)) >= length).any():
            raise NoData(f"no run of {length:,} steps is stored (full profile)")
        return check(rows)

    return checked


def more_accurate(rows: pd.DataFrame) -> Verdict:
    """Error of the exact step over that of heyoka, worst of the headline runs."""
    ours, theirs = values(rows, "backlund_error", "heyoka_error", part="headline").T
    worst = float((ours / theirs).max())
    return Verdict(worst, 1.0, worst < 1.0)


CLAIMS = [
    Claim(
        "exact-in-time",
        "The Bäcklund step with λ(h) is the exact flow: 2000 real steps of sizes from 0.03 to 11 and of ¼ to 1½ nutation "
        "periods stay within (1e-13 + 1e-15 t)·max(1, 1e-3/k'²) of the closed form, on every named and 200 random tops "
        "(found: share of it).",
        "phase",
        at_most(1.0, "share", part="promise"),
    ),
    Claim(
        "invariants-for-ever",
        "It keeps H, J3, C1 and C2 within 16 ulps of their scales over ten million steps of 1/8, on every top, pinned "
        "onto them every eighth step …",
        "drift",
        long_enough(10**7, within(16 * ULP, *INVARIANTS, part="time", method="backlund")),
    ),
    Claim(
        "unpinned",
        "… and without any pinning within 1e-11.",
        "drift",
        long_enough(10**7, within(1e-11, *INVARIANTS, part="time", method="backlund_unpinned", state=RANDOM)),
    ),
    Claim(
        "hundred-times-heyoka",
        "Over t = 10⁶ on the generic unit top, at half a nutation period per step, it is at least 100 times faster "
        "than heyoka at machine epsilon (set-up and call overhead included, compilation excluded) …",
        "cost",
        at_least(100.0, "ratio", part="headline", fraction=0.5),
    ),
    Claim("smaller-error", "… with a smaller error, at every step size tried.", "cost", more_accurate),
    Claim(
        "set-up",
        "Finding λ(h) and the constants of a step takes at most 1 ms once compiled (found: µs).",
        "cost",
        at_most(1000.0, "setup_us", part="step", method="backlund"),
    ),
    Claim(
        "orders",
        "Every method with a fixed step has the order it claims, within 0.15, on four tops. (Order 20 falls to round-off "
        "within two halvings of h; `lagrange-bench check taylor_fixed` reads it off single steps.)",
        "phase",
        orders_as_claimed,
    ),
    Claim(
        "midpoint-is-unbiased",
        "The implicit midpoint rule keeps all four invariants with no more than a random walk of round-off over ten "
        "million steps: growth exponent below 0.75.",
        "drift",
        long_enough(
            10**7,
            on(
                table("drift", "verdicts"),
                at_most(0.75, "exponent", method="implicit_midpoint", invariant=("H", "C1", "C2")),
            ),
        ),
    ),
    Claim(
        "rk45-drifts",
        "Runge-Kutta with fixed steps loses energy steadily, exponent at least 0.75: the measurement can tell.",
        "drift",
        on(table("drift", "verdicts"), at_least(0.75, "exponent", method="rk45_fixed", invariant="H")),
    ),
    Claim(
        "thin-adapter",
        "The `taylor` method costs at most 5 % more than heyoka called directly.",
        "cost",
        at_most(1.05, "adapter_ratio", part="headline"),
    ),
    Claim(
        "magnet",
        "The real map of the Gaudin magnet keeps every |s_j| and every H_j within 1e-12 of the size of its terms over "
        "more than 10⁵ steps, for 8 spins.",
        "gaudin",
        long_enough(10**5, within(1e-12, "spins", "hamiltonians", part="time", n=8, variant=("order 2", "exact"))),
    ),
    Claim(
        "program-loses-digits",
        "On the data of the paper's Figure 2 its program loses at least seven digits of |x|² …",
        "paper",
        on(table("paper", "invariants"), at_least(1e-9, "C1", figure=2, form="paper's program")),
    ),
    Claim(
        "real-form-keeps-them",
        "… where the real form of the same map, nothing pinned, keeps all but the last three or four.",
        "paper",
        on(table("paper", "invariants"), at_most(1e-12, *INVARIANTS, figure=2, form="real form")),
    ),
]
