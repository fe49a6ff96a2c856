"""The closed-form solution from theta functions, compiled. It is evaluated at each time; no state is carried from step to step.

Let m = J3, l = x·J, s = |x| and ζ = alpha (x3(t) − x3(0)). Then ζ'² = 2 (ζ − ζ1)(ζ − ζ2)(ζ − ζ3), and ζ goes to and fro between
ζ3 and ζ2. The solution is ζ = ζ3 + (ζ2 − ζ3) sn²(w, k) with w = κ (t − t0), κ² = (ζ1 − ζ3)/2 and k² = (ζ2 − ζ3)/(ζ1 − ζ3). Three
quantities are linear in ζ,

    |J+|² = 2 (ζ_J − ζ)     |A|² = s − x3 = (ζ_A − ζ)/alpha     |B|² = s + x3 = (ζ − ζ_B)/alpha     ζ_B ≤ ζ3, ζ2 ≤ ζ_J, ζ_A ≤ ζ1

and J+ = F_J e^{i(ψ + m (t − t0)/2)}, x+ = i F_A F_B e^{iψ}. The F have these moduli, and (arg F)' = alpha D/|ζ_F − ζ| with

    D_J = (l − m x_J)/2 (x_J: where J+ would vanish)     D_A = (m s − l)/2     D_B = (m s + l)/2.

Hence F = const e^{iλ(t − t0)} θ2(v − iσβ)/θ4(v) for F_J and F_A, and with θ1 in place of θ2 for F_B. Here v = πw/2K and σ = sign
D. β belongs to w = K + iη or iη, where ζ = ζ_F. For k² > 1/2 the functions of the complementary modulus are used (Jacobi's
imaginary transformation), which are regular on the separatrix: θ4(σb + iV)/θ2(iV) and −i θ1(σb + iV)/θ2(iV), V = πw/2K',
b = πη/2K'. Either way the nome is at most e^−π, and four terms are enough. Poles of the axis and zeros of J+ are zeros of entire
functions.

The period, and the precession in it (a complete integral of the third kind), come from the arithmetic-geometric mean. They are
double-doubles, computed with + − × ÷ √ alone. Whole periods are subtracted from t before anything is rounded. The rest is in
doubles: errors stay at round-off for any t, up to the conditioning of the orbit itself.

This is a formula and no stepping kernel, so it may call sin, cos and exp. A step is one evaluation, at t = n h from the start of
the run; `evaluate` takes any times. The truth by which methods are judged, `truth.exact`, doubles points of a curve, and shares
nothing with this file.

Sources: Whittaker, Analytical Dynamics, sections 71-72; Jacobi, Werke 2 (1882) 477; DLMF 19.8.7-8, 19.25, 20.7.30-33, 22.2.
"""

import math

import numpy as np
from scipy.special import ellipkm1, elliprf

from lagrange_bench.integrators.checks import as_state
from lagrange_bench.integrators.compiling.compiled import jit
from lagrange_bench.integrators.compiling.double_double import add, dd, div, mul, neg, scale, sqrt, sub, two_prod
from lagrange_bench.integrators.compiling.expression import tuple_loader
from lagrange_bench.integrators.compiling.intrinsics import store_tuple
from lagrange_bench.integrators.compiling.loops import FAILURE, MEMORY, FixedStepper, Kernel
from lagrange_bench.integrators.interface import Array, Claims, Method, StepError, Work
from lagrange_bench.integrators.methods.closed_body import BodyStepper, closed_form
from lagrange_bench.integrators.problem import kinds
from lagrange_bench.integrators.problem.rigid_body import RigidBody
from lagrange_bench.integrators.problem.top import LagrangeTop
from lagrange_bench.integrators.problem.units import Units
from lagrange_bench.integrators.torus.time_step import TWO_PI, largest_root, period_and_turn

# places of the constants
KIND, H, TIME_0, PERIOD, PERIOD_LO, TURN, TURN_LO, CLOCK, BARRIER, NOME, SIGN = range(11)
RATE_J, RATE_X, SIZE_J, SIZE_X, SIZE_A2, SIZE_B2, PSI_RE, PSI_IM, J3 = range(11, 20)
STATE = 20  # the initial state
TERMS = 4  # of each series
# coefficients of the series, TERMS of each kind
EVEN_J, ODD_J, EVEN_A, ODD_A, EVEN_B, ODD_B, DIVISOR, SIZE = (26 + TERMS * i for i in range(8))

NAME = "theta_functions"
REST, DIRECT, TRANSFORMED = range(3)
TOO_LATE = 1
LATEST = 1e15  # in units of 1/(|J| + √(|alpha||x|)); doubles of later times say nothing about the phase
FAILURES = {TOO_LATE: f"n |h| is over {LATEST:g} times the time scale of the top: its phase is beyond double"}
WEIGHTLESS = 2.0**-100  # a smaller alpha, in units of the orbit, changes no double at any admissible time
UPRIGHT = 1e-40  # least J+ or x+, in units of the orbit: the fourth powers of smaller ones underflow
FOREVER = 1e300  # the period on the separatrix; products with it do not overflow
state_of = tuple_loader(6)


@jit
def reduce_time(t, c):
    """The number n of whole periods since t0, and the rest r in [−T/2, T/2]; n T is subtracted in double-double."""
    n = np.rint((t + c[TIME_0]) / c[PERIOD])
    p, e = two_prod(n, c[PERIOD])
    return n, ((t - p) - (e + n * c[PERIOD_LO])) + c[TIME_0]


@jit
def angle_of_periods(n, turn, turn_lo):
    """The angle of n whole periods, in (−π, π]. turn, turn_lo : turns in one period."""
    p, e = two_prod(n, turn)
    return TWO_PI[0] * ((p - np.rint(p)) + (e + n * turn_lo))


@jit
def unit(angle):
    return complex(math.cos(angle), math.sin(angle))


@jit
def direct_factors(v, c):
    """θ2(v − iσβ)/θ4(v) for J+ and A, θ1(v − iσβ)/θ4(v) for B, each up to a constant."""
    z = unit(v)
    zz, even = z * z, complex(1.0, 0.0)
    J = A = B = complex(0.0, 0.0)
    divisor = 0.0
    for n in range(TERMS):
        J += complex(c[EVEN_J + n] * z.real, c[ODD_J + n] * z.imag)
        A += complex(c[EVEN_A + n] * z.real, c[ODD_A + n] * z.imag)
        B += complex(c[EVEN_B + n] * z.imag, c[ODD_B + n] * z.real)
        divisor += c[DIVISOR + n] * even.real
        even *= zz
        z *= zz
    return J / divisor, A / divisor, B / divisor


@jit
def transformed_factors(v, c):
    """θ4(σb + iV)/θ2(iV) for J+ and A, −i θ1(σb + iV)/θ2(iV) for B; all sums times e^−|V|."""
    V = abs(v)
    decay, u = math.exp(-V), math.exp(2.0 * (V - c[BARRIER]))  # u = q e^2V
    d = decay * decay
    J = A = B = complex(0.0, 0.0)
    divisor, rise, fall = 0.0, 1.0, 1.0
    for n in range(TERMS):
        even, odd = decay * (rise + fall), decay * (rise - fall)  # 2 qⁿ cosh 2nV, 2 qⁿ sinh 2nV
        J += complex(c[EVEN_J + n] * even, c[ODD_J + n] * odd)
        A += complex(c[EVEN_A + n] * even, c[ODD_A + n] * odd)
        even, odd = rise + d * fall, rise - d * fall  # 2 qⁿ cosh (2n + 1)V, 2 qⁿ sinh (2n + 1)V
        B += complex(c[EVEN_B + n] * odd, c[ODD_B + n] * even)
        divisor += c[DIVISOR + n] * even
        rise *= u
        fall *= c[NOME] * d
    if v < 0.0:
        J, A, B = J.conjugate(), A.conjugate(), -B.conjugate()
    return J / divisor, A / divisor, B / divisor


@jit
def factors(r, c):
    """F_J, F_A and F_B without e^{iλr}, each up to a constant."""
    return direct_factors(c[CLOCK] * r, c) if c[KIND] == DIRECT else transformed_factors(c[CLOCK] * r, c)


@jit
def model(n, r, c):
    """J+, x+ and x3 for ψ = 0."""
    J, A, B = factors(r, c)
    turn = angle_of_periods(n, c[TURN], c[TURN_LO])
    x3 = 0.5 * (c[SIZE_B2] * (B.real * B.real + B.imag * B.imag) - c[SIZE_A2] * (A.real * A.real + A.imag * A.imag))
    AB = A * B
    x = complex(-AB.imag, AB.real) * unit(turn + c[RATE_X] * r) * c[SIZE_X]
    return J * unit(turn + c[RATE_J] * r) * c[SIZE_J], x, x3


@jit
def position(t, rest, c):
    """The state at time t + `rest`, which is below an ulp of t."""
    s = state_of(c, STATE)
    if c[KIND] == REST:
        return s
    n, r = reduce_time(t, c)
    r += rest
    J, x, x3 = model(n, r, c)
    psi = complex(c[PSI_RE], c[PSI_IM])
    J *= psi
    x *= psi
    return J.real, J.imag, c[J3], c[SIGN] * x.real, c[SIGN] * x.imag, c[SIGN] * x3


@jit
def step(s, c, counters):
    """The state at the next multiple of h since the start of the run. It does not depend on s, only on the number of steps."""
    n = counters[MEMORY] + 1.0
    counters[MEMORY] = n
    t, rest = two_prod(n, c[H])
    if abs(t) > LATEST:
        counters[FAILURE] = TOO_LATE
        return s
    return position(t, rest, c)


@jit
def positions(instants, c):
    out = np.empty((len(instants), 6))
    for i in range(len(instants)):
        store_tuple(out[i], 0, position(instants[i], 0.0, c))
    return out


# ------------------------------------------------------------------------------------ the constants, in five stages


@jit
def cubic_roots(c0, c1, c2):
    """The roots of 2z³ + c2 z² + c1 z + c0, the largest first. Zero lies between the other two: product and sum give both."""
    largest = largest_root(c0, c1, c2)
    product = neg(div(scale(c0, 0.5), largest))
    half_sum = scale(div(sub(scale(c1, 0.5), product), largest), 0.5)
    root = sqrt(sub(mul(half_sum, half_sum), product))
    return largest, add(half_sum, root), sub(half_sum, root)


@jit
def levels_of(alpha, y):
    """Stage 1: ζ1, ζ2, ζ3, ζ_J, ζ_A, ζ_B and alpha D_J, alpha D_A, alpha D_B, double-doubles; alpha > 0."""
    J1, J2, m, x1, x2, x3 = y
    a, m_ = dd(alpha), dd(m)
    jj = add(two_prod(J1, J1), two_prod(J2, J2))
    xx = add(two_prod(x1, x1), two_prod(x2, x2))
    xj = add(two_prod(x1, J1), two_prod(x2, J2))
    slope = sub(two_prod(J1, x2), two_prod(J2, x1))
    s = sqrt(add(xx, two_prod(x3, x3)))
    if x3 >= 0.0:
        up = add(s, dd(x3))
        down = div(xx, up)
    else:
        down = sub(s, dd(x3))
        up = div(xx, down)
    zJ, zA, zB = scale(jj, 0.5), mul(a, down), neg(mul(a, up))
    half_a = scale(a, 0.5)
    dJ = scale(sub(mul(a, xj), mul(m_, zJ)), 0.5)
    dA = mul(half_a, sub(mul(m_, down), xj))
    dB = mul(half_a, add(mul(m_, up), xj))
    # The cubic of ξ = ζ_A − ζ. ζ1 and ζ2 lie on either side of ξ = 0, so they keep their digits where they are close.
    h0 = sub(jj, scale(zA, 2.0))
    c2 = add(h0, sub(mul(m_, m_), scale(mul(a, s), 4.0)))
    c1 = scale(add(mul(mul(a, s), h0), scale(mul(m_, dA), 2.0)), -2.0)
    c0 = scale(mul(dA, dA), 4.0)
    xi3, xi2, xi1 = cubic_roots(c0, c1, c2)
    z1, z2, z3 = sub(zA, xi1), sub(zA, xi2), sub(zA, xi3)
    if xi2[0] - xi1[0] >= xi3[0] - xi2[0]:
        # The cubic of ζ: the same holds for ζ2 and ζ3.
        c2 = sub(scale(two_prod(alpha, x3), 4.0), add(jj, mul(m_, m_)))
        c1 = scale(mul(a, sub(sub(mul(m_, xj), mul(dd(x3), jj)), mul(a, xx))), 2.0)
        c0 = mul(mul(a, slope), mul(a, slope))
        z1, z2, z3 = cubic_roots(c0, c1, c2)
    return z1, z2, z3, zJ, zA, zB, dJ, dA, dB


@jit
def split_gap(z1, z2, z3, z, d):
    """z − ζ2, ζ1 − z and σ for ζ2 ≤ z ≤ ζ1, where 2 (ζ1 − z)(z − ζ2)(z − ζ3) = 4 d². The smaller one comes from this product.

    If d = 0, σ is 0 for a factor with a real zero (z = ζ2), and 1 for one without (z = ζ1).
    """
    low, high = sub(z, z2), sub(z1, z)
    rest = scale(sub(z, z3), 0.5)
    if low[0] < high[0]:
        low = div(mul(d, d), mul(high, rest))
    elif low[0] > 0.0:
        high = div(mul(d, d), mul(low, rest))
    sigma = math.copysign(1.0, d[0])
    if d[0] == 0.0:
        sigma = 0.0 if low[0] < high[0] or low[0] <= 0.0 else 1.0
    return low, high, sigma


@jit
def clock(levels, m):
    """Stage 2: the period and the turn in it, in double-double. From here on doubles are enough.

    Then ζ1 − ζ2, ζ1 − ζ3, ζ2 − ζ3, and for J, A and B the distances of ζ_F from ζ1, ζ2, ζ3, and σ.
    """
    z1, z2, z3, zJ, zA, zB, dJ, dA, dB = levels
    J_low, J_high, sigma_J = split_gap(z1, z2, z3, zJ, dJ)
    A_low, A_high, sigma_A = split_gap(z1, z2, z3, zA, dA)
    T, turn = period_and_turn(z1, z2, z3, sub(zJ, z3), J_low, J_high, dJ, dd(m))
    of_J = max(J_high[0], 0.0), max(J_low[0], 0.0), sub(zJ, z3)[0], sigma_J
    of_A = max(A_high[0], 0.0), max(A_low[0], 0.0), sub(zA, z3)[0], sigma_A
    B3 = max(sub(z3, zB)[0], 0.0)
    of_B = sub(z1, zB)[0], sub(z2, zB)[0], B3, math.copysign(1.0, dB[0]) if dB[0] != 0.0 and B3 > 0.0 else 0.0
    return T, turn, np.array((sub(z1, z2)[0], sub(z1, z3)[0], sub(z2, z3)[0])), (of_J, of_A, of_B)


def start(levels, y, gaps):
    """Stage 3: κ, K, K', and the time since x3 was smallest."""
    (z12, z13, z23), (z1, z2, z3) = gaps, (root[0] for root in levels[:3])
    kappa, w = np.sqrt(0.5 * z13), 0.0
    if z3 < 0.0:
        w = np.sqrt(-z3) * elliprf(max(z2, 0.0), z1 * z23 / z13, z23)
    return kappa, ellipkm1(z12 / z13), ellipkm1(z23 / z13), np.copysign(w, y[0] * y[4] - y[1] * y[3]) / kappa


def shifts_of(gaps, distances, K_):
    """Stage 4: η and K' − η, and σ, of J, A and B."""
    (z12, z13, z23), shifts = gaps, []
    for to_1, to_2, to_3, sigma in distances[:2]:
        eta = np.sqrt(to_2 * z13) * elliprf(to_1 * z23, z23 * z12, to_3 * z12)
        rest = np.sqrt(to_1) * elliprf(to_2, to_3 * z12 / z13, z12)
        shifts.append((eta, rest, sigma))
    to_1, to_2, to_3, sigma = distances[2]
    eta = np.sqrt(to_3) * elliprf(z23, z23 * to_1 / z13, to_2)
    rest = np.sqrt(z13) * elliprf(to_3, to_2, to_1)
    shifts.append((eta, rest, sigma))
    return tuple((eta, rest, sigma) if sigma else (0.0, K_, sigma) for eta, rest, sigma in shifts)


@jit
def put_direct(shifts, K, c):
    """Stage 5: put the coefficients for k² ≤ 1/2, those of J, A and B over e^β, into c. Returns d arg/dv where |F| is largest."""
    q, slopes = c[NOME], np.empty(3)
    for i, (eta, rest, sigma) in enumerate(shifts):
        grow, fall = math.exp(-math.pi * rest / K), math.exp(-math.pi * eta / K)  # q e^2β, e^−2β
        top = bottom = 0.0
        for n in range(TERMS):
            up, down = q ** (n * n) * grow**n, q ** (n * n + n) * fall ** (n + 1)
            even, odd = up + down, sigma * (up - down)
            top += (2 * n + 1) * odd
            bottom += even
            c[EVEN_J + 2 * TERMS * i + n], c[ODD_J + 2 * TERMS * i + n] = even, odd
        slopes[i] = top / bottom
    for n in range(TERMS):
        sign = (-1.0) ** n
        c[EVEN_B + n] *= sign
        c[ODD_B + n] *= -sign
        c[DIVISOR + n] = sign * q ** (n * n) * (2.0 if n > 0 else 1.0)
    return slopes


@jit
def put_transformed(shifts, K_, c):
    """Stage 5 for k² > 1/2: the coefficients over qⁿ. Returns d arg/dV."""
    q, slopes, b = c[NOME], np.empty(3), 0.0
    for i, (eta, _, sigma) in enumerate(shifts):
        b = sigma * 0.5 * math.pi * eta / K_
        top = bottom = 0.0
        for n in range(TERMS):
            weight = (-1.0) ** n * q ** (n * n - n) if n > 0 else 0.5
            even, odd = weight * math.cos(2 * n * b), -weight * math.sin(2 * n * b)
            top += 2 * n * q**n * odd
            bottom += q**n * even
            c[EVEN_J + 2 * TERMS * i + n], c[ODD_J + 2 * TERMS * i + n] = even, odd
        slopes[i] = top / bottom
    for n in range(TERMS):  # B has θ1
        weight, angle = (-1.0) ** n * q ** (n * n), (2 * n + 1) * b
        c[EVEN_B + n], c[ODD_B + n], c[DIVISOR + n] = weight * math.cos(angle), -weight * math.sin(angle), abs(weight)
    return slopes


def put_scales(levels, J3_, A3, B2, slopes, alpha, y, c):
    """Stage 5: put the rates λ, the constant factors, and the phase ψ at the start into c."""
    J1, J2, m, x1, x2, x3 = y
    dJ, dA, dB = levels[6:]
    c[RATE_J] = 0.5 * m + (dJ[0] / J3_ - c[CLOCK] * slopes[0])
    c[RATE_X] = (dA[0] / A3 - c[CLOCK] * slopes[1]) + (dB[0] / B2 - c[CLOCK] * slopes[2])
    # factors of J+ and A where x3 is smallest, of B where it is largest
    J, A, _ = factors(0.0, c)
    _, _, B = factors(0.5 * c[PERIOD], c)
    c[SIZE_J] = math.sqrt(2.0 * J3_) / abs(J)
    c[SIZE_A2], c[SIZE_B2] = A3 / alpha / abs(A) ** 2, B2 / alpha / abs(B) ** 2
    c[SIZE_X] = math.sqrt(c[SIZE_A2] * c[SIZE_B2])
    J, x, _ = model(*reduce_time(0.0, c), c)
    length = x1 * x1 + x2 * x2 + x3 * x3
    weight = J1 * J1 + J2 * J2 + m * m + alpha * math.sqrt(length)
    psi = J.conjugate() * complex(J1, J2) * length + x.conjugate() * complex(x1, x2) * weight
    c[PSI_RE], c[PSI_IM] = psi.real / abs(psi), psi.imag / abs(psi)


@np.errstate(all="ignore")
def constants(units: Units, y0: Array, span: float, h: float | None = None) -> Array:
    """The constants of `position` for the motion through y0 at t = 0. h : for messages."""
    c, alpha, state = np.zeros(SIZE), units.alpha, units.enter(y0)
    c[H], c[J3], c[SIGN], c[STATE : STATE + 6] = span, state[2], math.copysign(1.0, alpha), state
    offset = np.max(np.abs(state[[0, 1, 3, 4]]))
    if offset == 0.0 or (alpha == 0.0 and not np.any(state[:3])):
        c[KIND] = REST
        return c
    if offset < UPRIGHT:
        reason = f"J and x are off the vertical, but by less than {UPRIGHT:g} of their size: the closed form underflows"
        raise StepError(NAME, reason, h=h)
    state *= np.repeat((1.0, c[SIGN]), 3)  # for alpha < 0 the mirror image
    alpha, y = max(abs(alpha), WEIGHTLESS), tuple(state.tolist())
    levels = levels_of(alpha, y)
    T, turn, gaps, distances = clock(levels, y[2])
    kappa, K, K_, c[TIME_0] = start(levels, y, gaps)
    c[PERIOD], c[PERIOD_LO] = T if T[0] < FOREVER else (FOREVER, 0.0)
    c[TURN], c[TURN_LO] = turn
    shifts = shifts_of(gaps, distances, K_)
    c[KIND], put_series = DIRECT, put_direct
    if gaps[2] > gaps[0]:
        c[KIND], put_series, K, K_ = TRANSFORMED, put_transformed, K_, K
    c[CLOCK], c[BARRIER] = 0.5 * np.pi * kappa / K, 0.5 * np.pi * K_ / K
    c[NOME] = np.exp(-2.0 * c[BARRIER])
    slopes = put_series(shifts, K, c)
    put_scales(levels, distances[0][2], distances[1][2], distances[2][1], slopes, alpha, y, c)
    if np.any(np.isnan(c)):
        raise StepError(NAME, "the constants of the closed form are beyond the range of doubles", h=h)
    return c


class ThetaStepper(FixedStepper):
    """Evaluates the closed form at every multiple of h since the state with which the run began."""

    from_start = True
    units: Units

    def __init__(self, top: LagrangeTop, y0: Array, h: float):
        units = Units(top, y0, h)
        c = constants(units, y0, units.span(NAME, h), h)
        super().__init__(NAME, h, Kernel(step, failures=FAILURES), c, units)

    def record(self, y: Array, n: int, every: int) -> Array:
        y = as_state(y)
        self.constants = constants(self.units, y, self.constants[H], self.h)
        return super().record(y, n, every)


def evaluate(problem: LagrangeTop | RigidBody, y0: Array, times: Array) -> tuple[Array, Work]:
    """The states at any times, with one evaluation for each."""
    if isinstance(problem, RigidBody):
        return closed_form(problem, y0, times), Work(steps=len(times))
    units = Units(problem, y0, 1.0)
    states = units.leave(positions(units.spans(NAME, times), constants(units, y0, 0.0)))
    states[times == 0.0] = y0  # with the digits that the formulas lose beside |x|
    return states, Work(steps=len(times))


def prepare_body(body: RigidBody, y0: Array, h: float) -> BodyStepper:
    """The closed form of a free or symmetric body at every multiple of h."""
    return BodyStepper(body, h, closed_form)


METHOD = Method(
    name=NAME,
    label="Theta functions",
    family="closed-form",
    order=None,
    claims=Claims(symmetric=True, poisson=True, conserves={"H", "J3", "C1", "C2"}),
    source="Whittaker, Analytical Dynamics, sections 37, 71-72; Jacobi, Werke 2 (1882) 477",
    prepare=ThetaStepper,
    evaluate=evaluate,
    kernels_for={kinds.symmetric_body: prepare_body, kinds.free_body: prepare_body},
)
