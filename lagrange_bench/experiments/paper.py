"""The paper's two figures, by its own program and by the real form of its map; and the exact step of n spins.

Figure 1 of Kuznetsov, Petrera and Ragnisco iterates the two-point map with λ = 0.02i a thousand times, Figure 2 with
λ = 500 + 5000i four thousand times. The paper's MATLAB program divides complex numbers. The real form has no poles. Both start
here from the same data, and the changes of H, J3, |x|² and x·J are measured.

Part “magnet” tests the exact step of the Gaudin magnet on random magnets: one step of 5 to 80 units of time, against the
reference solution of n spins. A unit is 1/√(Σ A_k² |s_k|²), with A_k the couplings of the site that moves.
"""

import math
from itertools import product
from random import Random

import numpy as np

from lagrange_bench.experiments.measuring import metrics
from lagrange_bench.experiments.measuring.states import find, options_of, rounded
from lagrange_bench.experiments.paper_figures import draw as draw
from lagrange_bench.experiments.paper_figures import tables as tables
from lagrange_bench.integrators import GaudinMagnet, prepare
from lagrange_bench.integrators.interface import INVARIANTS, Array
from lagrange_bench.integrators.truth import truths

VERSION = 1
MEASURED = {"": ("n", *INVARIANTS), "magnet": ("error",)}

FIGURES: dict[int, dict] = {
    1: {"state": "figure1", "re": 0.0, "im": 0.02, "steps": 1000},
    2: {"state": "figure2", "re": 500.0, "im": 5000.0, "steps": 4000},
}
FORMS = {  # name in tables: method, its options
    "real form": ("backlund", {"pin": 0}),
    "real form, pinned": ("backlund", {"pin": 8}),
    "paper's program": ("backlund_textbook", {}),
}

UNITS = (5.0, 20.0, 80.0)  # lengths of steps, in units of time
SPINS, SEEDS = {"quick": (2, 3), "full": range(2, 9)}, {"quick": range(1), "full": range(10)}


def cells(profile: str) -> list[dict]:
    figures = [
        {"figure": figure, "form": form, "method": method, **run, **options}
        for figure, run in FIGURES.items()
        for form, (method, options) in FORMS.items()
    ]
    magnets = product(SPINS[profile], UNITS, SEEDS[profile])
    return figures + [{"part": "magnet", "spins": n, "units": units, "seed": seed} for n, units, seed in magnets]


def measure(cell: dict) -> list[dict]:
    return _magnet(cell) if cell.get("part") == "magnet" else _figure(cell)


def random_magnet(n: int, seed: int) -> tuple[GaudinMagnet, Array]:
    """A magnet and its spins (n, 3) of lengths 0.2 to 1.5. Sites are 0.3 to 1 apart; any of them may be the moving one."""
    draw = Random(f"magnet{n}/{seed}")
    sites = np.cumsum([draw.uniform(0.3, 1.0) for _ in range(n)]).tolist()
    draw.shuffle(sites)
    spins = np.array([[draw.gauss(0.0, 1.0) for _ in range(3)] for _ in range(n)])
    spins *= [[draw.uniform(0.2, 1.5) / math.hypot(*spin)] for spin in spins]
    return GaudinMagnet(tuple(sites), draw.choice((-1, 1)) * draw.uniform(0.2, 1.5)), spins


def _magnet(cell: dict) -> list[dict]:
    magnet, spins = random_magnet(cell["spins"], cell["seed"])
    h = cell["units"] / float(np.linalg.norm(magnet.couplings[0] * np.linalg.norm(spins, axis=1)))
    true = truths.solution(magnet.problem(), spins.ravel(), [h], longest=math.inf)
    return [{"error": rounded(np.max(np.abs(magnet.exact_step(spins, h).ravel() - true)))}]


def _figure(cell: dict) -> list[dict]:
    top, y0 = find(cell["state"])
    stepper = prepare(top, y0, 1.0, cell["method"], lam=complex(cell["re"], cell["im"]), **options_of(cell))
    y = stepper.record(y0, cell["steps"], 1)
    drift = metrics.relative_drift(top.invariants(y), top.invariant_scales(y0))
    axis = range(3 if cell["form"] == "real form" else 0)  # the orbit is drawn once
    columns = {"n": range(len(y)), **{f"x{i + 1}": [rounded(x, 6) for x in y[:, 3 + i]] for i in axis}}
    columns |= {name: [rounded(error) for error in drift[:, i]] for i, name in enumerate(INVARIANTS)}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
