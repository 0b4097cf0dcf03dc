// What is known of the frame that is shown: the first things first, and then its whole header.

const FIRST_FACTS = [
  ["Key", "key"], ["Quality", "quality"], ["Seed", "seed"], ["Samples", "samples"], ["Variant", "variant"],
  ["Mitsuba", "mitsuba"], ["Mesh key", "mesh_key"], ["Vertices", "surface_vertices"], ["Triangles", "surface_faces"],
  ["Camera", "camera.origin"], ["Looks at", "camera.target"], ["Field of view", "camera.field_of_view"],
  ["Shutter", "shutter"], ["Look", "look.model"], ["Picture code", "picture_code"], ["Simulation code", "simulation_code"],
];

class FactsPanel {
  constructor(element, review) { Object.assign(this, { element, review, isOpen: false }); }

  draw() {
    if (this.element.hidden) return;
    const { a, b, transport, stage } = this.review, sequences = stage.needsB && a !== b ? [a, b] : [a];
    const scroll = this.element.scrollTop;
    const whole = make("details", { open: this.isOpen, ontoggle: () => { this.isOpen = whole.open; } },
      make("summary", {}, "Everything in the header"), tableOf("Header", sequences, headerRows(sequences, transport.frame)));
    this.element.replaceChildren(tableOf("Frame", sequences, this.#rows(sequences, transport.frame)), whole);
    this.element.scrollTop = scroll;
  }

  #rows(sequences, frame) {
    const of = (fact) => sequences.map(fact);
    const told = (seconds) => (seconds == null ? "" : `${+seconds.toPrecision(3)} s`);
    const known = [
      ["Because", of((each) => each.state(frame)[1])], ["Note", of((each) => each.note)],
      ...FIRST_FACTS.map(([label, name]) => [label, of((each) => abbreviated(shown(name, each.fact(frame, name))))]),
    ].filter(([, values]) => values.some(Boolean));
    return [["Frame", of(() => String(frame))], ["State", of((each) => each.state(frame)[0])], ["Rendering took", of((each) => told(each.seconds.render?.[frame]))], ...known];
  }
}

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
  const head = sequences.length > 1 ? [make("tr", {}, make("td"), ...["A", "B"].map((side) => make("th", { scope: "col" }, side)))] : [];
  const body = rows.map(([name, values]) => {
    const isSame = values.every((value) => value === values[0]);
    return make("tr", isSame ? "" : "differs", make("th", { scope: "row" }, name), ...values.map((value) => make("td", {}, value || "–")));
  });
  return make("table", { className: "facts", ariaLabel: label }, make("thead", {}, ...head), make("tbody", {}, ...body));
}
