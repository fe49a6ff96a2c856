# %% [markdown]
# # The Lagrange top, integrated exactly
#
# A picture book to the suite. The outputs are stored, so it can be read without running it; to run it, install the package
# (`pip install .`) and Jupyter. Written by `python docs/notebook/build.py` from `the_top.py`; a test runs it.
#
# State: angular momentum J and axis x. Motion: J' = α e3 × x, x' = J × x.

# %%
import matplotlib.pyplot as plt
import numpy as np

from lagrange_bench import TOPS, exact, integrate
from lagrange_bench.integrators.torus import time_step

named = TOPS["generic"]
top, y0 = named.top, named.state
T = exact.nutation_period(top, y0)
print(f"{top}, one nutation takes {T:.4f}, meanwhile it goes round by {exact.precession_per_nutation(top, y0):.4f} rad")

# %% [markdown]
# ## Steps along the true orbit
#
# The exact Bäcklund step jumps from point to point of the true orbit (grey line), here in steps of 0.45 nutations. Strang's
# splitting takes four steps in the same time. Rings: where the axis is at these times. Dots: where the method has it.

# %%
h, n = 0.45 * T, 24
orbit = exact.solution(top, y0, np.linspace(0, n * h, 3000))
jumps = integrate(top, y0, h=h, steps=n, every=1).y
strang = integrate(top, y0, h=h / 4, steps=4 * n, every=4, method="strang").y
truth = exact.solution(top, y0, h * np.arange(n + 1))

figure, axes = plt.subplots(1, 2, figsize=(7, 3.2), sharey=True)
for ax, states, title, colour in ((axes[0], jumps, "exact step", "#0072B2"), (axes[1], strang, "Strang", "#D55E00")):
    ax.plot(orbit[:, 3], orbit[:, 4], color="#bbbbbb", linewidth=0.6)
    ax.plot(truth[:, 3], truth[:, 4], "o", color="#555555", markersize=7, fillstyle="none", markeredgewidth=0.7)
    ax.plot((truth[:, 3], states[:, 3]), (truth[:, 4], states[:, 4]), color=colour, linewidth=0.8)
    ax.plot(states[:, 3], states[:, 4], "o", color=colour, markersize=3.5)
    ax.set(title=title, xlabel="x1", aspect="equal")
axes[0].set_ylabel("x2  (the axis from above)")
figure.tight_layout()

# %%
for name, states in (("exact step", jumps), ("Strang", strang)):
    error = np.max(np.abs(states - truth))
    print(f"{name:10} largest error {'below 1e-13' if error < 1e-13 else f'{error:.1f}'}")

# %% [markdown]
# ## Two errors: off the torus, and along it
#
# Invariants say whether a method stays on the torus of the motion, phase whether it is at the right place there. Four
# methods, the same step 0.05. Left: the energy. Right: the whole error. The midpoint rule keeps its energy and is late
# all the same. Runge-Kutta, of order five, is ahead of it for long, but loses energy in proportion to time, phase to its square.

# %%
counts = np.unique(np.geomspace(1, 20_000, 60).astype(int)) * 10
colours = {"backlund": "#0072B2", "strang": "#D55E00", "implicit_midpoint": "#009E73", "rk45_fixed": "#CC79A7"}
truth = exact.solution(top, y0, 0.05 * counts)
figure, axes = plt.subplots(1, 2, figsize=(7, 3.2), sharey=True)
for method, colour in colours.items():
    y = integrate(top, y0, h=0.05, steps=200_000, every=10, method=method).y[counts // 10]
    energy = np.abs(top.invariants(y)[:, 0] - top.invariants(y0)[0])
    error = np.max(np.abs(y - truth), axis=1)
    axes[0].loglog(0.05 * counts, np.maximum(energy, 1e-17), color=colour, label=method)
    axes[1].loglog(0.05 * counts, error, color=colour)
axes[0].set(title="error of H", xlabel="t")
axes[1].set(title="error of the state", xlabel="t")
figure.legend(loc="lower center", ncols=4, frameon=False, fontsize=8)
figure.tight_layout(rect=(0, 0.07, 1, 1))

# %% [markdown]
# ## λ(h)
#
# The exact step is the two-point Bäcklund map of Kuznetsov, Petrera and Ragnisco with a complex parameter λ, chosen so
# that one step takes the time h. As h grows, λ leaves the origin upwards, passes the roots of the spectral polynomial Q
# (crosses), and goes to infinity as h comes near a whole nutation T. `docs/exact-step.md` has the mathematics.

# %%
figure, ax = plt.subplots(figsize=(4.5, 3.4))
for name, colour in (("figure2", "#0072B2"), ("near_regular", "#D55E00"), ("slow", "#009E73")):
    named = TOPS[name]
    rate, size, _ = named.top.scales(named.state)
    q = time_step.spectral_polynomial(named.alpha, named.y0)
    period = exact.nutation_period(named.top, named.state)
    path = []
    for share in np.linspace(0.005, 0.97, 150):
        (re, im), _ = time_step.parameter(q, (share * period, 0.0))
        path.append(complex(re[0], im[0]) * rate / size)
    roots = np.roots([c[0] for c in reversed(q)]) * rate / size
    path, roots = np.array(path), roots[roots.imag > 0]
    ax.plot(path.real, path.imag, color=colour, label=name)
    ax.plot(roots.real, roots.imag, "x", color=colour)
ax.set(xlabel="Re λ", ylabel="Im λ  (units of |x| / (|J| + √(α|x|)))", xlim=(-4, 4), ylim=(0, 4))
ax.legend(frameon=False, fontsize=8)
figure.tight_layout()

# %% [markdown]
# ## Any distance in one map
#
# Times may lie anywhere. Each is one map away from the start.

# %%
times = np.array([1.0, 1e3, 1e6])
far = integrate(top, y0, t=times)
error = np.max(np.abs(far.y - exact.solution(top, y0, times)))
print("a million units of time in one map, error below 1e-14:", bool(error < 1e-14))
