"use strict";

// The question which method to take: a field for each of the first four columns of the answers, and the choice in the address.
{
  const form = document.querySelector("form.choose");
  if (form) {
    const answer = document.querySelector(".answer"), [text, copy] = ["[role=status]", ".copy"].map((part) => answer.querySelector(part));
    const [line, button] = [copy.querySelector("code"), copy.querySelector("button")];
    const FIELDS = { problem: "", length: "10⁴", error: "", conserve: "" }; // names in the address, and what is chosen at first
    const { columns: heads, data: rows } = JSON.parse(document.querySelector("script.answers").textContent);
    const names = Object.keys(FIELDS), fields = names.map((name, i) => {
      const label = document.createElement("label"), field = document.createElement("select");
      label.append(`${heads[i][0].toUpperCase()}${heads[i].slice(1)} `, field);
      form.append(label);
      return field;
    });
    const fits = (row, n) => fields.slice(0, n).every((field, i) => field.value === row[i]);
    // each field offers what is stored for those before it
    function offer(asked) {
      fields.forEach((field, i) => {
        const before = asked?.get(names[i]) ?? (field.value || FIELDS[names[i]]);
        const texts = [...new Set(rows.filter((row) => fits(row, i)).map((row) => row[i]))];
        field.replaceChildren(...texts.map((text) => new Option(text, text, false, text === before)));
      });
      const [method, , cost, next, figure, python] = rows.find((row) => fits(row, fields.length)).slice(fields.length);
      const [label, link] = ["b", "a"].map((tag) => document.createElement(tag));
      label.textContent = method;
      text.replaceChildren(label, `: ${cost}.${next ? ` ${next[0].toUpperCase()}${next.slice(1)}.` : ""} `);
      line.textContent = python;
      button.textContent = "Copy";
      const drawn = document.getElementById(`figure-${figure}`);
      if (drawn) {
        link.href = `#figure-${figure}`;
        link.textContent = drawn.querySelector("figcaption b").textContent.replace(/\.$/, "");
        text.append(link);
      }
    }
    function read() {
      if (location.hash.startsWith("#choose?")) offer(new URLSearchParams(location.hash.slice(8)));
    }
    form.addEventListener("change", () => {
      offer();
      history.replaceState(null, "", `#choose?${new URLSearchParams(fields.map((field, i) => [names[i], field.value]))}`);
    });
    button.addEventListener("click", async () => {
      await navigator.clipboard?.writeText(`from lagrange_bench import integrate\n\nrun = ${line.textContent}\n`);
      button.textContent = navigator.clipboard ? "Copied" : "Select the line to copy it";
    });
    addEventListener("hashchange", read);
    form.hidden = answer.hidden = false;
    offer();
    read();
  }
}

// What an address names is unfolded and shown.
function reveal() {
  const id = decodeURIComponent(location.hash.slice(1)).replace(/\?.*/, ""), target = id && document.getElementById(id);
  if (!target) return;
  for (let part = target; part; part = part.parentElement) if (part.tagName === "DETAILS") part.open = true;
  target.scrollIntoView();
}
addEventListener("hashchange", reveal);
document.addEventListener("click", (event) => { if (event.target.closest("a[href^='#']")?.hash === location.hash) reveal(); });

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

// Rows, and drawings that are folded, are embedded as gzip in base64.
async function unpack(script) {
  const bytes = Uint8Array.from(atob(script.textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

// A line and its name in a figure: pointing at either dims the others, a click pins it.
function prepare(svg) {
  const texts = [...svg.querySelectorAll("text")];
  for (const leader of svg.querySelectorAll('[id*="LineCollection"]')) leader.classList.add("leader"); // from lines to names
  for (const title of svg.querySelectorAll("g > title")) {
    const line = title.parentNode, name = title.textContent;
    title.remove(); // the browser's own hint comes late, and not on a phone
    line.dataset.line = name;
    for (const path of line.querySelectorAll("path")) { // wide enough to be hit
      const hit = path.cloneNode();
      hit.setAttribute("class", "hit");
      hit.removeAttribute("style");
      hit.removeAttribute("id");
      if (!path.closest("defs")) path.after(hit);
    }
    for (const text of texts) {
      if (text.textContent.trim() !== name) continue;
      text.dataset.line = name;
      const handle = text.closest('[id*="legend"]') && text.parentNode.previousElementSibling;
      if (handle) handle.dataset.line = name;
    }
  }
}
{
  const parts = (svg, name) => svg.querySelectorAll(`[data-line="${CSS.escape(name)}"]`);
  function light(svg, name) {
    for (const lit of svg.querySelectorAll(".lit")) lit.classList.remove("lit");
    svg.closest("figure, dialog")?.querySelector(".pointed")?.replaceChildren(name ?? "");
    svg.classList.toggle("dim", Boolean(name));
    if (name) for (const part of parts(svg, name)) part.classList.add("lit");
  }
  const at = (event) => event.target.closest?.("[data-line]");
  document.addEventListener("pointerover", (event) => {
    const svg = event.target.closest?.(".card svg, #zoom svg");
    if (svg) light(svg, at(event)?.dataset.line ?? svg.dataset.pinned);
  });
  document.addEventListener("pointerout", (event) => {
    const svg = event.target.closest?.(".card svg, #zoom svg");
    if (svg && !svg.contains(event.relatedTarget)) light(svg, svg.dataset.pinned);
  });
  document.addEventListener("click", (event) => {
    const svg = event.target.closest?.(".card svg, #zoom svg");
    if (!svg) return;
    const name = at(event)?.dataset.line;
    if (!name || name === svg.dataset.pinned) delete svg.dataset.pinned;
    else svg.dataset.pinned = name;
    light(svg, svg.dataset.pinned);
    if (name) event.stopPropagation(); // the figure is not enlarged
  }, true);
  for (const svg of document.querySelectorAll(".card svg")) prepare(svg);
}

// A drawing that is folded is unpacked when it is unfolded.
document.addEventListener("toggle", async (event) => {
  if (!event.target.open) return;
  for (const drawing of event.target.querySelectorAll("script.drawing")) {
    const place = drawing.parentNode, text = await unpack(drawing);
    if (!drawing.isConnected) continue; // unpacked twice
    drawing.remove();
    place.insertAdjacentHTML("beforeend", text);
    prepare(place.lastElementChild);
  }
}, true);

// On a phone the panels of a figure stand one below the other: another drawing, embedded as the rows are.
{
  const phone = matchMedia("(max-width: 40rem)");
  async function stack() {
    if (!phone.matches) return;
    for (const drawing of document.querySelectorAll("script.phone")) {
      const card = document.querySelector(`#figure-${CSS.escape(drawing.id.slice(6))} .wide-scroll`);
      const text = await unpack(drawing);
      drawing.remove();
      card.insertAdjacentHTML("beforeend", text);
      card.lastElementChild.classList.add("phone");
      prepare(card.lastElementChild);
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
    const text = await unpack(document.getElementById(link.hash.slice(1)));
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
const FILTERED = 20; // rows from which on a table has the field
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
    dialog.querySelector(".caption").textContent = figure.querySelector("figcaption").firstElementChild.nextSibling.textContent;
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
    figure.querySelector(".tools").append(button);
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

// The section in view is marked in the navigation, and its entry kept in sight.
{
  const links = new Map([...document.querySelectorAll("nav a")].map((a) => [a.hash.slice(1), a]));
  const parts = [...document.querySelectorAll("main > section")].filter((part) => links.has(part.id));
  let current = null, waiting = false;
  function mark() {
    waiting = false;
    const end = scrollY > 0 && scrollY + innerHeight > document.documentElement.scrollHeight - 2; // the last part may be short
    const here = end ? parts.at(-1) : parts.filter((part) => part.getBoundingClientRect().top < 0.4 * innerHeight).pop();
    const link = links.get(here?.id ?? parts[0]?.id);
    if (!link || link === current) return;
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
reveal();
