"use strict";
// What is known of the frame that is shown: the first things first, and then its whole header.

const FIRST_FACTS = [
  ["Key", "key"], ["Quality", "quality"], ["Seed", "seed"], ["Samples", "samples"], ["Variant", "variant"],
  ["Mitsuba", "mitsuba"], ["Mesh key", "mesh_key"], ["Vertices", "surface_vertices"], ["Triangles", "surface_faces"],
  ["Camera", "camera.origin"], ["Looks at", "camera.target"], ["Field of view", "camera.field_of_view"],
  ["Shutter", "shutter"], ["Look", "look.model"], ["Picture code", "picture_code"], ["Simulation code", "simulation_code"],
];

class FactsPanel {
  constructor(element, review) {
    this.element = element;
    this.review = review;
    this.isOpen = false;
  }

  draw() {
    if (this.element.hidden) return;
    const { a, b, transport, stage } = this.review, sequences = stage.needsB && a !== b ? [a, b] : [a];
    const rows = this.#rows(sequences, transport.frame), scroll = this.element.scrollTop;
    const whole = document.createElement("details");
    whole.open = this.isOpen;
    whole.append(Object.assign(document.createElement("summary"), { textContent: "Everything in the header" }));
    whole.addEventListener("toggle", () => { this.isOpen = whole.open; });
    whole.append(tableOf("Header", sequences, headerRows(sequences, transport.frame)));
    this.element.replaceChildren(tableOf("Frame", sequences, rows), whole);
    this.element.scrollTop = scroll;
  }

  #rows(sequences, frame) {
    const [states, reasons] = [0, 1].map((part) => sequences.map((each) => each.state(frame)[part]));
    const seconds = sequences.map((each) => told(each.seconds.render?.[frame], (s) => `${+s.toPrecision(3)} s`));
    const rows = [
      ["Frame", sequences.map(() => String(frame))],
      ["State", states],
      ...(reasons.some(Boolean) ? [["Because", reasons]] : []),
      ...(sequences.some((each) => each.note) ? [["Note", sequences.map((each) => each.note)]] : []),
      ["Rendering took", seconds],
    ];
    for (const [label, name] of FIRST_FACTS) {
      const values = sequences.map((each) => abbreviated(shown(name, each.fact(frame, name))));
      if (values.some(Boolean)) rows.push([label, values]);
    }
    return rows;
  }
}

const told = (value, words) => (value === undefined || value === null ? "" : words(value));

/** A key by its beginning; the whole of it stands in the header. */
const abbreviated = (text) => (/^[0-9a-f]{32}$/.test(text) ? `${text.slice(0, 10)}…` : text);

/** A value in words. */
function shown(name, value) {
  if (value === undefined || value === null) return "";
  if (name === "camera.field_of_view") return `${((180 / Math.PI) * value).toFixed(1)}°`;
  if (Array.isArray(value)) return value.map((each) => (typeof each === "number" ? +each.toFixed(4) : each)).join("  ");
  return typeof value === "object" ? JSON.stringify(value) : String(value);
}

function headerRows(sequences, frame) {
  const names = [...new Set(sequences.flatMap((each) => each.header(frame).map(([name]) => name)))].sort();
  return names.map((name) => [name, sequences.map((each) => shown("", each.fact(frame, name)))]);
}

/** Rows of [name, values]; what differs between A and B is told by weight. */
function tableOf(label, sequences, rows) {
  const table = document.createElement("table");
  table.className = "facts";
  table.setAttribute("aria-label", label);
  if (sequences.length > 1) {
    const head = table.createTHead().insertRow();
    head.append(document.createElement("td"));
    for (const side of ["A", "B"]) head.append(Object.assign(document.createElement("th"), { textContent: side, scope: "col" }));
  }
  const body = table.createTBody();
  for (const [name, values] of rows) {
    const row = body.insertRow();
    row.append(Object.assign(document.createElement("th"), { textContent: name, scope: "row" }));
    if (values.length > 1 && values[0] !== values[1]) row.className = "differs";
    for (const value of values) row.insertCell().textContent = value || "–";
  }
  return table;
}
