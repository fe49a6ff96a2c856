"""A few small cells of every experiment."""

from lagrange_bench.experiments.catalogue import load
from lagrange_bench.integrators import available
from tests.installed import FOR_TOPS

SMALL = {"steps": 64, "span": 16.0, "longest": 0.01, "repeats": 1, "magnets": 1, "budget": 1e5}
STATES = ("generic", "random000", "random001", "random002", "random003", "wide000", "weak_tide")


def kinds():
    """A method of every kind the experiments tell apart: family, engine, control. The contract tests see the others."""
    there = {name: method for name, method in FOR_TOPS.items() if available(method)}
    return set({(m.family, m.engine, m.control, bool(m.keeps)): name for name, m in reversed(there.items())}.values())


def tiny(name):
    """A few cells of the quick profile, made small: every part, every kind of method, one or two states."""
    chosen, seen, some = [], {}, kinds()
    for cell in load(name).cells("quick"):
        if cell.get("state", "generic") not in STATES and name != "paper":
            continue
        method = cell.get("method")
        if (method and method not in some) or cell.get("part") == "start":
            continue
        fields = ("part", "method", "state", "span", "figure", "eps", "variant")
        key = tuple(cell.get(field) for field in fields)
        seen[key] = seen.get(key, 0) + 1
        if seen[key] <= 3:
            chosen.append({**cell, **{k: v for k, v in SMALL.items() if k in cell}})
    return [dict(pairs) for pairs in dict.fromkeys(tuple(cell.items()) for cell in chosen)]
