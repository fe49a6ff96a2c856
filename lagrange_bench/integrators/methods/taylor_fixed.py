"""The Taylor polynomial of any degree at a fixed step, by recurrences compiled here.

heyoka would take a Python call for each step. J3, whose coefficients vanish, is conserved; no other invariant is. One right-hand
side is counted for each Taylor coefficient: `order` in each step.

Source: Jorba & Zou, Exp. Math. 14 (2005) 99.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from lagrange_bench.integrators.checks import check_count
from lagrange_bench.integrators.compiling.compiled import Compiled, jit
from lagrange_bench.integrators.compiling.expression import tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import stack
from lagrange_bench.integrators.compiling.loops import CLOCK, FixedStepper, Kernel
from lagrange_bench.integrators.interface import Array, Claims, Method
from lagrange_bench.integrators.problem.problem import Problem
from lagrange_bench.integrators.problem.system import System
from lagrange_bench.integrators.problem.top import LagrangeTop

MAX_ORDER = 60
SCRATCH = 8 * (MAX_ORDER + 1)  # numbers in the z of `step`


@jit
def step(s, c, counters):
    """The Taylor polynomial of one step in a uniform field, in powers of t/h.

    p = h J1, q = h J2 and x, with coefficients k in z[8k … 8k+4], obey p' = −h² alpha x2, q' = h² alpha x1, x1' = q x3 − h J3 x2,
    x2' = h J3 x1 − p x3 and x3' = p x2 − q x1.
    """
    J1, J2, J3, x1, x2, x3 = s
    h, alpha_h, order = c[0], c[1], int(c[2])
    spin, kick = h * J3, h * alpha_h
    z = stack(SCRATCH)
    z[0], z[1], z[2], z[3], z[4] = h * J1, h * J2, x1, x2, x3
    for k in range(order):
        a = b = d = e = 0.0
        for j in range(k + 1):  # Cauchy products
            p, q = 8 * j, 8 * (k - j)
            a += z[p + 1] * z[q + 4]
            b += z[p] * z[q + 4]
            d += z[p] * z[q + 3]
            e += z[p + 1] * z[q + 2]
        r, p = c[3 + k], 8 * k
        z[p + 8] = -kick * z[p + 3] * r
        z[p + 9] = kick * z[p + 2] * r
        z[p + 10] = (a - spin * z[p + 3]) * r
        z[p + 11] = (spin * z[p + 2] - b) * r
        z[p + 12] = (d - e) * r
    d1 = d2 = e1 = e2 = e3 = 0.0
    for k in range(order, 0, -1):  # small terms first
        p = 8 * k
        d1 -= z[p - 5] * c[2 + k]
        d2 += z[p - 6] * c[2 + k]
        e1 += z[p + 2]
        e2 += z[p + 3]
        e3 += z[p + 4]
    return J1 + alpha_h * d1, J2 + alpha_h * d2, J3, x1 + e1, x2 + e2, x3 + e3


# The operations of a program's lines. One kernel reads these tables, whatever the problem.
ADD, SUB, NEG, SCALE, MUL, DIV, SQRT, EXP, LOG, SIN, COS = range(11)
CODES = {"add": ADD, "sub": SUB, "neg": NEG, "mul": MUL, "div": DIV, "sqrt": SQRT, "exp": EXP, "log": LOG}


class Recurrences(NamedTuple):
    """A right-hand side as tables: operations, the rows of their two operands, the rows of y', constants, and the number of rows.

    Rows are those of t, y and p, then of the operations, then of the constants.
    """

    codes: Array
    first: Array
    second: Array
    rates: Array
    constants: tuple[float, ...]
    rows: int


@lru_cache(maxsize=64)
def recurrences(system: System) -> Recurrences:
    """The right-hand side as tables. Sine and cosine come together, because each needs the other."""
    program = system.rhs
    table: list[tuple[int, int, int]] = []
    rows = {i: i for i in range(program.inputs)}  # of the inputs, then of the operations
    moving = set(range(1 + system.size))
    constants = sorted({a[1] for _, *args in program.lines for a in args if isinstance(a, tuple)})
    constants = sorted({*constants, *(o[1] for o in program.outputs if isinstance(o, tuple))})
    count = sum(2 if line[0] in ("sin", "cos") else 1 for line in program.lines)
    rows_of_constants = {("=", value): program.inputs + count + i for i, value in enumerate(constants)}
    for i, (operation, *arguments) in enumerate(program.lines, program.inputs):
        a, b = (rows_of_constants[v] if isinstance(v, tuple) else rows[v] for v in (arguments[0], arguments[-1]))
        row = program.inputs + len(table)
        rows[i] = row
        if operation in ("sin", "cos"):
            table += [(SIN if operation == "sin" else COS, a, row + 1), (COS if operation == "sin" else SIN, a, row)]
        elif operation == "mul" and not {a, b} <= moving:
            table.append((SCALE, a, b) if a in moving else (SCALE, b, a))
        else:
            table.append((CODES[operation], a, b))
        if moving & {a, b}:
            moving |= {row, row + 1} if operation in ("sin", "cos") else {row}
    rates = [rows_of_constants[o] if isinstance(o, tuple) else rows[o] for o in program.outputs]
    codes, first, second = (np.array(column, dtype=np.int64) for column in zip(*table or [(ADD, 0, 0)], strict=True))
    size = program.inputs + count + len(constants)
    return Recurrences(codes[:count], first, second, np.array(rates), tuple(constants), size)  # type: ignore[arg-type]


@jit
def coefficient(z, code, a, b, c, k):
    """Coefficient c_k of an operation, from the coefficients of its operands a and b and its own earlier ones.

    The sums go over j = 1 … k in the first line, and over j = 1 … k − 1 in the second. In the third c is a cosine and s its sine.

        a/b: (a_k − Σ b_j c_{k−j})/b_0        exp a: Σ j a_j c_{k−j}/k
        √a: (a_k − Σ c_j c_{k−j})/(2 c_0)     log a: (a_k − Σ j c_j a_{k−j}/k)/a_0
        s_k = Σ j a_j c_{k−j}/k               c_k = −Σ j a_j s_{k−j}/k, j = 1 … k
    """
    if code == ADD:
        return z[a + k] + z[b + k]
    if code == SUB:
        return z[a + k] - z[b + k]
    if code == NEG:
        return -z[a + k]
    if code == SCALE:
        return z[a + k] * z[b]
    total = 0.0
    if code == MUL:
        for j in range(k + 1):
            total += z[a + j] * z[b + k - j]
        return total
    if code == DIV:
        for j in range(1, k + 1):
            total += z[b + j] * z[c + k - j]
        return (z[a + k] - total) / z[b]
    if k == 0:
        v = z[a]
        if code == SQRT:
            return math.sqrt(v)
        if code == EXP:
            return math.exp(v)
        if code == LOG:
            return math.log(v)
        return math.sin(v) if code == SIN else math.cos(v)
    if code == SQRT:
        for j in range(1, k):
            total += z[c + j] * z[c + k - j]
        return (z[a + k] - total) / (2.0 * z[c])
    if code == LOG:
        for j in range(1, k):
            total += j * z[c + j] * z[a + k - j]
        return (z[a + k] - total / k) / z[a]
    other = c if code == EXP else b
    for j in range(1, k + 1):
        total += j * z[a + j] * z[other + k - j]
    return -total / k if code == COS else total / k


@lru_cache(maxsize=64)
def kernel_of(system: System) -> Compiled:
    """The Taylor polynomial of one step of any system, in powers of t/h. Constants: start, h, order, parameters, `constants`."""
    tables, n, width, timed = recurrences(system), system.size, MAX_ORDER + 1, system.timed
    codes, first, second, places = tables.codes, tables.first * width, tables.second * width, tables.rates * width
    inputs, lines, scratch = 1 + n + system.parameters, len(codes), tables.rows * width
    count = tables.rows - lines - 1 - n
    state_at = tuple_loader(n)

    @jit
    def step(s, c, counters):
        h, order, z, total = c[1], int(c[2]), stack(scratch), stack(n)
        for i in range(scratch):
            z[i] = 0.0
        z[0], z[1] = c[0] + h * counters[CLOCK] if timed else c[0], h
        for i in range(n):
            z[width * (1 + i)], total[i] = s[i], 0.0
        for i in range(count):  # parameters, then constants, which lie behind the operations
            row = 1 + n + i if i < inputs - 1 - n else 1 + n + i + lines
            z[width * row] = c[3 + i]
        for k in range(order):
            for i in range(lines):
                place = width * (inputs + i)
                z[place + k] = coefficient(z, codes[i], first[i], second[i], place, k)
            for i in range(n):
                z[width * (1 + i) + k + 1] = h * z[places[i] + k] / (k + 1)
        for k in range(order, 0, -1):  # small terms first
            for i in range(n):
                total[i] += z[width * (1 + i) + k]
        for i in range(n):
            total[i] += s[i]
        return state_at(total, 0)

    return step


def check_order(order: int) -> int:
    if check_count(order, "order", least=1) > MAX_ORDER:
        raise ValueError(f"order must be at most {MAX_ORDER}; got {order}")
    return order


def prepare(top: LagrangeTop, y0: Array, h: float, *, order: int = 20) -> FixedStepper:
    """The Taylor polynomial of degree `order`, at most 60, in every step."""
    c = np.concatenate(((h, h * top.alpha, check_order(order)), 1 / np.arange(1.0, order + 1)))
    return FixedStepper("taylor_fixed", h, Kernel(step, rhs_per_step=order), c)


def prepare_in_field(problem: Problem, y0: Array, h: float, *, order: int = 20) -> FixedStepper:
    """The Taylor polynomial of degree `order`, at most 60, for any problem: the recurrences are read from tables."""
    system = problem.system
    c = np.array((problem.start, h, check_order(order), *problem.numbers, *recurrences(system).constants))
    size, timed = system.size, system.timed
    return FixedStepper("taylor_fixed", h, Kernel(kernel_of(system), rhs_per_step=order, timed=timed), c, size=size)


METHOD = Method(
    name="taylor_fixed",
    label="Taylor 20, fixed step",
    family="taylor",
    order=20,
    claims=Claims(conserves={"J3"}),
    source="Jorba and Zou, Exp. Math. 14 (2005) 99, section 2",
    prepare=prepare_in_field,
    needs="smooth",
    kernels_for={"uniform": prepare},  # the general kernel costs 4.5 times as much there
)
