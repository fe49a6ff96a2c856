// The pictures of the live top: the axis on its sphere, by Plotly; errors against time, on a canvas.

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
  const GRID = [...PARALLELS, ...MERIDIANS].flatMap((line) => [...line, null]); // null: the pen is lifted

  // Plotly only draws: fingers, mouse and keys are the page's, for the page is to scroll under a finger
  const BARE = { displayModeBar: false, responsive: true };
  const AXIS = { visible: false, range: [-1.05, 1.05], autorange: false };

  function camera({ around, up }) {
    const [ca, sa, cu, su] = [Math.cos(around), Math.sin(around), Math.cos(up), Math.sin(up)];
    return { eye: { x: 1.7 * ca * cu, y: 1.7 * sa * cu, z: 1.7 * su }, projection: { type: "orthographic" } };
  }

  // `curve`: the true orbit; `truth`: where it ends; a run has marks and a tip. Lengths are in units of the radius.
  function sphere(place, { eye, radius, curve, truth, runs, colours }) {
    const columns = (points, unit) => Object.fromEntries(["x", "y", "z"].map((c, i) => [c, points.map((p) => p && p[i] / unit)]));
    const trace = (mode, points, more, unit = radius) => ({ type: "scatter3d", mode, ...columns(points, unit), hoverinfo: "skip", ...more });
    const traces = [
      trace("lines", GRID, { line: { color: colours.grid, width: 1.5 } }, 1),
      trace("lines", curve, { line: { color: colours.line, width: 2 } }),
      ...runs.flatMap(({ marks, tip, colour }) => [
        trace("markers", marks, { marker: { color: colour, size: marks.length > 500 ? 2 : 4.5, line: { width: 0 } } }),
        trace("lines+markers", [[0, 0, 0], tip], { line: { color: colour, width: 5 }, marker: { color: colour, size: [0.1, 9], line: { width: 0 } } }),
      ]),
      trace("markers", [truth], { marker: { symbol: "circle-open", color: colours.ink, size: 15, line: { color: colours.ink, width: 3 } } }),
    ];
    const [x, y, z] = Array(3).fill(1.95 * eye.size);
    const scene = { xaxis: AXIS, yaxis: AXIS, zaxis: AXIS, aspectmode: "manual", aspectratio: { x, y, z }, camera: camera(eye), dragmode: false, hovermode: false };
    return Plotly.react(place, traces, { showlegend: false, margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", scene }, BARE);
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
      pen.fillText(name, right - 15, free);
    }
  }

  return { sphere, chart, power };
})();
