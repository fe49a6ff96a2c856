"""What takes part, as tables: the methods, the tops they follow, and engines."""

import pandas as pd

from lagrange_bench.experiments.engines.figures import overview
from lagrange_bench.experiments.engines.programs import BEST, DEFAULT, OURS, WORDS
from lagrange_bench.experiments.measuring.states import CLOSE, RANDOM, WIDE
from lagrange_bench.integrators.interface import INVARIANTS, Method
from lagrange_bench.integrators.problem.potentials import PERTURBED_TOPS
from lagrange_bench.integrators.problem.top import TOPS
from lagrange_bench.integrators.registry import ARCHIVE, METHODS

# engines that most visitors know, one of each kind of result
IN_SHORT = ("MuJoCo", "PhysX", "Jolt", "Rapier", "Simbody")
DRAWN = {  # of `lagrange_bench.experiments.measuring.states`, by the first word of their names
    RANDOM: "generic: α from 0.3 to 2, each J from −2 to 2, |x| from 0.5 to 2, drawn at random",
    CLOSE: "on the separatrix but for 10⁻⁸ to 10⁻¹ of J, drawn at random",
    WIDE: "of every kind: α of either sign, |J|²/(|α||x|) from 10⁻³ to 10³, drawn at random",
}


def methods() -> pd.DataFrame:
    """Each method that can be loaded: what figures and tables call it, and what it claims."""
    return pd.DataFrame([_method(name, record) for name, record, _ in METHODS.each() if record])


def _method(name: str, record: Method) -> dict[str, str | int]:
    claims = record.claims
    invariants = [name for name in INVARIANTS if name in claims.conserves | claims.conserves_if_quadratic]
    return {
        "in figures": record.label,
        "in tables": name,
        "family": record.family,
        "shown": "in the archive" if name in ARCHIVE else "yes",
        "order": record.order or "exact",
        "keeps to round-off": ", ".join([*invariants, *claims.conserves_own]) or "nothing",
        "symmetric": "yes" if claims.symmetric else "no",
    }


def tops() -> pd.DataFrame:
    """The named tops, those in a potential, and those that are drawn at random."""
    columns = ("in figures", "in tables", "α", "potential", "what it is")
    rows = [
        *((top.label, name, f"{top.alpha:g}", "", top.note) for name, top in TOPS.items()),
        *(
            (top.label, name, f"{top.alpha:g}", top.top.potential.name, top.note)
            for name, top in PERTURBED_TOPS.items()
        ),
        *(("", f"{names[0]} …", "", "", note) for names, note in DRAWN.items()),
    ]
    return pd.DataFrame(rows, columns=columns)


def programs(rows: pd.DataFrame) -> pd.DataFrame:
    """The errors of a few engines with steps of 1/60 s: a line for each, by default and as its documents advise.

    Empty where no engine was run.
    """
    if rows.empty or rows.engine.eq(OURS).all():
        return pd.DataFrame()
    lines = overview(rows, IN_SHORT)
    is_best = lines.setting.str.startswith(WORDS[BEST])
    lines = lines.assign(setting=is_best.map({True: WORDS[BEST], False: WORDS[DEFAULT]}))
    table = lines.pivot_table("1/60 s", "engine", "setting", sort=False).reindex(columns=[WORDS[DEFAULT], WORDS[BEST]])
    return table.rename_axis("program, steps of 1/60 s").reset_index()
