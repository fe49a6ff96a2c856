// The controls and the picture of the live top. The state of the section is in its controls; `draw` reads them all.

(() => {
  const section = document.getElementById("live");
  if (!section) return;
  const $ = (name) => section.querySelector(`[name="${name}"]`);
  const picture = section.querySelector(".sphere"), errors = section.querySelector(".errors");
  const numbers = section.querySelector(".numbers tbody"), told = section.querySelector(".told");
  const STATE = ["J1", "J2", "J3", "x1", "x2", "x3"];
  const ORBIT = 3000; // points of the true orbit, at most
  const TRAIL = 4000; // marks of a method, at most
  let Plotly = null, timer = 0;

  // ---------------------------------------------------------------- reading the controls

  const number = (name) => Number($(name).value);
  const own = () => ({ alpha: number("alpha"), y: STATE.map(number) });
  const chosen = () => [...section.querySelectorAll('[name="method"]:checked')].map((box) => box.value);
  const about = (name) => LIVE.methods.find((m) => m.name === name);
  const stepOf = (alpha, y) => 10 ** number("h") * Top.scaleOfTime(alpha, y); // the slider is log10 of h in the top's units

  function set(top) {
    section.querySelector(".note").textContent = top.note;
    $("alpha").value = top.alpha;
    STATE.forEach((name, i) => { $(name).value = top.y[i]; });
  }

  // ---------------------------------------------------------------- computing

  function run(name, alpha, y, h, steps) {
    const made = name === "free" ? Top.freeStep(alpha, y, [number("re"), number("im")]) : Top.stepper(name, alpha, y, h);
    const every = Math.ceil((steps + 1) / TRAIL), states = [];
    let s = y;
    for (let n = 0; n <= steps && s.every(Number.isFinite); n++) {
      if (n % every === 0 || n === steps) states.push({ n, y: s });
      s = made.step(s);
    }
    return { name, made, states };
  }

  // states on the true orbit: each a single map away from the start
  function orbit(alpha, y, end) {
    const period = Top.nutationPeriod(alpha, y), unit = Top.scaleOfTime(alpha, y);
    const fine = Math.min(0.08 * unit, Number.isFinite(period) ? period / 60 : Infinity);
    const n = Math.min(Math.max(Math.ceil(Math.abs(end) / fine), 2), ORBIT);
    const span = Math.sign(end) * Math.min(Math.abs(end), n * fine);
    return Top.iterate(Top.exactStep(alpha, y, span / n).step, y, n);
  }

  const distance = (a, b) => Math.hypot(a[3] - b[3], a[4] - b[4], a[5] - b[5]) / Math.hypot(b[3], b[4], b[5]);

  // how far a method is from where it should be, at up to forty of its steps
  function strayed({ name, states }, alpha, y, h) {
    if (name === "free") return [];
    const every = Math.ceil(states.length / 40);
    const some = states.filter((s, i) => s.n > 0 && (i % every === 0 || i === states.length - 1));
    return some.map((s) => ({ t: s.n * h, error: distance(s.y, Top.exactStep(alpha, y, s.n * h).step(y)) }));
  }

  // ---------------------------------------------------------------- drawing

  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const column = (states, i) => states.map((s) => s[i]);

  function sphere(r) {
    const x = [], y = [], z = [];
    const push = (a, b, c) => { x.push(a); y.push(b); z.push(c); };
    for (let k = -2; k <= 2; k++) {
      const b = (k * Math.PI) / 6;
      for (let i = 0; i <= 60; i++) push(r * Math.cos(b) * Math.cos((i * Math.PI) / 30), r * Math.cos(b) * Math.sin((i * Math.PI) / 30), r * Math.sin(b));
      push(null, null, null);
    }
    for (let k = 0; k < 6; k++) {
      const a = (k * Math.PI) / 6;
      for (let i = 0; i <= 60; i++) push(r * Math.cos(a) * Math.cos((i * Math.PI) / 30), r * Math.sin(a) * Math.cos((i * Math.PI) / 30), r * Math.sin((i * Math.PI) / 30));
      push(null, null, null);
    }
    return { type: "scatter3d", mode: "lines", x, y, z, line: { color: css("--line"), width: 1 }, hoverinfo: "skip", showlegend: false };
  }

  function trace(states, more) {
    return { type: "scatter3d", x: column(states, 3), y: column(states, 4), z: column(states, 5), hoverinfo: "name", ...more };
  }

  function draw() {
    const { alpha, y } = own(), steps = Math.round(number("steps"));
    if (![alpha, ...y].every(Number.isFinite) || !y.slice(3).some((c) => c !== 0)) {
      told.textContent = "Give six finite numbers, and an axis x that is not zero.";
      return;
    }
    const h = stepOf(alpha, y), runs = chosen().map((name) => run(name, alpha, y, h, steps));
    section.runs = runs; // what a test, or a curious reader, may look at
    const period = Top.nutationPeriod(alpha, y), radius = Math.hypot(...y.slice(3));
    section.querySelector('[for="live-h"] output').textContent =
      `${h.toPrecision(3)}${Number.isFinite(period) ? `, ${(h / period).toPrecision(2)} nutation periods` : ""}`;
    section.querySelector('[for="live-steps"] output').textContent = `${steps} (t = ${(steps * h).toPrecision(3)})`;
    tell(runs, alpha, y, h);
    if (!Plotly) return;
    const traces = [sphere(radius), trace(orbit(alpha, y, steps * h), { mode: "lines", name: "true orbit", line: { color: css("--soft"), width: 2 } })];
    const lines = [];
    for (const r of runs) {
      const { label, color } = about(r.name), states = r.states.map((s) => s.y), last = states.slice(-1);
      traces.push(trace(states, { mode: "markers", name: label, legendgroup: r.name, marker: { size: states.length > 500 ? 1.6 : 3, color } }));
      traces.push(trace([[0, 0, 0, 0, 0, 0], ...last], { mode: "lines+markers", name: label, legendgroup: r.name, showlegend: false, line: { color, width: 4 }, marker: { color, size: [0, 7] } }));
      const found = strayed(r, alpha, y, h);
      lines.push({ type: "scatter", mode: "lines+markers", name: label, x: found.map((e) => e.t), y: found.map((e) => Math.max(e.error, 1e-17)), line: { color }, marker: { color, size: 4 } });
    }
    const common = { paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: css("--ink"), size: 12 }, uirevision: "keep" };
    const axis = { showgrid: false, zeroline: false, showbackground: false, showticklabels: false, title: { text: "" }, showspikes: false, range: [-1.05 * radius, 1.05 * radius] };
    const options = { displaylogo: false, responsive: true };
    Plotly.react(picture, traces, {
      ...common, margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: true, legend: { orientation: "h", y: 0, yanchor: "top" },
      scene: { xaxis: axis, yaxis: axis, zaxis: { ...axis, title: { text: "" } }, aspectmode: "cube", camera: { eye: { x: 1.15, y: 1.15, z: 0.75 } } },
    }, options);
    const grid = { gridcolor: css("--line"), linecolor: css("--soft"), zeroline: false };
    Plotly.react(errors, lines, {
      ...common, margin: { l: 60, r: 10, t: 10, b: 45 }, showlegend: false,
      xaxis: { ...grid, title: { text: "time" } },
      yaxis: { ...grid, type: "log", exponentformat: "power", dtick: 3, title: { text: "distance of the axis from the truth" } },
    }, options);
  }

  function tell(runs, alpha, y, h) {
    const start = Top.invariants(alpha, y), J = Math.hypot(...y.slice(0, 3)), x = Math.hypot(...y.slice(3));
    const sizes = [0.5 * J * J + Math.abs(alpha) * x, J || 1, x * x, x * J || 1];
    const show = (v) => (Number.isFinite(v) ? (v === 0 ? "0" : v.toExponential(1)) : "–");
    numbers.replaceChildren(...runs.map((r) => {
      const last = r.states[r.states.length - 1], now = Top.invariants(alpha, last.y);
      const complete = last.n === Math.round(number("steps"));
      const error = r.name === "free" ? NaN : distance(last.y, Top.exactStep(alpha, y, last.n * h).step(y));
      const cells = [about(r.name).label, complete ? show(error) : `failed at step ${last.n}`, ...now.map((v, i) => show(Math.abs(v - start[i]) / sizes[i]))];
      const row = document.createElement("tr");
      row.append(...cells.map((text, i) => Object.assign(document.createElement("td"), { textContent: text, className: i ? "n" : "" })));
      row.firstChild.style.borderLeft = `4px solid ${about(r.name).color}`;
      return row;
    }));
    const { lambda, turns } = Top.exactStep(alpha, y, h);
    const shown = (c) => Number(c.toPrecision(6));
    told.textContent = `Exact step: λ(h) = ${shown(lambda[0])} + ${shown(lambda[1])} i${turns ? `, after ${turns} whole nutation${Math.abs(turns) > 1 ? "s" : ""} as turns about the vertical` : ""}.`;
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
  }

  function play() {
    if (timer) { stop(); return; }
    $("play").textContent = "Stop";
    const slider = $("steps");
    if (number("steps") >= Number(slider.max)) slider.value = 0;
    timer = setInterval(() => {
      slider.value = number("steps") + Math.max(1, Math.round(Number(slider.max) / 400));
      if (number("steps") >= Number(slider.max)) stop();
      redraw();
    }, 50);
  }

  function preset(which) {
    const [name, re, im, steps] = { 1: ["figure1", 0, 0.02, 1000], 2: ["figure2", 500, 5000, 4000] }[which];
    $("top").value = name;
    set(LIVE.tops.find((t) => t.name === name));
    $("re").value = re;
    $("im").value = im;
    for (const box of section.querySelectorAll('[name="method"]')) box.checked = box.value === "free";
    $("steps").max = steps;
    $("steps").value = steps;
    redraw();
  }

  section.addEventListener("input", (event) => {
    if (event.target.name === "top") {
      set(LIVE.tops.find((t) => t.name === event.target.value));
    }
    redraw();
  });
  section.addEventListener("click", (event) => {
    if (event.target.name === "play") play();
    if (event.target.name === "preset") preset(event.target.value);
    if (event.target.name === "more") { $("steps").max = 4 * Number($("steps").max); redraw(); }
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

  // ---------------------------------------------------------------- start

  $("top").append(...LIVE.tops.map((t) => new Option(t.label, t.name, false, t.name === "generic")));
  section.querySelector(".methods").append(...LIVE.methods.map((m) => {
    const box = Object.assign(document.createElement("input"), { type: "checkbox", name: "method", value: m.name, checked: ["backlund", "implicit_midpoint"].includes(m.name) });
    const label = document.createElement("label");
    label.append(box, ` ${m.label}`);
    label.style.setProperty("--colour", m.color);
    return label;
  }));
  set(LIVE.tops.find((t) => t.name === "generic"));
  draw();

  // Plotly is five megabytes of code: run it when the section is about to be seen
  new IntersectionObserver(async (entries, observer) => {
    if (!entries.some((e) => e.isIntersecting)) return;
    observer.disconnect();
    const source = document.getElementById("plotly");
    if (!source || !source.textContent.trim()) {
      picture.textContent = "Plotly was not installed where this page was made: no picture, but the numbers are right.";
      return;
    }
    const code = document.createElement("script");
    try {
      code.textContent = await unpack("plotly");
    } catch (error) {
      picture.textContent = `This browser cannot unpack Plotly (${error.message}): no picture, but the numbers are right.`;
      return;
    }
    document.body.append(code);
    Plotly = window.Plotly;
    section.dataset.ready = "yes";
    draw();
  }, { rootMargin: "400px" }).observe(section);
})();
