// The pictures of the live top: the axis on its sphere, and errors against time. Each on a canvas.

const Picture = (() => {
  const RING = Array.from({ length: 61 }, (_, i) => [Math.cos((i * Math.PI) / 30), Math.sin((i * Math.PI) / 30)]);
  const PARALLELS = [-2, -1, 0, 1, 2].map((k) => {
    const [c, s] = [Math.cos((k * Math.PI) / 6), Math.sin((k * Math.PI) / 6)];
    return RING.map(([a, b]) => [c * a, c * b, s]);
  });
  const MERIDIANS = [0, 1, 2, 3, 4, 5].map((k) => {
    const [c, s] = [Math.cos((k * Math.PI) / 6), Math.sin((k * Math.PI) / 6)];
    return RING.map(([a, b]) => [c * a, s * a, b]);
  });
  const GRID = [...PARALLELS, ...MERIDIANS];

  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((c) => c / Math.hypot(...a));

  // Points of the body, a disc half-way up its axis: its rim from one angle to another. It begins with the axis `axis`
  function rim({ attitude: [s, ...v], axis }, from, to) {
    const up = unit(axis), e = unit(cross(up, Math.abs(up[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0])), f = cross(up, e);
    const turned = (p) => { const u = cross(v, p), w = cross(v, u); return p.map((c, i) => c + 2 * (s * u[i] + w[i])); };
    const at = (angle) => up.map((c, i) => 0.5 * c + 0.36 * (Math.cos(angle) * e[i] + Math.sin(angle) * f[i]));
    const count = Math.ceil((to - from) / 0.15);
    return { rim: Array.from({ length: count + 1 }, (_, i) => turned(at(from + ((to - from) * i) / count))), hub: turned(up.map((c) => 0.5 * c)) };
  }

  // The sphere seen from `eye`, from afar. `curve`: the true orbit; `truth`: where it ends; `body`: its attitude there, and the
  // axis it began with, or null; a run has marks and a tip.
  // Lengths are in units of the radius. What is behind the sphere is pale.
  function sphere(canvas, { eye: { around, up, size }, radius, curve, truth, body, runs, colours }) {
    const { pen, width, height } = blank(canvas);
    const [ca, sa, cu, su] = [Math.cos(around), Math.sin(around), Math.cos(up), Math.sin(up)];
    const scale = 0.44 * size * Math.min(width, height);
    const seen = ([x, y, z], unit = radius) => ({
      across: width / 2 + (scale * (ca * y - sa * x)) / unit,
      down: height / 2 - (scale * (cu * z - su * (ca * x + sa * y))) / unit,
      near: (cu * (ca * x + sa * y) + su * z) / unit,
    });
    pen.lineCap = pen.lineJoin = "round";
    const FAR = 0.3;

    // a path in pieces, so that each is pale or not
    function path(points, colour, thick, unit) {
      pen.strokeStyle = colour;
      pen.lineWidth = thick;
      for (const behind of [true, false]) {
        pen.globalAlpha = behind ? FAR : 1;
        pen.beginPath();
        points.map((p) => seen(p, unit)).forEach((p, i, all) => {
          const q = all[i - 1];
          if (!q || p.near + q.near < 0 !== behind) return;
          pen.moveTo(q.across, q.down);
          pen.lineTo(p.across, p.down);
        });
        pen.stroke();
      }
      pen.globalAlpha = 1;
    }
    function dot(p, colour, thick) {
      const { across, down, near } = seen(p);
      pen.globalAlpha = near < 0 ? FAR : 1;
      pen.fillStyle = colour;
      pen.beginPath();
      pen.arc(across, down, thick, 0, 2 * Math.PI);
      pen.fill();
      pen.globalAlpha = 1;
    }

    for (const line of GRID) path(line, colours.grid, 1, 1);
    path(curve, colours.line, 1.5);
    if (body) {
      const fill = ({ rim, hub }, opacity) => {
        pen.globalAlpha = opacity;
        pen.fillStyle = colours.ink;
        pen.beginPath();
        for (const { across, down } of [hub, ...rim, hub].map((p) => seen(p, 1))) pen.lineTo(across, down);
        pen.fill();
        pen.globalAlpha = 1;
      };
      fill(rim(body, 0, 2 * Math.PI), 0.16);
      fill(rim(body, 0, Math.PI / 3), 0.55);
      path(rim(body, 0, 2 * Math.PI).rim, colours.ink, 1.2, 1);
    }
    for (const { marks, colour } of runs) for (const p of marks) dot(p, colour, marks.length > 500 ? 1.2 : 2.6);
    for (const { tip, colour } of runs) {
      const from = seen([0, 0, 0]), to = seen(tip);
      pen.globalAlpha = to.near < 0 ? 2 * FAR : 1;
      pen.strokeStyle = colour;
      pen.lineWidth = 3.5;
      pen.beginPath();
      pen.moveTo(from.across, from.down);
      pen.lineTo(to.across, to.down);
      pen.stroke();
      pen.globalAlpha = 1;
      dot(tip, colour, 5.5);
    }
    const there = seen(truth);
    pen.globalAlpha = there.near < 0 ? 2 * FAR : 1;
    pen.strokeStyle = colours.ink;
    pen.lineWidth = 2.5;
    pen.beginPath();
    pen.arc(there.across, there.down, 9, 0, 2 * Math.PI);
    pen.stroke();
  }

  // T-handles, each at the end of the trail of its states: the path of the tip of its stem, then the handle. Seen from the side
  // and a little from above; `line` is the colour of the vertical.
  function handles(canvas, bodies, line) {
    const { pen, width, height } = blank(canvas), scale = 0.4 * Math.min(width, height), [c, s] = [Math.cos(0.3), Math.sin(0.3)];
    const seen = ([x, y, z]) => [width / 2 + scale * (0.8 * y - 0.6 * x), height / 2 - scale * (c * z - s * (0.8 * x + 0.6 * y))];
    const stroke = (points, colour, thick, opacity = 1) => {
      Object.assign(pen, { strokeStyle: colour, lineWidth: thick, globalAlpha: opacity, lineCap: "round", lineJoin: "round" });
      pen.beginPath();
      for (const p of points) pen.lineTo(...seen(p));
      pen.stroke();
      pen.globalAlpha = 1;
    };
    stroke([[0, 0, -1.1], [0, 0, 1.1]], line, 1);
    for (const { colour, trail } of bodies) {
      stroke(trail.map((state) => Tumble.inSpace(state.slice(3), [0, 0.9, 0])), colour, 1.2, 0.5);
      const at = (p) => Tumble.inSpace(trail[trail.length - 1].slice(3), p);
      stroke([at([-0.6, 0, 0]), at([0.6, 0, 0])], colour, 9, 0.85);
      stroke([at([0, 0, 0]), at([0, 0.9, 0])], colour, 6, 0.85);
    }
  }

  // An empty canvas as fine as the screen; lengths are those of the page
  function blank(canvas) {
    const width = canvas.clientWidth, height = canvas.clientHeight, fine = devicePixelRatio || 1;
    canvas.width = Math.round(fine * width);
    canvas.height = Math.round(fine * height);
    const pen = canvas.getContext("2d");
    pen.scale(fine, fine);
    pen.font = `12px ${getComputedStyle(canvas).fontFamily}`;
    return { pen, width, height };
  }

  const power = (k) => `10${String(k).replace(/./g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)])}`;

  // a number of at least 0 to two digits
  function show(v) {
    if (!Number.isFinite(v)) return "–";
    if (v === 0 || (v >= 1e-3 && v < 1e3)) return String(Number(v.toPrecision(2)));
    const [digits, exponent] = v.toExponential(1).split("e");
    return `${digits}×${power(Number(exponent))}`;
  }

  // 1, 2 or 5 times a power of ten, so that at most `most` of them cover `span`
  function tick(span, most) {
    const rough = 10 ** Math.floor(Math.log10(span / most));
    return [1, 2, 5, 10].map((k) => k * rough).find((step) => span / step <= most);
  }

  // Errors on a logarithmic scale against time from 0 to `end`; each line is named where it ends.
  function chart(canvas, { title, end, lines, colours }) {
    const { pen, width, height } = blank(canvas), [LEAST, MOST] = [-17, 2];
    const [left, right, top, bottom] = [46, width - 12, 34, height - 38];
    const across = (t) => left + ((right - left) * t) / end;
    const down = (e) => bottom - ((bottom - top) * (Math.min(Math.max(Math.log10(e), LEAST), MOST) - LEAST)) / (MOST - LEAST);
    pen.fillStyle = colours.ink;
    pen.fillText(title, 12, 18);
    pen.strokeStyle = colours.grid;
    pen.fillStyle = colours.line;
    pen.beginPath();
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (let k = -15; k <= 0; k += 3) {
      const y = Math.round(down(10 ** k)) + 0.5;
      pen.moveTo(left, y);
      pen.lineTo(right, y);
      pen.fillText(power(k), left - 7, y);
    }
    pen.textAlign = "center";
    pen.textBaseline = "top";
    const step = tick(end, (right - left) / 70);
    for (let k = 0; k * step <= end * (1 + 1e-9); k++) {
      const x = Math.round(across(k * step)) + 0.5;
      pen.moveTo(x, bottom);
      pen.lineTo(x, bottom + 4);
      pen.fillText(Number((k * step).toPrecision(3)), x, bottom + 7);
    }
    pen.stroke();
    pen.fillText("time", (left + right) / 2, height - 15);
    pen.textAlign = "right";
    pen.textBaseline = "alphabetic";
    const names = [];
    for (const { name, colour, points } of lines) {
      if (!points.length) continue;
      pen.strokeStyle = pen.fillStyle = colour;
      pen.lineWidth = 2;
      pen.beginPath();
      for (const { t, error } of points) pen.lineTo(across(t), down(error));
      pen.stroke();
      const last = points[points.length - 1];
      pen.beginPath();
      pen.arc(across(last.t), down(last.error), 3, 0, 2 * Math.PI);
      pen.fill();
      names.push({ name, colour, y: Math.min(...points.slice(-8).map((p) => down(p.error))) - 8 });
    }
    let free = bottom; // the foot of the name below
    for (const { name, colour, y } of names.sort((a, b) => b.y - a.y)) {
      free = Math.min(y, free - 15);
      pen.fillStyle = colour;
      pen.fillRect(right - 10, free - 8, 10, 8);
      pen.fillStyle = colours.ink; // coloured letters are hard to read
      pen.strokeStyle = colours.paper; // a rim, where a name lies on a line
      pen.lineWidth = 4;
      pen.strokeText(name, right - 15, free);
      pen.fillText(name, right - 15, free);
    }
  }

  return { sphere, chart, handles, show };
})();
