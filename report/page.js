"use strict";

// The question which method to take: a field for each of the first four columns of the table of answers.
{
  const form = document.querySelector("form.choose");
  if (form) {
    const FIELDS = 4, answer = document.querySelector(".answer");
    const LENGTH = "10⁴"; // of a run, at first
    const table = document.querySelector("#choose table"), heads = [...table.tHead.rows[0].cells].map((cell) => cell.textContent);
    const rows = [...table.tBodies[0].rows].map((row) => [...row.cells].map((cell) => cell.textContent));
    const fields = heads.slice(0, FIELDS).map((head) => {
      const label = document.createElement("label"), field = document.createElement("select");
      label.append(`${head[0].toUpperCase()}${head.slice(1)} `, field);
      form.append(label);
      return field;
    });
    const fits = (row, n) => fields.slice(0, n).every((field, i) => field.value === row[i]);
    // each field offers what is stored for those before it
    function offer() {
      fields.forEach((field, i) => {
        const before = field.value, texts = [...new Set(rows.filter((row) => fits(row, i)).map((row) => row[i]))];
        field.replaceChildren(...texts.map((text) => new Option(text, text, false, text === (before || LENGTH))));
      });
      const [method, code, settings, cost, next, figure] = rows.find((row) => fits(row, FIELDS)).slice(FIELDS);
      const [label, name, link] = ["b", "code", "a"].map((tag) => document.createElement(tag));
      label.textContent = method;
      name.textContent = code;
      answer.replaceChildren(label, " (", name, `) with ${settings}: ${cost}.${next ? ` ${next[0].toUpperCase()}${next.slice(1)}.` : ""} `);
      const drawn = document.getElementById(`figure-${figure}`);
      if (drawn) {
        link.href = `#figure-${figure}`;
        link.textContent = drawn.querySelector("figcaption b").textContent.replace(/\.$/, "");
        link.addEventListener("click", () => drawn.closest("details")?.setAttribute("open", ""));
        answer.append(link);
      }
    }
    form.addEventListener("change", offer);
    form.hidden = answer.hidden = false;
    offer();
  }
}

// A click on a column's head sorts its table, a second click the other way; missing values stay last.
document.addEventListener("click", (event) => {
  const head = event.target.closest("table.sortable thead th");
  if (!head) return;
  const body = head.closest("table").tBodies[0];
  const up = head.getAttribute("aria-sort") !== "ascending";
  for (const other of head.parentNode.children) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  const key = (row) => { const cell = row.cells[head.cellIndex]; return cell.dataset.v ?? cell.textContent; };
  const number = (text) => (text === "inf" ? Infinity : text === "-inf" ? -Infinity : Number(text));
  const compare = (a, b) => {
    if (a === "" || b === "") return a === b ? 0 : a === "" ? 1 : -1;
    const [x, y] = [number(a), number(b)];
    const order = Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b) : x < y ? -1 : x > y ? 1 : 0;
    return up ? order : -order;
  };
  const keyed = [...body.rows].map((row) => [key(row), row]);
  keyed.sort((a, b) => compare(a[0], b[0]));
  body.append(...keyed.map((pair) => pair[1]));
});

// On paper nothing can be unfolded: what is of moderate length is printed; what is longer, only if the reader has opened it.
const PRINTED = 20; // rows
addEventListener("beforeprint", () => {
  for (const folded of document.querySelectorAll("details:not([open])")) {
    const rows = folded.querySelector(":scope > .scroll table")?.tBodies[0].rows.length ?? 0;
    if (rows > PRINTED) continue;
    folded.open = true;
    folded.dataset.printed = "";
  }
});
addEventListener("afterprint", () => {
  for (const folded of document.querySelectorAll("details[data-printed]")) {
    folded.open = false;
    delete folded.dataset.printed;
  }
});

// The rows of each experiment are embedded as gzip in base64.
async function unpack(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

// On a phone the panels of a figure stand one below the other: another drawing, embedded as the rows are.
{
  const phone = matchMedia("(max-width: 40rem)");
  async function stack() {
    if (!phone.matches) return;
    for (const drawing of document.querySelectorAll("script.phone")) {
      const card = document.querySelector(`#figure-${CSS.escape(drawing.id.slice(6))} .wide-scroll`);
      const text = await unpack(drawing.id);
      drawing.remove();
      card.insertAdjacentHTML("beforeend", text);
      card.lastElementChild.classList.add("phone");
    }
  }
  phone.addEventListener("change", stack);
  stack();
}

// The rows of a figure, as a file.
document.addEventListener("click", async (event) => {
  const link = event.target.closest("a.rows");
  if (!link || link.protocol === "blob:") return;
  event.preventDefault();
  try {
    const text = await unpack(link.hash.slice(1));
    const file = document.createElement("a");
    file.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
    file.download = link.download;
    file.click();
    setTimeout(() => URL.revokeObjectURL(file.href), 10000);
  } catch (error) {
    link.replaceWith(`rows cannot be unpacked by this browser: ${error.message}`);
  }
});

// A field above every long table: shown are the rows that contain all of its words.
const FILTERED = 8; // rows from which on a table has the field
for (const table of document.querySelectorAll("table.sortable")) {
  const rows = [...table.tBodies[0].rows];
  if (rows.length < FILTERED) continue;
  const label = document.createElement("label"), field = document.createElement("input"), count = document.createElement("output");
  label.className = "filter";
  field.type = "search";
  field.placeholder = "words that a row must contain";
  label.append("Filter ", field, " ", count);
  const texts = rows.map((row) => [...row.cells].map((cell) => cell.textContent).join(" ").toLowerCase());
  field.addEventListener("input", () => {
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    rows.forEach((row, i) => {
      row.hidden = !words.every((word) => texts[i].includes(word));
      if (!row.hidden) shown++;
    });
    count.textContent = words.length ? `${shown} of ${rows.length} rows` : "";
  });
  table.parentNode.before(label);
}

// Dragging with the mouse or a finger, and two fingers moved apart: `drag(right, down)` in pixels, `pinch(ratio, x, y)`
// about the point between them.
function fingers(element, { drag, pinch }) {
  const held = new Map(); // pointers that are down, where they were
  element.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    held.set(event.pointerId, event);
    element.setPointerCapture(event.pointerId);
  });
  element.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const other = [...held.values()].find((finger) => finger.pointerId !== event.pointerId);
    const share = other ? 0.5 : 1; // of two fingers each moves the picture half as far
    drag(share * (event.clientX - before.clientX), share * (event.clientY - before.clientY));
    if (other) {
      const apart = (a) => Math.hypot(a.clientX - other.clientX, a.clientY - other.clientY) || 1;
      pinch(apart(event) / apart(before), (event.clientX + other.clientX) / 2, (event.clientY + other.clientY) / 2);
    }
    held.set(event.pointerId, event);
  });
  for (const name of ["pointerup", "pointercancel"]) element.addEventListener(name, (event) => held.delete(event.pointerId));
}

// A figure as large as one likes: wheel, + and −, two fingers; drag to move, Escape to close.
{
  const dialog = document.getElementById("zoom"), pane = dialog.querySelector(".pane");
  const part = (name) => dialog.querySelector(`[name="${name}"]`);
  const LEAST = 0.5, MOST = 12;
  const LEGIBLE = 1.15; // pixels a point, at least
  const tapped = matchMedia("(hover: none)");
  let picture = null, scale = 1, fit = 1;

  // to scale s, the point (x, y) of the window staying where it is
  function zoom(s, x, y) {
    const box = pane.getBoundingClientRect(), before = picture.getBoundingClientRect();
    x ??= box.x + box.width / 2;
    y ??= box.y + box.height / 2;
    const [u, v] = [(x - before.x) / before.width, (y - before.y) / before.height];
    scale = Math.min(Math.max(s, LEAST), MOST);
    picture.style.width = `${fit * scale}px`;
    const after = picture.getBoundingClientRect();
    pane.scrollBy(after.x + u * after.width - x, after.y + v * after.height - y);
    dialog.querySelector("output").textContent = `${Math.round(100 * scale)} %`;
  }

  function open(figure) {
    const source = figure.querySelector(".card svg"); // not that for a phone
    picture = source.cloneNode(true);
    for (const element of [picture, ...picture.querySelectorAll("[id]")]) element.removeAttribute("id"); // they are those of the original
    dialog.querySelector("b").textContent = figure.querySelector("figcaption b").textContent;
    pane.replaceChildren(picture);
    dialog.showModal();
    const [, , width, height] = source.getAttribute("viewBox").split(" ").map(Number);
    fit = Math.min(pane.clientWidth - 16, ((pane.clientHeight - 16) * width) / height);
    zoom(1);
    if (fit < LEGIBLE * width) zoom((LEGIBLE * width) / fit); // on a phone
    pane.focus();
  }

  for (const figure of document.querySelectorAll("figure")) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "enlarge";
    button.textContent = "Enlarge";
    button.setAttribute("aria-label", `Enlarge ${figure.querySelector("figcaption b").textContent}`);
    button.addEventListener("click", () => open(figure));
    figure.querySelector(".card").append(button);
    figure.querySelector(".wide-scroll").addEventListener("click", () => { if (tapped.matches) open(figure); });
  }
  part("in").addEventListener("click", () => zoom(1.5 * scale));
  part("out").addEventListener("click", () => zoom(scale / 1.5));
  part("close").addEventListener("click", () => dialog.close());
  dialog.addEventListener("close", () => pane.replaceChildren());
  dialog.addEventListener("keydown", (event) => {
    if (event.key === "+" || event.key === "=") zoom(1.5 * scale);
    if (event.key === "-") zoom(scale / 1.5);
    if (event.key === "0") zoom(1);
  });
  pane.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(scale * Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.002)), event.clientX, event.clientY);
  }, { passive: false });

  fingers(pane, { drag: (right, down) => pane.scrollBy(-right, -down), pinch: (ratio, x, y) => zoom(scale * ratio, x, y) });
}

// The name of a method in the list opens a panel: what the row says, how its claims fare, and its curves among all others.
{
  const dialog = document.getElementById("method"), list = document.querySelector("#methods table");
  if (dialog && list) {
    const [choice, plots, facts, about] = ["select", ".plots", ".rules", ".about"].map((name) => dialog.querySelector(name));
    const heads = [...list.tHead.rows[0].cells].map((cell) => cell.textContent);
    const labels = new Map([...list.tBodies[0].rows].map((row) => [row.cells[1].textContent, row.cells[0].textContent]));
    const REFERENCES = ["backlund", "backlund_splitting"];
    const VIEWS = { // key of the data: title, what is across
      h: ["error against the step", "step h, in the top’s units"],
      drift: ["largest error of an invariant so far", "time, in the top’s units"],
      work: ["error against cost", "seconds of the run, set-up counted"],
    };
    let data = null, name = "";
    const element = (tag, text, ...children) => {
      const made = document.createElement(tag);
      if (text) made.textContent = text;
      made.append(...children);
      return made;
    };

    // An SVG of all curves of a view, this method's black; null if there are none
    function plot(key, top) {
      const curves = Object.entries(top[key]), [title, across] = VIEWS[key];
      if (!curves.length) return null;
      const [left, right, foot, head, width, height] = [44, 8, 34, 22, 320, 230];
      const all = curves.flatMap(([, points]) => points), xs = all.filter((_, i) => i % 2 === 0), ys = all.filter((_, i) => i % 2);
      const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs, Math.min(...xs) + 1), Math.min(...ys), Math.max(...ys, Math.min(...ys) + 1)];
      const X = (x) => left + ((width - left - right) * (x - x0)) / (x1 - x0), Y = (y) => height - foot - ((height - foot - head) * (y - y0)) / (y1 - y0);
      const svg = (tag, attributes, text) => {
        const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
        for (const [k, v] of Object.entries(attributes)) made.setAttribute(k, v);
        if (text) made.textContent = text;
        return made;
      };
      const whole = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${title}: ${labels.get(name)} on ${top.label}` });
      const sign = (k) => `10${String(k).replace(/./g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)])}`;
      const ticks = (low, high) => {
        const [from, to] = [Math.ceil(low / data.parts), Math.floor(high / data.parts)], step = Math.ceil((to - from + 1) / 6);
        return Array.from({ length: to - from + 1 }, (_, i) => from + i).filter((k) => k % step === 0);
      };
      whole.append(svg("text", { x: 4, y: 13, class: "title" }, key === "work" ? `${title}, t = ${top.span}` : title));
      for (const k of ticks(y0, y1)) {
        whole.append(svg("path", { class: "grid", d: `M${left} ${Y(k * data.parts)}H${width - right}` }));
        whole.append(svg("text", { x: left - 5, y: Y(k * data.parts) + 3.5, "text-anchor": "end" }, sign(k)));
      }
      for (const k of ticks(x0, x1)) whole.append(svg("text", { x: X(k * data.parts), y: height - 20, "text-anchor": "middle" }, sign(k)));
      whole.append(svg("text", { x: (left + width - right) / 2, y: height - 4, "text-anchor": "middle" }, across));
      const rank = ([other]) => (other === name ? 2 : REFERENCES.includes(other) ? 1 : 0);
      for (const [other, points] of curves.sort((a, b) => rank(a) - rank(b))) {
        const d = points.map((value, i) => (i % 2 ? Y(value) : `${i ? "L" : "M"}${X(value).toFixed(1)}`)).map((v) => (typeof v === "number" ? v.toFixed(1) : v)).join(" ");
        const line = svg("path", { class: ["other", "reference", "own"][rank([other])], d });
        line.append(svg("title", {}, labels.get(other) ?? other));
        whole.append(line);
      }
      return whole;
    }

    function draw() {
      const top = data.tops.find((one) => one.name === choice.value);
      const drawn = Object.keys(VIEWS).map((key) => {
        if (!top[key][name]) return element("p", `${VIEWS[key][0]}: not measured on this top`);
        return plot(key, top);
      });
      plots.replaceChildren(...drawn);
    }

    async function open(row) {
      data ??= JSON.parse(await unpack("panels"));
      name = row.cells[1].textContent;
      dialog.querySelector("#method-name").textContent = labels.get(name);
      const said = heads.map((head, i) => [head, row.cells[i].textContent]).slice(1);
      const found = (data.kept[name] ?? []).map(([claim, measured]) => [claim, `measured: ${measured}`]);
      facts.replaceChildren(...[...said, ...found].flatMap(([head, text]) => [element("dt", head), element("dd", text)]));
      const claims = (data.about[name] ?? []).map((id) => document.getElementById(`claim-${id}`)).filter(Boolean).map((item) => {
        const link = element("a", "details");
        link.href = `#${item.id}`;
        link.addEventListener("click", () => dialog.close());
        return element("li", "", item.querySelector(".badge").cloneNode(true), ` ${item.querySelector("div").firstChild.textContent.trim()} `, link);
      });
      about.replaceChildren(...(claims.length ? [element("p", "Claims of this page about it:"), element("ul", "", ...claims)] : []));
      const measured = data.tops.filter((top) => Object.keys(VIEWS).some((key) => top[key][name]));
      const before = choice.value;
      choice.replaceChildren(...measured.map((top) => new Option(top.label, top.name, false, top.name === before)));
      choice.parentNode.hidden = !measured.length;
      if (measured.length) draw();
      else plots.replaceChildren(element("p", "No run of this method is stored."));
      dialog.showModal();
      dialog.querySelector(".pane").scrollTop = 0;
    }

    for (const row of list.tBodies[0].rows) {
      const button = element("button", row.cells[0].textContent);
      button.type = "button";
      button.addEventListener("click", () => open(row));
      row.cells[0].replaceChildren(button);
    }
    const lines = new Map([...list.tBodies[0].rows].map((row) => [labels.get(row.cells[1].textContent), row]));
    for (const text of document.querySelectorAll("figure svg text")) { // names at the ends of curves
      const row = lines.get(text.textContent.trim());
      if (!row) continue;
      text.classList.add("named");
      text.addEventListener("click", (event) => { event.stopPropagation(); open(row); });
    }
    list.closest(".scroll").before(element("p", "A name opens a panel with the claims and the curves of the method; so does a name in a figure."));
    choice.addEventListener("change", draw);
    dialog.querySelector('[name="close"]').addEventListener("click", () => dialog.close());
  }
}

// The section in view is marked in the navigation, and its entry kept in sight.
{
  const links = new Map([...document.querySelectorAll("nav a")].map((a) => [a.hash.slice(1), a]));
  const parts = [...document.querySelectorAll("main > section")].filter((part) => links.has(part.id));
  let current = null, waiting = false;
  function mark() {
    waiting = false;
    const here = parts.filter((part) => part.getBoundingClientRect().top < 0.4 * innerHeight).pop();
    const link = links.get(here?.id ?? "top");
    if (link === current) return;
    current?.removeAttribute("aria-current");
    current = link;
    link.setAttribute("aria-current", "true");
    const row = link.parentElement;
    row.scrollTo({ left: link.offsetLeft - row.offsetLeft - (row.clientWidth - link.offsetWidth) / 2 });
  }
  addEventListener("scroll", () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(mark);
  }, { passive: true });
  mark();
}
