// The tumbling body: a T-handle in weightlessness that turns over and over (Dzhanibekov), exactly, and by a rule with steps.
// A state is [ω1, ω2, ω3, q0, q1, q2, q3]: angular velocity in the body, and the attitude, a unit quaternion that takes
// vectors of the body to space.

const Tumble = (() => {
  const I = [0.35, 1, 1.35]; // moments of inertia of a flat body: the third is the sum of the others
  const START = [0.01, 3, 0.01, Math.SQRT1_2, Math.SQRT1_2, 0, 0]; // about the stem, the middle axis, which points up
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const product = (a, b) => [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3], a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3], a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1],
  ];
  const unit = (q) => q.map((c) => c / Math.hypot(...q));
  const along = (y, h, d) => y.map((c, i) => c + h * d[i]);

  // Euler's equations I ω′ = (I ω) × ω, and q′ = q ω / 2
  const momentum = (w) => w.map((c, i) => I[i] * c);
  const angular = (w) => cross(momentum(w), w).map((c, i) => c / I[i]);
  const slope = (y) => [...angular(y.slice(0, 3)), ...product(y.slice(3), [0, ...y.slice(0, 3)]).map((c) => 0.5 * c)];

  // the attitude after a turn by the vector `angle` of the body
  function turned(q, angle) {
    const size = Math.hypot(...angle), s = size > 0 ? Math.sin(size / 2) / size : 0.5;
    return unit(product(q, [Math.cos(size / 2), ...angle.map((c) => s * c)]));
  }

  function rk4(y, h) {
    const k1 = slope(y), k2 = slope(along(y, h / 2, k1)), k3 = slope(along(y, h / 2, k2)), k4 = slope(along(y, h, k3));
    const z = y.map((c, i) => c + (h / 6) * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]));
    return [...z.slice(0, 3), ...unit(z.slice(3))];
  }

  // ω from `next`, then the turn by it: what games do
  const spun = (next) => (y, h) => { const w = next(y.slice(0, 3), h); return [...w, ...turned(y.slice(3), w.map((c) => h * c))]; };

  // the turn about one axis alone is exact: L turns about it by −ω_i h
  function about(y, i, h) {
    const L = momentum(y.slice(0, 3)), [j, k] = [(i + 1) % 3, (i + 2) % 3], angle = (h * L[i]) / I[i];
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    [L[j], L[k]] = [c * L[j] + s * L[k], c * L[k] - s * L[j]];
    return [...L.map((m, l) => m / I[l]), ...turned(y.slice(3), [0, 1, 2].map((l) => (l === i ? angle : 0)))];
  }

  const RULES = {
    "no gyroscopic torque, a default of games": spun((w) => w),
    "explicit Euler": spun((w, h) => along(w, h, angular(w))),
    "three rotations (Strang)": (y, h) => [0, 1, 2, 1, 0].reduce((z, i) => about(z, i, i === 2 ? h : h / 2), y),
    RK4: rk4,
  };

  // the truth: RK4 with steps of at most 1/500 s, which is off by less than 1e-9 after a minute
  function truth(y, h) {
    const parts = Math.ceil(500 * Math.abs(h));
    for (let i = 0; i < parts; i++) y = rk4(y, h / parts);
    return y;
  }

  // a vector of the body in space
  const inSpace = (q, p) => { const v = q.slice(1), u = cross(v, p), w = cross(v, u); return p.map((c, i) => c + 2 * (q[0] * u[i] + w[i])); };
  const energy = (y) => y.slice(0, 3).reduce((sum, c, i) => sum + 0.5 * I[i] * c * c, 0);
  const angle = (a, b) => 2 * Math.acos(Math.min(1, Math.abs(a.slice(3).reduce((sum, c, i) => sum + c * b[i + 3], 0))));

  return { I, RULES, START, angle, energy, inSpace, truth };
})();

// ---------------------------------------------------------------- its controls

(() => {
  const section = document.getElementById("tumble");
  if (!section) return;
  const $ = (name) => section.querySelector(`[name="${name}"]`);
  const canvas = section.querySelector("canvas"), told = section.querySelector(".told");
  const COLOUR = "#D55E00", MOST = 60; // s
  let timer = 0, key = "", states = [];

  function draw() {
    const h = 1 / Number($("rate").value), rule = Tumble.RULES[$("rule").value], n = Math.round(Number($("time").value) / h);
    if (key !== $("rule").value + h) [key, states] = [$("rule").value + h, [[Tumble.START, Tumble.START]]];
    while (states.length <= n) {
      const [exact, near] = states[states.length - 1];
      states.push([Tumble.truth(exact, h), rule(near, h)]);
    }
    const [exact, near] = states[n], off = Tumble.angle(exact, near), gained = Tumble.energy(near) / Tumble.energy(Tumble.START) - 1;
    section.querySelector('[for="tumble-time"] output').textContent = `${(n * h).toFixed(1)} s`;
    section.querySelector('[for="tumble-rate"] output').textContent = `1/${$("rate").value} s`;
    $("time").setAttribute("aria-valuetext", `${(n * h).toFixed(1)} seconds`);
    told.textContent = `The attitude is off by ${Picture.show((180 / Math.PI) * off)}°, the energy by ${Picture.show(100 * Math.abs(gained))} %.`;
    const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    const trail = (i) => states.slice(Math.max(0, n - Math.round(4 / h)), n + 1).map((pair) => pair[i]);
    Picture.handles(canvas, [{ colour: css("--ink"), trail: trail(0) }, { colour: COLOUR, trail: trail(1) }], css("--line"));
    section.dataset.ready = "yes";
  }

  function play() {
    clearInterval(timer);
    if (timer) { timer = 0; $("play").textContent = "Play"; return; }
    $("play").textContent = "Stop";
    if (Number($("time").value) >= MOST) $("time").value = 0;
    let last = performance.now();
    timer = setInterval(() => {
      const now = performance.now();
      $("time").value = Number($("time").value) + ((now - last) / 1000) * Number($("speed").value);
      last = now;
      if (Number($("time").value) >= MOST) play();
      draw();
    }, 40);
  }

  $("rule").append(...Object.keys(Tumble.RULES).map((name) => new Option(name)));
  for (const kind of ["input", "change", "click"]) section.addEventListener(kind, (event) => event.stopPropagation()); // the top's are around
  for (const kind of ["input", "change"]) section.addEventListener(kind, draw);
  $("play").addEventListener("click", play);
  new ResizeObserver(draw).observe(canvas);
})();
