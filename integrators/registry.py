"""METHODS: every method by name, in legend order, loaded when first asked for.

A method that lives in somebody else's package joins through the entry-point group `lagrange_bench.methods`
(name = registry key, value = `package.module:METHOD`). One that cannot be loaded, or whose name is taken, is no reason
for the others to fail.
"""

from __future__ import annotations

import importlib
import importlib.util
import multiprocessing
import warnings
from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points

from integrators.checks import suggestion
from integrators.interface import Method, StepError

GROUP = "lagrange_bench.methods"

BUILT_IN = {
    # backlund
    "backlund": "integrators.methods.backlund:EXACT",
    "backlund_unpinned": "integrators.methods.backlund:UNPINNED",
    "backlund_paper": "integrators.methods.backlund:PAPER",
    "backlund_textbook": "integrators.methods.backlund_textbook:METHOD",
    # closed-form
    "addition_theorem": "integrators.methods.addition_theorem:METHOD",
    "theta_functions": "integrators.methods.theta_functions:METHOD",
    # taylor
    "taylor": "integrators.methods.taylor:NATURAL",
    "taylor_accurate": "integrators.methods.taylor:ACCURATE",
    "taylor_compact": "integrators.methods.taylor:COMPACT",
    "taylor_fixed": "integrators.methods.taylor:FIXED",
    # runge-kutta
    "rk4": "integrators.methods.runge_kutta:CLASSICAL",
    "rk45_fixed": "integrators.methods.runge_kutta:FIFTH",
    "dop853_fixed": "integrators.methods.runge_kutta:EIGHTH",
    "verner9_fixed": "integrators.methods.runge_kutta:NINTH",
    "verner9_projected": "integrators.methods.runge_kutta:PROJECTED",
    "dop853": "integrators.methods.dop853:METHOD",
    "rk45": "integrators.methods.scipy_ivp:RK45",
    "scipy_dop853": "integrators.methods.scipy_ivp:DOP853",
    # splitting
    "strang": "integrators.methods.splitting:STRANG",
    "takahashi_imada": "integrators.methods.splitting:TAKAHASHI_IMADA",
    "blanes_moan4": "integrators.methods.splitting:BLANES_MOAN4",
    "force_gradient4": "integrators.methods.splitting:FORCE_GRADIENT4",
    "blanes_moan6": "integrators.methods.splitting:BLANES_MOAN6",
    "force_gradient6": "integrators.methods.splitting:FORCE_GRADIENT6",
    "kahan_li6": "integrators.methods.splitting:KAHAN_LI6",
    "kahan_li8": "integrators.methods.splitting:KAHAN_LI8",
    "sofroniou_spaletta10": "integrators.methods.splitting:SOFRONIOU_SPALETTA10",
    # integrable
    "kahan": "integrators.methods.kahan:METHOD",
    "bobenko_suris": "integrators.methods.bobenko_suris:METHOD",
    # implicit
    "implicit_midpoint": "integrators.methods.implicit_midpoint:METHOD",
    "collective_midpoint": "integrators.methods.collective_midpoint:METHOD",
    "gauss4": "integrators.methods.gauss:GAUSS4",
    "gauss6": "integrators.methods.gauss:GAUSS6",
    "gauss8": "integrators.methods.gauss:GAUSS8",
    "gauss12": "integrators.methods.gauss:GAUSS12",
    "lsoda": "integrators.methods.scipy_ivp:LSODA",
    "radau": "integrators.methods.scipy_ivp:RADAU",
    # lie-group
    "rkmk4": "integrators.methods.lie_group:RKMK4",
    "commutator_free4": "integrators.methods.lie_group:COMMUTATOR_FREE4",
}


class Registry(Mapping[str, Method]):
    """Name → Method. Listing the names imports nothing."""

    @cached_property
    def _entries(self) -> dict[str, EntryPoint]:
        entries = {name: EntryPoint(name, value, GROUP) for name, value in BUILT_IN.items()}
        clashes = []
        for entry in sorted(entry_points(group=GROUP), key=lambda e: (e.name, e.value)):
            if entries.setdefault(entry.name, entry) is not entry:
                clashes.append(_left_out(entry))
        if clashes and multiprocessing.parent_process() is None:  # said once, not by every worker
            warnings.warn("; ".join(clashes), RuntimeWarning, stacklevel=2)
        return entries

    def __getitem__(self, name: str) -> Method:
        if name not in self._entries:
            close = suggestion(str(name), self._entries)
            known = "All: lagrange-bench methods" if close.endswith("?") else f"Known: {', '.join(self._entries)}"
            raise KeyError(f"unknown method {name!r}{close} {known}")
        entry = self._entries[name]
        method = entry.load()
        if not isinstance(method, Method):
            raise TypeError(f"{entry.value} is a {type(method).__name__}, not an integrators.Method")
        if method.name != name:
            raise ValueError(f"{entry.value} calls itself {method.name!r} but is registered as {name!r}")
        return method

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


def _left_out(entry: EntryPoint) -> str:
    """What is said of a plug-in whose name is taken."""
    package = entry.dist.name if entry.dist else entry.module
    return (
        f"the plug-in {entry.name!r} ({entry.value} of the package {package}) is left out, for its name is taken: "
        f"give the method another name, or pip uninstall {package}"
    )


METHODS = Registry()


def find_method(method: str | Method) -> Method:
    """The method of that name, or the method itself, if it can run here.

    Raises
    ------
    ValueError : no such method. StepError : the package it needs is not installed.
    """
    if not isinstance(method, Method):
        if not isinstance(method, str):
            raise ValueError(f"method must be a name in METHODS or a Method; got {method!r}")
        try:
            method = METHODS[method]
        except KeyError as error:
            raise ValueError(f"method: {error.args[0]}") from None
    if not available(method):
        raise StepError(method.name, f"needs the package {method.requires}, which is not installed here")
    return method


def available(method: Method) -> bool:
    """Whether the package a method needs is installed here."""
    return method.requires is None or importlib.util.find_spec(method.requires) is not None
