// What is known of the frame that is shown, the first things first, then its whole header; and the shot file of A, and
// where that of B differs, line by line.

const FIRST_FACTS = [
  ["Key", "key"], ["Quality", "quality"], ["Seed", "seed"], ["Samples", "samples"], ["Variant", "variant"],
  ["Mitsuba", "mitsuba"], ["Mesh key", "mesh_key"], ["Vertices", "surface_vertices"], ["Triangles", "surface_faces"],
  ["Camera", "camera.origin"], ["Looks at", "camera.target"], ["Field of view", "camera.field_of_view"],
  ["Shutter", "shutter"], ["Look", "look.model"], ["Picture code", "picture_code"], ["Simulation code", "simulation_code"],
];

class FactsPanel {
  constructor(element, review) {
    const parts = { first: make("div"), header: make("div") };
    Object.assign(this, { element, review, ...parts });
    element.append(parts.first, make("details", {}, make("summary", {}, "Everything in the header"), parts.header));
  }

  draw() {
    const { a, b, transport: { frame }, stage } = this.review, sequences = stage.needsB && a !== b ? [a, b] : [a];
    const told = (name) => sequences.some((each) => each.fact(frame, name) !== undefined);
    const names = Object.keys(Object.assign({}, ...sequences.flatMap(({ facts }) => [facts.same, facts.differ]))).filter(told).sort();
    const rows = names.map((name) => [name, sequences.map((each) => shown("", each.fact(frame, name)))]);
    this.first.replaceChildren(tableOf("Frame", sequences, firstRows(sequences, frame)));
    this.header.replaceChildren(tableOf("Header", sequences, rows));
  }
}

function firstRows(sequences, frame) {
  const of = (fact) => sequences.map(fact);
  const known = [
    ["Because", of((each) => each.state(frame)[1])], ["Note", of((each) => each.note)],
    ...FIRST_FACTS.map(([label, name]) => [label, of((each) => abbreviated(shown(name, each.fact(frame, name))))]),
  ].filter(([, values]) => values.some(Boolean));
  return [["Frame", of(() => String(frame))], ["State", of((each) => each.state(frame)[0])], ["Rendering took", of((each) => each.renderingTime(frame))], ...known];
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

/** Rows of [name, values]; what differs between A and B is told by weight. */
function tableOf(label, sequences, rows) {
  const sides = sequences.length > 1 ? ["A", "B"].map((side) => make("th", { scope: "col" }, side)) : [];
  const isSame = (values) => values.every((value) => value === values[0]);
  const body = rows.map(([name, values]) => rowOf(name, values.map((value) => value || "–"), isSame(values) ? "" : "differs"));
  const head = make("thead", {}, ...(sides.length ? [make("tr", {}, make("td"), ...sides)] : []));
  return make("table", { className: "facts", ariaLabel: label }, head, make("tbody", {}, ...body));
}

function rowOf(name, cells, className = "") { return make("tr", className, make("th", { scope: "row" }, name), ...cells.map((cell) => make("td", {}, cell))); }

const CONTEXT = 3;  // equal lines around a difference
const MOST_LINES = 3000;

class ShotPanel {
  constructor(element, review, sources) { Object.assign(this, { element, review, sources }); }

  draw() {
    const { a, b } = this.review;
    if (this.shown?.[0] === a && this.shown[1] === b) return;
    this.shown = [a, b];
    this.element.replaceChildren(...this.#parts(a, b));
    this.element.scrollTop = 0;
  }

  #parts(a, b) {
    const [one, other] = [a, b].map((each) => this.sources[each.source]?.split("\n")), nameOf = (each) => each.name(this.review.isAlone);
    if (!one || !other) return [make("p", "note", `The page has no shot file of ${nameOf(one ? b : a)}.`)];
    if (a === b) return [lineList(one.map((line) => [" ", line]))];
    if (a.source === b.source) return [make("p", "note", "The shot files of A and B are the same."), lineList(one.map((line) => [" ", line]))];
    const lines = differences(one, other), count = lines.filter(([sign]) => sign !== " ").length;
    const words = `${count} ${count === 1 ? "line differs" : "lines differ"}: − ${nameOf(a)} (A), + ${nameOf(b)} (B).`;
    return [make("p", "note", words), lineList(shortened(lines))];
  }
}

/** Lines of two texts as [sign, line]: − of the first only, + of the second only, and a space of both, by their longest
 *  common subsequence; of very long texts all lines are told as changed. */
function differences(one, other) {
  const less = (lines) => lines.map((line) => ["−", line]), more = (lines) => lines.map((line) => ["+", line]);
  if (Math.max(one.length, other.length) > MOST_LINES) return [...less(one), ...more(other)];
  const width = other.length + 1, lengths = new Uint16Array((one.length + 1) * width), found = [];
  for (let i = one.length - 1; i >= 0; i--) {
    for (let j = other.length - 1; j >= 0; j--) {
      const at = i * width + j;
      lengths[at] = one[i] === other[j] ? 1 + lengths[at + width + 1] : Math.max(lengths[at + width], lengths[at + 1]);
    }
  }
  let i = 0, j = 0;
  while (i < one.length && j < other.length) {
    const at = i * width + j, isSame = one[i] === other[j], isLess = !isSame && lengths[at + width] >= lengths[at + 1];
    found.push(isSame ? [" ", one[i]] : isLess ? ["−", one[i]] : ["+", other[j]]);
    i += isSame || isLess;
    j += !isLess;
  }
  return [...found, ...less(one.slice(i)), ...more(other.slice(j))];
}

/** Lines far from a difference in one: [null, how many]. */
function shortened(lines) {
  const isNear = lines.map((_, i) => lines.slice(Math.max(0, i - CONTEXT), i + CONTEXT + 1).some(([sign]) => sign !== " "));
  const kept = [];
  lines.forEach((line, i) => {
    if (isNear[i]) kept.push(line);
    else if (kept.length && kept.at(-1)[0] === null) kept.at(-1)[1] += 1;
    else kept.push([null, 1]);
  });
  return kept;
}

function lineList(lines) {
  const names = { "−": "less", "+": "more" };
  return make("div", "shot-lines", ...lines.map(([sign, line]) => (
    sign === null ? make("div", "gap", `⋯ ${line} equal ${line === 1 ? "line" : "lines"}`) : make("div", names[sign] ?? "", make("b", {}, sign), line)
  )));
}
