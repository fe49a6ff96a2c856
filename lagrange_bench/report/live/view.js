// The controls of the live top. The state of the section is in its controls; `draw` reads them all.

(() => {
  const section = document.getElementById("live");
  if (!section) return;
  const $ = (name) => section.querySelector(`[name="${name}"]`);
  const globe = section.querySelector(".sphere"), errors = section.querySelector(".errors"), energy = section.querySelector(".energy");
  const numbers = section.querySelector(".numbers tbody"), told = section.querySelector(".told"), note = section.querySelector(".exact");
  const STATE = ["J1", "J2", "J3", "x1", "x2", "x3"];
  const ORBIT = 3000; // points of the true orbit, at most
  const TRAIL = 2000; // marks of a method, at most
  const COMPARED = 40; // steps at which a method is held against the truth, at most
  const STEPS = 6400; // of a run, at most
  const REACH = 20000; // units of time over which the true motion in a tide is followed, at most
  const NO_TIDE = -7; // of the slider: the log10 of ε, or this
  const EYE = { around: 0.8, up: 0.45, size: 1 };
  const eye = { ...EYE };
  let timer = 0;

  // ---------------------------------------------------------------- reading the controls

  const number = (name) => ($(name).value.trim() === "" ? NaN : Number($(name).value));
  const own = () => ({ alpha: number("alpha"), y: STATE.map(number) });
  const about = (name) => LIVE.methods.find((m) => m.name === name);
  const boxes = () => [...section.querySelectorAll('[name="method"]')];
  // what a method becomes in a tide; undefined: it is for no tide
  const taken = (name, k) => (k ? about(name).tide : name);
  const chosen = (k) => boxes().filter((box) => box.checked).map((box) => taken(box.value, k)).filter(Boolean);
  const stepOf = (alpha, y) => 10 ** number("h") * Top.scaleOfTime(alpha, y); // the slider is log10 of h in the top's units

  // k of V = k x1²/2: V is at most ε/2 of the weight, or of the energy where there is no weight
  function tide({ alpha, y }) {
    const x = Math.hypot(...y.slice(3)), J = Math.hypot(...y.slice(0, 3));
    return number("eps") > NO_TIDE ? (10 ** number("eps") * (alpha ? Math.abs(alpha) * x : J * J)) / (x * x) : 0;
  }

  function set(top) {
    section.querySelector(".note").textContent = top.note;
    $("alpha").value = top.alpha;
    STATE.forEach((name, i) => { $(name).value = top.y[i]; });
  }

  // why there is nothing to draw, or ""
  function unfit({ alpha, y }, h) {
    if (![alpha, ...y].every(Number.isFinite)) return "Give α and six numbers.";
    if (!y.slice(3).some((c) => c !== 0)) return "The axis x must not be zero.";
    if (!(h > 0 && Number.isFinite(h))) return "A top without spin and without weight has no time scale: give it one of them.";
    if (![...Top.invariants(alpha, y), ...Top.exactStep(alpha, y, h).step(y)].every(Number.isFinite)) return "These numbers are too large or too small for doubles.";
    return "";
  }

  // ---------------------------------------------------------------- computing

  // A run is kept while only its length changes, and made longer where it is too short
  const kept = new Map();
  function run(name, alpha, k, y, h, steps) {
    const lambda = name === "free" ? [number("re"), number("im")] : null, key = JSON.stringify([alpha, k, y, h, lambda]);
    if (kept.get(name)?.key !== key) {
      const made = lambda ? Top.freeStep(alpha, y, lambda) : Top.stepper(name, alpha, y, h, k);
      kept.set(name, { key, made, all: [y], failed: false });
    }
    const one = kept.get(name), { made, all } = one;
    while (all.length <= steps && !one.failed) {
      const next = made.step(all[all.length - 1]);
      if (next.every(Number.isFinite)) all.push(next);
      else one.failed = true;
    }
    const last = Math.min(steps, all.length - 1), every = Math.ceil((last + 1) / TRAIL), states = [];
    for (let n = 0; n <= last; n++) if (n % every === 0 || n === last) states.push({ n, y: all[n] });
    return { name, made, all, last, states };
  }

  // states on the true orbit: each a single map away from the start, or in a tide from the one before
  function orbit(alpha, k, y, end) {
    const period = Top.nutationPeriod(alpha, y), unit = Top.scaleOfTime(alpha, y);
    const fine = Math.min(0.08 * unit, Number.isFinite(period) ? period / 60 : Infinity);
    const n = Math.min(Math.max(Math.ceil(end / fine), 2), ORBIT);
    const span = Math.min(end, n * fine);
    return span > 0 ? Top.iterate(Top.stepper(k ? "truth" : "backlund", alpha, y, span / n, k).step, y, n) : [y, y];
  }

  // the true states at some of the steps, the last among them: each in one jump from the start, or in a tide by Taylor series;
  // and at the last the attitude of the body
  function truths(alpha, k, y, h, steps) {
    const every = Math.ceil(steps / COMPARED) || 1, found = [], followed = k ? run("truth", alpha, k, [...y, 1, 0, 0, 0], h, steps).all : [];
    for (let n = steps; n > 0; n -= every) found.unshift({ n, y: k ? followed[n].slice(0, 6) : Top.exactStep(alpha, y, n * h).step(y) });
    return { exact: found, attitude: k ? followed[steps].slice(6) : Top.attitude(alpha, y, steps * h) };
  }

  const distance = (a, b) => Math.hypot(a[3] - b[3], a[4] - b[4], a[5] - b[5]) / Math.hypot(b[3], b[4], b[5]);

  // ---------------------------------------------------------------- drawing

  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const dark = matchMedia("(prefers-color-scheme: dark)");

  // colours of the figures are made for white paper: on black they are mixed with white
  function visible(colour) {
    if (!dark.matches) return colour;
    const parts = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16));
    return `rgb(${parts.map((c) => Math.round(0.55 * c + 0.45 * 255)).join(" ")})`;
  }

  function draw() {
    const { alpha, y } = own(), h = stepOf(alpha, y), wrong = unfit({ alpha, y }, h), k = wrong ? 0 : tide({ alpha, y });
    const followed = k ? Math.floor(REACH * Top.scaleOfTime(alpha, y) / h) : STEPS, steps = Math.min(number("steps"), followed);
    section.classList.toggle("unfit", wrong !== "");
    if (wrong) {
      told.textContent = wrong;
      return;
    }
    dress(k);
    const runs = chosen(k).map((name) => run(name, alpha, k, y, h, steps));
    const { exact, attitude } = truths(alpha, k, y, h, steps);
    section.runs = runs; // what a test, or a curious reader, may look at
    const period = Top.nutationPeriod(alpha, y), end = steps * h;
    const share = Number.isFinite(period) ? `, ${(h / period).toPrecision(2)} nutation periods` : "";
    section.querySelector('[for="live-h"] output').textContent = `${h.toPrecision(3)}${share}`;
    const least = steps < number("steps") ? ": so far the truth in a tide is followed" : "";
    section.querySelector('[for="live-steps"] output').textContent = `${steps} (t = ${Number(end.toPrecision(3))})${least}`;
    const strength = k ? Picture.show(10 ** number("eps")) : "0";
    section.querySelector('[for="live-eps"] output').textContent = strength;
    $("eps").setAttribute("aria-valuetext", k ? `ε = ${strength}` : "no tide");
    $("h").setAttribute("aria-valuetext", `h = ${h.toPrecision(3)}${share}`);
    $("steps").setAttribute("aria-valuetext", `${steps} steps, t = ${Number(end.toPrecision(3))}`);
    tell(runs, exact, alpha, k, y, h, steps);
    const colours = { grid: css("--line"), line: css("--soft"), ink: css("--ink"), paper: css("--paper") };
    const axis = (state) => state.slice(3);
    Picture.sphere(globe, {
      eye, colours, radius: Math.hypot(...axis(y)), curve: orbit(alpha, k, y, end).map(axis),
      truth: axis(steps ? exact[exact.length - 1].y : y), body: attitude && { attitude, axis: axis(y) },
      runs: runs.map(({ name, all, last, states }) => ({ colour: visible(about(name).color), marks: states.map((s) => axis(s.y)), tip: axis(all[last]) })),
    });
    const lines = (error) => runs.filter(({ name }) => name !== "free").map(({ name, all, last }) => ({
      name: about(name).label, colour: visible(about(name).color),
      points: exact.filter(({ n }) => n <= last).map(({ n, y: there }) => ({ t: n * h, error: error(all[n], there) })),
    }));
    Picture.chart(errors, { title: errors.dataset.title, end: end || h, lines: lines(distance), colours });
    energy.hidden = k === 0;
    const start = Top.invariants(alpha, y, k)[0], size = sizes(y)[0];
    const off = (state) => Math.abs(Top.invariants(alpha, state, k)[0] - start) / size;
    if (k) Picture.chart(energy, { title: energy.dataset.title, end: end || h, lines: lines(off), colours });
    section.dataset.ready = "yes";
  }

  // of H, J3, C1 and C2
  function sizes(y) {
    const J = Math.hypot(...y.slice(0, 3)), x = Math.hypot(...y.slice(3));
    return [0.5 * J * J + Math.abs(number("alpha")) * x, J || 1, x * x, x * J || 1];
  }

  function tell(runs, exact, alpha, k, y, h, steps) {
    const start = Top.invariants(alpha, y, k), scale = sizes(y), there = steps ? exact[exact.length - 1].y : y;
    const said = [];
    numbers.replaceChildren(...runs.map(({ name, all, last }) => {
      const { label, color } = about(name), now = Top.invariants(alpha, all[last], k);
      const failed = last < steps ? `failed at step ${last + 1}` : "", off = failed || (name === "free" ? "–" : Picture.show(distance(all[last], there)));
      const lost = k ? `, its energy by ${Picture.show(Math.abs(now[0] - start[0]) / scale[0])}` : "";
      if (name !== "free") said.push(`${label}: ${off}${lost}`);
      const cells = [label, off, ...now.map((v, i) => (k && i === 1 ? "–" : Picture.show(Math.abs(v - start[i]) / scale[i])))];
      const row = document.createElement("tr");
      row.append(...cells.map((text, i) => Object.assign(document.createElement(i ? "td" : "th"), { textContent: text, className: i ? "n" : "" })));
      row.firstChild.scope = "row";
      row.firstChild.style.borderLeft = `5px solid ${visible(color)}`;
      return row;
    }));
    if (!Number.isFinite(Top.nutationPeriod(alpha, y))) said.push("On a separatrix round-off grows exponentially, of the truth, too.");
    told.replaceChildren(...(said.length ? ["The axis is off by", ...said] : runs.length ? [] : ["Choose a method."]).map((text) => Object.assign(document.createElement("span"), { textContent: text })));
    const { lambda, turns } = Top.exactStep(alpha, y, h), shown = (c) => String(Number(c.toPrecision(6))).replace("-", "−");
    note.textContent = k ? `Tide: V = k x₁²/2 with k = ${Picture.show(k)}. There is no exact step; J3 is not conserved. The truth is a Taylor series.` : `Exact step: λ(h) = ${shown(lambda[0])} + ${shown(lambda[1])} i${turns ? `, after ${turns} whole nutation${turns > 1 ? "s" : ""} as turns about the vertical` : ""}.`;
  }

  // ---------------------------------------------------------------- events

  let waiting = false;
  function redraw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  }

  function stop() {
    clearInterval(timer);
    timer = 0;
    $("play").textContent = "Play";
    told.setAttribute("aria-live", "polite");
  }

  function play() {
    if (timer) { stop(); return; }
    $("play").textContent = "Stop";
    told.setAttribute("aria-live", "off"); // nobody wants to hear every step
    const slider = $("steps"), calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (number("steps") >= Number(slider.max)) slider.value = 0;
    timer = setInterval(() => {
      slider.value = number("steps") + Math.max(1, Math.round(Number(slider.max) / 200));
      if (number("steps") >= Number(slider.max)) stop();
      redraw();
    }, (calm ? 1000 : 80) / number("speed"));
  }

  function reach(most) {
    $("steps").max = Math.min(most, STEPS);
    $("more").textContent = `Allow ${Math.min(4 * $("steps").max, STEPS)} steps`;
    $("more").disabled = Number($("steps").max) >= STEPS;
  }

  function preset(which) {
    const [name, re, im, steps] = { 1: ["figure1", 0, 0.02, 1000], 2: ["figure2", 500, 5000, 4000] }[which];
    stop();
    $("top").value = name;
    set(LIVE.tops.find((t) => t.name === name));
    $("re").value = re;
    $("im").value = im;
    $("eps").value = NO_TIDE;
    for (const box of boxes()) box.checked = box.value === "free";
    reach(steps);
    $("steps").value = steps;
    redraw();
  }

  // about a fifth of a turn for a hundred pixels; up and down stops short of the poles
  function turn(right, up) {
    eye.around -= 0.012 * right;
    eye.up = Math.min(Math.max(eye.up + 0.012 * up, -1.5), 1.5);
    redraw();
  }
  function grow(ratio) {
    eye.size = Math.min(Math.max(eye.size * ratio, 0.4), 8);
    redraw();
  }
  const KEYS = {
    ArrowLeft: () => turn(-12, 0), ArrowRight: () => turn(12, 0), ArrowUp: () => turn(0, -12), ArrowDown: () => turn(0, 12),
    "+": () => grow(1.25), "=": () => grow(1.25), "-": () => grow(0.8), 0: () => { Object.assign(eye, EYE); redraw(); },
  };
  globe.addEventListener("keydown", (event) => {
    if (!(event.key in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    KEYS[event.key]();
  });
  fingers(globe, { drag: turn, pinch: grow });

  for (const kind of ["input", "change"]) {
    section.addEventListener(kind, (event) => {
      if (event.target.name === "top") set(LIVE.tops.find((t) => t.name === event.target.value));
      redraw();
    });
  }
  section.addEventListener("click", (event) => {
    if (event.target.name === "play") play();
    if (event.target.name === "preset") preset(event.target.value);
    if (event.target.name === "more") reach(4 * Number($("steps").max));
  });

  // ---------------------------------------------------------------- start

  $("top").append(...LIVE.tops.map((t) => new Option(t.label, t.name, false, t.name === "generic")));
  function dress(k) {
    for (const box of boxes()) {
      const { label, color } = about(taken(box.value, k) ?? box.value);
      box.disabled = !taken(box.value, k);
      box.nextSibling.data = ` ${label}`;
      box.parentNode.style.setProperty("--colour", visible(color));
    }
  }
  section.querySelector(".methods").append(...LIVE.methods.filter((m) => m.offered).map((m) => {
    const box = Object.assign(document.createElement("input"), { type: "checkbox", name: "method", value: m.name, checked: ["backlund", "implicit_midpoint", "strang"].includes(m.name) });
    const label = document.createElement("label");
    label.append(box, ` ${m.label}`);
    return label;
  }));
  set(LIVE.tops.find((t) => t.name === "generic"));
  reach(100);
  dark.addEventListener("change", redraw);
  new ResizeObserver(redraw).observe(globe);
})();
