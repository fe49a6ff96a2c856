"use strict";

// The Lagrange top in the browser: the real form of the two-point Bäcklund map with λ(h) by time doubling, three other
// integrators, and the invariants; all of it also in a tide k x1²/2. The formulas are those of integrators/torus and
// integrators/methods, in plain doubles; tests/test_report/test_live.py compares the states with Python's. A state is
// [J1, J2, J3, x1, x2, x3].

const Top = (() => {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const scaled = (a, r) => a.map((c) => c * r);
  const split = (y) => [y.slice(0, 3), y.slice(3)];

  // complex numbers are pairs
  const mul = (a, b) => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
  const add = (a, b) => [a[0] + b[0], a[1] + b[1]];
  const scale = (a, r) => [a[0] * r, a[1] * r];
  const div = (a, b) => scale(mul(a, [b[0], -b[1]]), 1 / (b[0] * b[0] + b[1] * b[1]));
  const root = (z) => {
    const r = Math.hypot(z[0], z[1]);
    const re = Math.sqrt(0.5 * (r + Math.abs(z[0])));
    if (re === 0) return [0, 0];
    const im = (0.5 * z[1]) / re;
    return z[0] >= 0 ? [re, im] : im >= 0 ? [im, re] : [-im, -re];
  };

  // H, J3, C1, C2; in a tide J3 changes
  function invariants(alpha, y, k = 0) {
    const [J, x] = split(y);
    return [0.5 * dot(J, J) + alpha * x[2] + 0.5 * k * x[0] * x[0], J[2], dot(x, x), dot(x, J)];
  }

  // coefficients of Q(u) = C1 + 2 C2 u + 2H u² + 2 alpha J3 u³ + alpha² u⁴
  function spectralPolynomial(alpha, y) {
    const [H, J3, C1, C2] = invariants(alpha, y);
    return [C1, 2 * C2, 2 * H, 2 * alpha * J3, alpha * alpha];
  }

  const horner = (q, u) => q.reduceRight((r, c) => add(mul(r, u), [c, 0]), [0, 0]);
  const derivative = (q) => q.slice(1).map((c, k) => c * (k + 1));

  // of the two square roots of Q(λ) the one continuous from +√C1 along the segment from 0
  function branch(q, lambda) {
    let m = [Math.sqrt(q[0]), 0];
    for (let k = 1; k <= 256; k++) {
      const r = root(horner(q, scale(lambda, k / 256)));
      m = r[0] * m[0] + r[1] * m[1] >= 0 ? r : scale(r, -1);
    }
    return m;
  }

  // (λ, m) for a time h > 0 of at most an eighth of the top's own: the power series of ∫du/√Q, solved by Newton's method.
  // And `spin`, exp(iχ/2) of the angle χ by which a body turns about its axis, as in integrators/torus/attitude
  function start(q, h) {
    const terms = 28, size = Math.sqrt(q[0]), g = [1 / size];
    for (let n = 1; n < terms; n++) {
      let s = 0;
      for (let k = 1; k <= Math.min(n, 4); k++) s += q[k] * g[n - k] * (k / 2 + (n - k));
      g.push(-s / (q[0] * n));
    }
    let lambda = [0, 0.5 * size * h];
    for (let i = 0; i < 20; i++) {
      let F = [0, 0], G = [0, 0];
      for (let k = terms - 1; k >= 0; k--) {
        F = add(mul(F, lambda), [g[k] / (k + 1), 0]);
        G = add(mul(G, lambda), [g[k] / (k + 2), 0]);
      }
      F = mul(F, lambda);
      G = mul(mul(G, lambda), lambda);
      const b = 0.5 * h - F[1], a = -(G[1] + lambda[0] * b) / lambda[1];
      lambda = add(lambda, scale([a, b], size));
      if (Math.abs(a) + Math.abs(b) < 1e-17 * lambda[1]) break;
    }
    let s = [0, 0];
    for (let k = terms - 1; k > 0; k--) s = mul(add(s, [g[k] / k, 0]), lambda);
    const half = -size * s[1], spin = scale(mul([-Math.cos(half), -Math.sin(half)], [lambda[0], -lambda[1]]), 1 / Math.hypot(...lambda));
    return { lambda, m: root(horner(q, lambda)), spin }; // so close to 0 that Re m > 0
  }

  // λ, m and spin of twice the time: the group law of the spectral curve
  function doubled(q, { lambda, m, spin }) {
    const [R, eta] = lambda;
    const g = div(horner(derivative(q), lambda), scale(m, 2));
    const a1 = m[0] / eta, b0 = (0.5 * g[0]) / eta, b1 = (0.5 * (a1 + g[1])) / (eta * eta);
    const eta2 = Math.sqrt(2 * a1 * b1 + q[4]) / b1, v = [-b0 / b1, eta2];
    const w = scale(add(mul(v, v), [eta * eta, 0]), -b1 * eta2);
    const atZero = [(b0 - b1 * R) * (R * R + eta * eta) - m[1] - a1 * R, -Math.sqrt(q[0])];
    const turn = scale(mul(mul(spin, spin), atZero), 1 / Math.hypot(...atZero));
    return { lambda: [R + v[0], eta2], m: [w[0] - a1 * v[1], w[1] + a1 * v[0] - m[1]], spin: turn };
  }

  // λ, m and spin with time h, for 0 < h < nutation period
  function parameter(q, h, unit) {
    let doublings = 0;
    while (h > unit / 8) { h /= 2; doublings++; }
    let point = start(q, h);
    while (doublings--) point = doubled(q, point);
    return point;
  }

  // π/agm(√((z1 − z3)/2), √((z1 − z2)/2)) of the roots of the cubic of nutation, z = alpha x3; Infinity on a separatrix
  function nutationPeriod(alpha, y) {
    const [J, x] = split(y), slope = J[0] * x[1] - J[1] * x[0];
    const xj = x[0] * J[0] + x[1] * J[1], xx = x[0] * x[0] + x[1] * x[1], jj = J[0] * J[0] + J[1] * J[1];
    const c2 = 4 * alpha * x[2] - J[2] * J[2] - jj, c1 = 2 * alpha * (J[2] * xj - x[2] * jj - alpha * xx);
    const c0 = (alpha * slope) ** 2;
    let z1 = 2 * Math.max(Math.abs(c2), Math.sqrt(Math.abs(c1)), Math.cbrt(c0)) + 1e-300;
    for (let i = 0; i < 100; i++) {
      const next = z1 - (((2 * z1 + c2) * z1 + c1) * z1 + c0) / ((6 * z1 + 2 * c2) * z1 + c1);
      if (!(next < z1)) break;
      z1 = next;
    }
    const mean = -0.25 * (c2 + 2 * z1), half = Math.sqrt(Math.max(mean * mean - (0.5 * c1 - 2 * z1 * mean), 0));
    let a = Math.sqrt(0.5 * (z1 - mean + half)), b = Math.sqrt(Math.max(0.5 * (z1 - mean - half), 0));
    if (!(a > 0 && b > 0)) return Infinity;
    for (let i = 0; i < 60 && Math.abs(a - b) > 1e-15 * a; i++) [a, b] = [0.5 * (a + b), Math.sqrt(a * b)];
    return (2 * Math.PI) / (a + b);
  }

  const scaleOfTime = (alpha, y) => 1 / (Math.hypot(...y.slice(0, 3)) + Math.sqrt(Math.abs(alpha) * Math.hypot(...y.slice(3))));

  // The vector w of length Im λ about which the map of a point (λ, m) of the curve turns x
  function direction(alpha, y, lambda, m) {
    const [J, x] = split(y), [R, eta] = lambda, r2 = R * R - eta * eta;
    const p = [x[0] + R * J[0], x[1] + R * J[1], x[2] + R * J[2] + alpha * r2];
    const q = [eta * J[0], eta * J[1], eta * (J[2] + 2 * alpha * R)];
    const n = cross(p, q);
    const w = [0, 1, 2].map((i) => m[0] * p[i] + m[1] * q[i] - n[i]);
    return w.map((c) => (c * eta) / Math.hypot(...w)); // as long as η: the denominator loses its digits close to a root of Q
  }

  function twoPoint(alpha, y, lambda, m) {
    const [J, x] = split(y), [R] = lambda, w = direction(alpha, y, lambda, m);
    const K = [J[0] - 2 * alpha * w[1], J[1] + 2 * alpha * w[0], J[2]];
    const u = cross(w, x), v = cross(w, u), f = 2 / (R * R + dot(w, w));
    return [...K, ...[0, 1, 2].map((i) => x[i] + f * (v[i] + R * u[i]))];
  }

  function turned(y, c, s) {
    return [c * y[0] - s * y[1], s * y[0] + c * y[1], y[2], c * y[3] - s * y[4], s * y[3] + c * y[4], y[5]];
  }

  // cos and sin of the precession in one nutation period: two steps of half of it
  function precession(alpha, y, q, period, unit) {
    const { lambda, m } = parameter(q, 0.5 * period, unit);
    const e = twoPoint(alpha, twoPoint(alpha, y, lambda, m), lambda, m);
    const k = y[0] ** 2 + y[1] ** 2 > y[3] ** 2 + y[4] ** 2 ? 0 : 3;
    const z = [y[k] * e[k] + y[k + 1] * e[k + 1], y[k] * e[k + 1] - y[k + 1] * e[k]], n = Math.hypot(...z);
    return n > 0 ? scale(z, 1 / n) : [1, 0];
  }

  // The exact flow over h, any sign and size, as a map of the torus of y
  function exactStep(alpha, y, h) {
    const q = spectralPolynomial(alpha, y), unit = scaleOfTime(alpha, y), period = nutationPeriod(alpha, y);
    const turns = Number.isFinite(period) ? Math.round(h / period) : 0;
    let rest = h - turns * period, turn = [1, 0];
    if (turns === 0) rest = h;
    else {
      const one = precession(alpha, y, q, period, unit), angle = turns * Math.atan2(one[1], one[0]);
      turn = [Math.cos(angle), Math.sin(angle)];
    }
    const { lambda, m } = parameter(q, Math.abs(rest), unit), sheet = rest < 0 ? scale(m, -1) : m;
    const still = Math.abs(rest) < 1e-15 * Math.abs(h);
    return { lambda, m: sheet, turns, step: (s) => turned(still ? s : twoPoint(alpha, s, lambda, sheet), ...turn) };
  }

  const product = (a, b) => [a[0] * b[0] - dot(a.slice(1), b.slice(1)), ...cross(a.slice(1), b.slice(1)).map((c, i) => c + a[0] * b[i + 1] + b[0] * a[i + 1])];

  // The attitude after a time t > 0 of a body with equal moments of inertia, a unit quaternion, 1 at the start: exact steps of
  // at most half a nutation. null: there are too many of them
  function attitude(alpha, y, t) {
    const q = spectralPolynomial(alpha, y), unit = scaleOfTime(alpha, y);
    const parts = Math.ceil(t / (0.5 * Math.min(nutationPeriod(alpha, y), 32 * unit)));
    if (parts > 50000) return null;
    let s = y, g = [1, 0, 0, 0];
    const { lambda, m, spin } = parameter(q, t / (parts || 1), unit);
    for (let i = 0; i < parts; i++) {
      const x = s.slice(3), w = direction(alpha, s, lambda, m), part = spin[1] / Math.hypot(...x);
      g = product([-lambda[0], ...scaled(w, -1)], product([spin[0], ...scaled(x, part)], g));
      g = scaled(g, 1 / Math.hypot(...g));
      s = twoPoint(alpha, s, lambda, m);
    }
    return g;
  }

  // The map of any λ with Im λ > 0: a time step of T(λ) and a turn about e3
  function freeStep(alpha, y, lambda, h = 1) {
    const m = branch(spectralPolynomial(alpha, y), lambda), sheet = h < 0 ? scale(m, -1) : m;
    return { lambda, m: sheet, turns: 0, step: (s) => twoPoint(alpha, s, lambda, sheet) };
  }

  // ∇U × x of U = alpha x3 + k x1²/2
  const torque = (alpha, k, x) => [-alpha * x[1], alpha * x[0] - k * x[0] * x[2], k * x[0] * x[1]];
  const slope = (alpha, k, y) => {
    const [J, x] = split(y);
    return [...torque(alpha, k, x), ...cross(J, x)];
  };
  const along = (y, h, d) => y.map((c, i) => c + h * d[i]);
  const kicked = (alpha, k, h, y) => along(y, h, [...torque(alpha, k, y.slice(3)), 0, 0, 0]);

  // The implicit midpoint rule at any h, as in integrators/methods/implicit_midpoint: the height z of the midpoint is the
  // root of a cubic, then Newton's method for v = (h/2) J at the midpoint. Not a number where there are three solutions.
  function midpoint(alpha, h, y) {
    const [J, x] = split(y), half = 0.5 * h, a = half * half * alpha, b = half * J[2];
    const slant = J[0] * x[1] - J[1] * x[0], flat = J[0] * x[0] + J[1] * x[1];
    const g = half * (half * (J[0] * J[0] + J[1] * J[1]) - a * slant);
    const k = a * (x[0] * x[0] + x[1] * x[1]) - half * (slant + b * flat);
    const cubic = (z) => {
      const u = 1 - a * z, w = u * u + b * b;
      return [w * (z - x[2]) + g * z + k, w - 2 * a * u * (z - x[2]) + g];
    };
    const p2 = -a * (2 + a * x[2]), w = p2 * p2 - 3 * a * a * (1 + b * b + 2 * a * x[2] + g);
    const turning = [-1, 1].map((sign) => (-p2 + sign * Math.sqrt(w)) / (3 * a * a));
    if (w > 0 && cubic(turning[0])[0] > 0 && cubic(turning[1])[0] < 0) return y.map(() => NaN);
    let high = 1.001 * Math.hypot(...x), low = -high, z = x[2];
    for (let i = 0; i < 200; i++) {
      const [value, slope] = cubic(z);
      if (value > 0) high = z; else low = z;
      let next = z - value / slope;
      if (!(low < next && next < high)) next = 0.5 * (low + high);
      if (next === z || high - low <= 2 ** -50 * Math.abs(z)) break;
      z = next;
    }
    const n = div([x[0] + half * J[1] * z, x[1] - half * J[0] * z], [1 - a * z, -b]);
    let v = [half * J[0] - a * n[1], half * J[1] + a * n[0], b], last = Infinity;
    const small = 2 ** -45 * (Math.abs(v[0]) + Math.abs(v[1]) + Math.abs(a) * Math.hypot(...x));
    for (let i = 0; i < 100; i++) {
      const q = 1 / (1 + dot(v, v)), solve = (u) => { const c = cross(v, u); return u.map((e, l) => q * (e + c[l])); };
      const d = solve(cross(v, x)), r = [half * J[0] - a * (x[1] + d[1]) - v[0], half * J[1] + a * (x[0] + d[0]) - v[1]];
      const size = Math.abs(r[0]) + Math.abs(r[1]);
      if (size === 0 || (size >= last && size <= small)) {
        const e = cross(v, x.map((c, l) => c + d[l])), twice = h * alpha; // e is equal to d but for round-off
        const mean = x.map((c, l) => c + 0.5 * (d[l] + e[l]));
        return [J[0] - twice * mean[1], J[1] + twice * mean[0], J[2], ...x.map((c, l) => c + d[l] + e[l])];
      }
      last = size;
      const m = x.map((c, l) => c + d[l]); // the midpoint: δm = (1 − v×)⁻¹ (δv × m)
      const pull = (u) => { const s = solve(u), c = q * dot(v, u); return s.map((e, l) => e + c * v[l]); };
      const [A, B] = [pull([0, -m[2], m[1]]), pull([m[2], 0, -m[0]])];
      const [m11, m12, m21, m22] = [1 + a * A[1], a * B[1], -a * A[0], 1 - a * B[0]], f = 1 / (m11 * m22 - m12 * m21);
      v = [v[0] + f * (m22 * r[0] - m12 * r[1]), v[1] + f * (m11 * r[1] - m21 * r[0]), b];
    }
    return y.map(() => NaN);
  }

  // A u = b by elimination; b becomes u
  function solved(A, b) {
    const n = b.length;
    for (let i = 0; i < n; i++) {
      let p = i;
      for (let r = i + 1; r < n; r++) if (Math.abs(A[r][i]) > Math.abs(A[p][i])) p = r;
      [A[i], A[p], b[i], b[p]] = [A[p], A[i], b[p], b[i]];
      for (let r = i + 1; r < n; r++) {
        const f = A[r][i] / A[i][i];
        for (let c = i; c < n; c++) A[r][c] -= f * A[i][c];
        b[r] -= f * b[i];
      }
    }
    for (let i = n - 1; i >= 0; i--) {
      for (let c = i + 1; c < n; c++) b[i] -= A[i][c] * b[c];
      b[i] /= A[i][i];
    }
    return b;
  }

  // The same in a tide, from its solution without: Newton's method for the midpoint z = y + (h/2) slope(z)
  function midpointInTide(alpha, k, h, y) {
    let z = midpoint(alpha, h, y).map((c, i) => 0.5 * (c + y[i])), last = Infinity;
    for (let i = 0; i < 50; i++) {
      const f = slope(alpha, k, z), r = z.map((c, l) => y[l] - c + 0.5 * h * f[l]);
      const size = r.reduce((sum, c) => sum + Math.abs(c), 0);
      if (size === 0 || (size >= last && size < 1e-14 * Math.hypot(...z))) return y.map((c, l) => c + h * f[l]);
      last = size;
      const [j1, j2, j3, x1, x2, x3] = z;
      const D = [
        [0, 0, 0, 0, -alpha, 0], [0, 0, 0, alpha - k * x3, 0, -k * x1], [0, 0, 0, k * x2, k * x1, 0],
        [0, x3, -x2, 0, -j3, j2], [-x3, 0, x1, j3, 0, -j1], [x2, -x1, 0, -j2, j1, 0],
      ];
      z = along(z, 1, solved(D.map((row, p) => row.map((c, q) => (p === q ? 1 : 0) - 0.5 * h * c)), r));
    }
    return y.map(() => NaN);
  }

  const ORDER = 24, SHARE = 0.2; // of the Taylor series, and its step as a part of the radius of convergence

  // The motion in a tide over h, to round-off: by Taylor series; the last four of ten numbers are the attitude, as above
  function taylor(alpha, k, y, h) {
    const unit = scaleOfTime(alpha, y.slice(0, 6)), sizes = [1 / unit, Math.hypot(...y.slice(3, 6)), 1];
    const times = (a, b, n) => { let s = 0; for (let i = 0; i <= n; i++) s += a[i] * b[n - i]; return s; };
    let s = y, left = Math.abs(h);
    while (left > 0) {
      const [a, b, c, u, v, w, ...g] = s.map((value) => [value]);
      for (let n = 0; n < ORDER; n++) {
        const f = Math.sign(h) / (n + 1);
        const next = [-alpha * v[n], alpha * u[n] - k * times(u, w, n), k * times(u, v, n),
          times(b, w, n) - times(c, v, n), times(c, u, n) - times(a, w, n), times(a, v, n) - times(b, u, n)];
        if (g.length) {
          next.push(-0.5 * (times(a, g[1], n) + times(b, g[2], n) + times(c, g[3], n)), 0.5 * (times(a, g[0], n) + times(b, g[3], n) - times(c, g[2], n)),
            0.5 * (times(b, g[0], n) + times(c, g[1], n) - times(a, g[3], n)), 0.5 * (times(c, g[0], n) + times(a, g[2], n) - times(b, g[1], n)));
        }
        [a, b, c, u, v, w, ...g].forEach((series, i) => series.push(f * next[i]));
      }
      const all = [a, b, c, u, v, w, ...g], tail = all.map((series, i) => Math.abs(series[ORDER]) / sizes[i < 3 ? 0 : i < 6 ? 1 : 2]);
      const step = Math.min(left, SHARE * Math.max(...tail) ** (-1 / ORDER));
      if (!(step > 0)) return y.map(() => NaN);
      s = all.map((series) => series.reduceRight((sum, e) => sum * step + e, 0));
      left -= step;
    }
    return s;
  }

  // Rivals: y → y after h
  const rivals = {
    rk4: (alpha, h, k) => (y) => {
      const k1 = slope(alpha, k, y), k2 = slope(alpha, k, along(y, h / 2, k1));
      const k3 = slope(alpha, k, along(y, h / 2, k2)), k4 = slope(alpha, k, along(y, h, k3));
      return y.map((c, i) => c + (h / 6) * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]));
    },
    implicit_midpoint: (alpha, h, k) => (y) => (k ? midpointInTide(alpha, k, h, y) : midpoint(alpha, h, y)),
    strang: (alpha, h, k) => (y) => {
      const [J, x] = split(kicked(alpha, k, 0.5 * h, y));
      const size = Math.hypot(...J), angle = h * size;
      const s = size > 0 ? Math.sin(angle) / size : h, c = size > 0 ? 2 * (Math.sin(angle / 2) / size) ** 2 : 0.5 * h * h;
      const u = cross(J, x), v = cross(J, u);
      return kicked(alpha, k, 0.5 * h, [...J, ...x.map((a, i) => a + s * u[i] + c * v[i])]);
    },
    // half of the exact flow without the tide, a kick by the tide, the other half: λ is another after every kick
    backlund_splitting: (alpha, h, k) => (y) => {
      const flow = (s) => exactStep(alpha, s, 0.5 * h).step(s);
      return flow(kicked(0, k, h, flow(y)));
    },
    truth: (alpha, h, k) => (y) => taylor(alpha, k, y, h),
  };

  // The step of a method from y: exact λ(h), the paper's λ = i h √C1/2, which know of no tide, or another
  function stepper(method, alpha, y, h, k = 0) {
    if (method === "backlund") return exactStep(alpha, y, h);
    if (method === "backlund_paper") return freeStep(alpha, y, [0, 0.5 * Math.abs(h) * Math.hypot(...y.slice(3))], h);
    return { step: rivals[method](alpha, h, k) };
  }

  // y and its images, `steps` of them
  function iterate(step, y, steps) {
    const states = [y];
    for (let i = 0; i < steps; i++) states.push(step(states[i]));
    return states;
  }

  return { attitude, exactStep, freeStep, invariants, iterate, nutationPeriod, scaleOfTime, stepper };
})();

if (typeof module !== "undefined") module.exports = Top;
