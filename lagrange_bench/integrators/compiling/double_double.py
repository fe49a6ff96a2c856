"""Double-double arithmetic: numbers as unevaluated sums hi + lo, about 32 digits, compiled.

The error-free transformations are Dekker's (Numer. Math. 18 (1971) 224) and Knuth's. They need no fused multiply-add, so the bits
are the same everywhere. They compute constants of a step once, outside time loops, so they are called and not inlined, which
compiles quicker. Only `two_sum` also serves in compensated sums. Operands must be within 1e-140 … 1e140, or zero. Callers scale
by powers of two first.
"""

import math

from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.unroll import unrolled

SPLITTER = 134217729.0  # 2^27 + 1


@unrolled
def two_sum(a, b):
    """a + b and its rounding error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@unrolled
def two_prod(a, b):
    # a b and its rounding error: the halves of a and b have 26 bits, so their products are exact
    p = a * b
    t = SPLITTER * a
    ah = t - (t - a)
    al = a - ah
    t = SPLITTER * b
    bh = t - (t - b)
    bl = b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@unrolled
def quick(hi, lo):
    """Renormalise when |hi| >= |lo|."""
    s = hi + lo
    return s, lo - (s - hi)


@unrolled
def dd(a):
    return a, 0.0


@unrolled
def neg(a):
    return -a[0], -a[1]


@unrolled(inline=False)
def add(a, b):
    s, e = two_sum(a[0], b[0])
    t, f = two_sum(a[1], b[1])
    s, e = quick(s, e + t)
    return quick(s, e + f)


@unrolled(inline=False)
def sub(a, b):
    return add(a, (-b[0], -b[1]))


@unrolled(inline=False)
def mul(a, b):
    p, e = two_prod(a[0], b[0])
    return quick(p, e + (a[0] * b[1] + a[1] * b[0]))


@unrolled
def scale(a, s):
    """a times a power of two (exact)."""
    return a[0] * s, a[1] * s


@unrolled(inline=False)
def times(a, b):
    """a times a double."""
    p, e = two_prod(a[0], b)
    return quick(p, e + a[1] * b)


@unrolled(inline=False)
def div(a, b):
    q = a[0] / b[0]
    p, e = two_prod(q, b[0])
    return quick(q, ((((a[0] - p) - e) + a[1]) - q * b[1]) / b[0])  # a − q b is small, so doubles suffice


@jit
def sqrt(a):
    """Square root; zero for a <= 0 (callers pass round-off of zero at worst)."""
    if a[0] <= 0.0:
        return 0.0, 0.0
    x = math.sqrt(a[0])
    p, e = two_prod(x, x)
    return quick(x, (((a[0] - p) - e) + a[1]) / (2.0 * x))


@jit
def small_turn(angle, terms):
    """cos and sin of a small angle, from `terms` terms of exp(i angle) = 1 + i angle/1 (1 + i angle/2 (…))."""
    cos, sin = dd(1.0), dd(0.0)
    for k in range(terms, 0, -1):
        a = div(angle, dd(float(k)))
        cos, sin = sub(dd(1.0), mul(a, sin)), mul(a, cos)
    return cos, sin


# complex numbers are pairs (real, imaginary) of double-doubles


@unrolled(inline=False)
def cadd(a, b):
    return add(a[0], b[0]), add(a[1], b[1])


@unrolled(inline=False)
def cmul(a, b):
    return sub(mul(a[0], b[0]), mul(a[1], b[1])), add(mul(a[0], b[1]), mul(a[1], b[0]))


@unrolled(inline=False)
def cdiv(a, b):
    n = add(mul(b[0], b[0]), mul(b[1], b[1]))
    re, im = cmul(a, (b[0], neg(b[1])))
    return div(re, n), div(im, n)


@unrolled(inline=False)
def cscale(a, r):
    """Complex times a real double-double."""
    return mul(a[0], r), mul(a[1], r)
