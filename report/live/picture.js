// The pictures of the live top, on two canvases: the axis on its sphere, and errors against time.

const Picture = (() => {
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

  // Seen from far away, from the direction (around, up): a point to [right, up, towards the eye]
  function seenFrom({ around, up }) {
    const [ca, sa, cu, su] = [Math.cos(around), Math.sin(around), Math.cos(up), Math.sin(up)];
    return ([x, y, z]) => {
      const out = ca * x + sa * y;
      return [ca * y - sa * x, cu * z - su * out, su * z + cu * out];
    };
  }

  // What is behind the sphere is faint. `curve`: the true orbit; `truth`: where it ends; a run has marks and a tip.
  function sphere(canvas, { eye, radius, curve, truth, runs, colours }) {
    const { pen, width, height } = blank(canvas);
    const unit = (0.47 * Math.min(width, height) * eye.size) / radius, look = seenFrom(eye);
    const place = (p) => { const [a, b, depth] = look(p); return [width / 2 + unit * a, height / 2 - unit * b, depth]; };
    const grid = GRID.map((line) => line.map((p) => place(p.map((c) => radius * c))));
    const orbit = curve.map(place), placed = runs.map((run) => ({ ...run, marks: run.marks.map(place), tip: place(run.tip) }));

    function stroke(line, front) { // the part of a line on one side
      for (let i = 1; i < line.length; i++) {
        if (line[i][2] >= 0 !== front) continue;
        if (i === 1 || line[i - 1][2] >= 0 !== front) pen.moveTo(line[i - 1][0], line[i - 1][1]);
        pen.lineTo(line[i][0], line[i][1]);
      }
    }
    function side(front) {
      pen.globalAlpha = front ? 1 : 0.35;
      pen.lineWidth = 1;
      pen.strokeStyle = colours.grid;
      pen.beginPath();
      for (const line of grid) stroke(line, front);
      pen.stroke();
      pen.lineWidth = 1.6;
      pen.strokeStyle = colours.line;
      pen.beginPath();
      stroke(orbit, front);
      pen.stroke();
      for (const { marks, colour } of placed) {
        const size = marks.length > 500 ? 2 : 6;
        pen.fillStyle = colour;
        pen.beginPath();
        for (const [x, y, depth] of marks) {
          if (depth >= 0 !== front) continue;
          if (size < 3) pen.rect(x - 1, y - 1, size, size);
          else { pen.moveTo(x + size / 2, y); pen.arc(x, y, size / 2, 0, 2 * Math.PI); }
        }
        pen.fill();
      }
      pen.globalAlpha = 1;
    }
    side(false);
    side(true);
    pen.lineCap = "round";
    for (const { tip: [x, y], colour } of placed) {
      pen.strokeStyle = pen.fillStyle = colour;
      pen.lineWidth = 3.5;
      pen.beginPath();
      pen.moveTo(width / 2, height / 2);
      pen.lineTo(x, y);
      pen.stroke();
      pen.beginPath();
      pen.arc(x, y, 6, 0, 2 * Math.PI);
      pen.fill();
    }
    const [x, y] = place(truth);
    pen.strokeStyle = colours.ink;
    pen.lineWidth = 2.5;
    pen.beginPath();
    pen.arc(x, y, 11, 0, 2 * Math.PI);
    pen.stroke();
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
