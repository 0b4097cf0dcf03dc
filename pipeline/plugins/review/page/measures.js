// The measures of a shot's meshes, and the seconds its frames took, as charts over the frames.

const STAGE_INKS = {
  simulate: ["simulating", "#8796a8"], smooth_normals: ["smoothing", "#a5ad92"], render: ["rendering", "#d8c8a4"], finish: ["denoising", "#b3907d"],
};
const UP_INK = "#a9c6b6", DOWN_INK = "#d6ab95";

class MeasuresPanel {
  constructor(element, review) { Object.assign(this, { element, review }); }

  draw() {
    if (this.shown !== this.review.a) this.#build(this.review.a);
    for (const chart of this.charts) chart.draw(this.review.transport.frame);
  }

  #build(sequence) {
    this.shown = sequence;
    const { numbers, measures, limits } = sequence.about, rows = numbers.map((number) => measures[number] ?? null);
    const of = (name) => rows.map((row) => row?.[name] ?? null), has = (name) => of(name).some((value) => value !== null);
    const stages = Object.keys(STAGE_INKS).filter((stage) => sequence.seconds[stage]);
    const all = [
      has("vertices") && counted(of("vertices"), of("faces")),
      has("splits") && changed(of("splits"), of("collapses")),
      has("edges") && edges(rows, limits),
      has("quality") && quality(rows),
      has("area") && kept(of("area"), of("volume")),
      of("crossings").some(Boolean) && crossed(of("crossings")),
      stages.length > 0 && seconds(numbers, stages, sequence.seconds),
    ];
    this.charts = all.filter(Boolean).map((about) => new Chart(about, numbers, (frame) => this.review.transport.go(frame)));
    const none = this.charts.length ? [] : ["No meshes of this shot are in the store, and so there are no measures."];
    this.element.replaceChildren(...this.charts.map((chart) => chart.figure), ...none);
  }
}

const count = (value) => (value === null || value === undefined ? "–" : Math.round(value).toLocaleString("en").replaceAll(",", "\u2009"));
const short = (value) => (Math.abs(value) >= 1e6 ? `${(value / 1e6).toPrecision(3)} M` : Math.abs(value) >= 1e4 ? `${(value / 1e3).toPrecision(3)} k` : `${+value.toPrecision(3)}`);
const digits = (value, many = 4) => (Number.isFinite(value) ? `${+value.toPrecision(many)}` : "–");

/** A chart of curves over the frames, [values, name] each, with their highest and lowest value beside them. */
function curves(about, lines, value, words = short) {
  const there = lines.flatMap(([values]) => values).filter(Number.isFinite);
  const low = Math.min(...there), high = Math.max(...there);
  const room = high > low ? 0.06 * (high - low) : Math.abs(high) * 0.1 || 1;
  const shapes = lines.map(([values, name]) => lineOf(values, [low - room, high + room], name));
  return { ...about, shapes, value, ends: there.length ? [words(high), words(low)] : [] };
}

function counted(vertices, faces) {
  const value = (place) => count(vertices[place]) + (faces[place] ? `, ${count(faces[place])} triangles` : "");
  return curves({ title: "Vertices", hint: "how many the mesh has", height: 52 }, [[vertices, "first"]], value);
}

/** Crossings, which are counted in some frames only: a line from one of these to the next. */
function crossed(values) {
  const about = { title: "Crossings", hint: "pairs of faces that pass through each other; counted in some frames", height: 48 };
  return curves(about, [[bridged(values), "first"]], (place) => (Number.isFinite(values[place]) ? count(values[place]) : "not counted"));
}

/** The values with gaps between two of them filled along a straight line. */
function bridged(values) {
  const filled = [...values];
  let last = -1;
  values.forEach((value, i) => {
    if (!Number.isFinite(value)) return;
    for (let k = last + 1; last >= 0 && k < i; k++) filled[k] = values[last] + ((value - values[last]) * (k - last)) / (i - last);
    last = i;
  });
  return filled;
}

function changed(splits, collapses) {
  const most = Math.max(1, ...splits, ...collapses), half = WHOLE / 2;
  const bars = (values, way, ink) => barsOf(values.map((value) => [half, (way * half * (value ?? 0)) / most]), ink);
  return {
    title: "Splits and collapses", hint: "splits upwards, collapses downwards", height: 72,
    shapes: [bars(splits, 1, UP_INK), bars(collapses, -1, DOWN_INK), lineOf(splits.map(() => 0), [-1, 1], "zero")],
    ends: [short(most), short(most)],
    value: (place) => `${count(splits[place])} splits, ${count(collapses[place])} collapses`,
  };
}

function edges(rows, [shortest, longest]) {
  const top = rows.find((row) => row?.edge_top)?.edge_top ?? 1, shares = rows.map((row) => row?.edges ?? null);
  const levels = [["maximum", longest], ["minimum", shortest]].filter(([, level]) => level && level < top);
  return {
    title: "Edge lengths", hint: "share of the edges by length, brighter where there are more", height: 96,
    shapes: [heatOf(shares), ...levels.map(([word, level]) => levelOf(level / top, `${word} ${digits(level)}`))],
    value: (place) => `mean ${digits(rows[place]?.mean_edge, 3)}`,
    aside: (place) => shares[place],
  };
}

function quality(rows) {
  const shares = rows.map((row) => row?.quality ?? null), worst = rows.map((row) => row?.worst ?? null);
  const hint = "share of the triangles by roundness, from needles below to equilateral ones above; the line: a hundredth is below it";
  return {
    title: "Triangle quality", hint, height: 74,
    shapes: [heatOf(shares), lineOf(worst, [0, 1], "worst")],
    value: (place) => `worst hundredth under ${digits(worst[place], 2)}`,
    aside: (place) => shares[place],
  };
}

function kept(area, volume) {
  const about = { title: "Area and volume", hint: "of the first frame's, per cent; volume is dashed", height: 56 };
  const share = (values) => {
    const first = values.find(Number.isFinite);
    return values.map((value) => (Number.isFinite(value) && first ? (100 * value) / first : null));
  };
  const value = (place) => `${digits(area[place])}${volume[place] === null ? "" : `, ${digits(volume[place])}`}`;
  return curves(about, [[share(area), "first"], [share(volume), "second"]], value, (most) => `${most.toFixed(0)} %`);
}

function seconds(numbers, stages, told) {
  const columns = numbers.map((number) => stages.map((stage) => told[stage][number] ?? 0)), total = (values) => values.reduce((sum, s) => sum + s, 0);
  const sums = columns.map(total), sorted = [...sums].sort((a, b) => a - b);
  const usual = 1.6 * sorted[Math.floor(0.96 * (sorted.length - 1))], most = Math.min(sorted.at(-1), usual) || 1; // first frames are slow
  const bars = (stage) => columns.map((column) => [(WHOLE * total(column.slice(0, stage))) / most, (WHOLE * column[stage]) / most]);
  return {
    title: "Seconds", hint: `a frame took, by stage: ${stages.map((stage) => STAGE_INKS[stage][0]).join(", ")}`, height: 64,
    shapes: stages.map((stage, i) => barsOf(bars(i), STAGE_INKS[stage][1])),
    ends: [`${digits(most, 2)} s`, "0"],
    value: (place) => (sums[place] ? `${digits(sums[place], 3)} s` : "–"),
    legend: stages.map((stage) => STAGE_INKS[stage]),
    parts: (place) => columns[place].map((value) => (value ? digits(value, 2) : "–")),
  };
}

const WHOLE = 100;

class Chart {
  /**
   * about   {title, hint, height, shapes: elements, value: (place) words, ends: [highest, lowest] in words beside the
   *         frames, aside: (place) shares beside them, legend: [name, ink], parts: (place) words for each name of it}
   */
  constructor(about, numbers, seek) {
    Object.assign(this, { numbers, output: make("span", "about"), head: make("div", "head"), told: about.legend?.map(() => make("b")) }, about);
    this.bars = svg("svg", { class: "aside", preserveAspectRatio: "none" });
    const drawing = svg("svg", { viewBox: `0 0 ${numbers.length} ${WHOLE}`, preserveAspectRatio: "none" });
    drawing.append(...this.shapes.filter((shape) => shape instanceof SVGElement));
    const flat = this.shapes.filter((shape) => shape instanceof HTMLElement);
    this.plot = make("div", { className: "plot", role: "img", ariaLabel: `${this.title} by frame: ${this.hint}` }, ...flat, drawing, this.head);
    const ends = make("div", "ends", ...(this.ends ?? []).map((words) => make("span", {}, words)));
    const caption = make("figcaption", {}, make("span", { title: this.hint }, this.title), this.output);
    this.figure = make("figure", "chart", caption, make("div", "chart-box", this.plot, make("div", "beside", this.bars, ends)), ...this.#legend());
    this.figure.style.setProperty("--tall", this.height);
    const placeAt = (event) => columnAt(this.plot, event, numbers.length);
    const go = (event) => seek(numbers[placeAt(event)]);
    const hover = (event) => { this.hovered = event && placeAt(event); this.draw(this.frame); };
    gestures(this.plot, { start: go, move: go, hover });
    this.plot.addEventListener("pointerleave", () => hover());
  }

  /** Names in their inks, each with its part of the value. */
  #legend() {
    const item = ([name, ink], i) => make("span", {}, make("i", { style: `background: ${ink}` }), `${name} `, this.told[i]);
    return this.legend ? [make("p", "legend", ...this.legend.map(item))] : [];
  }

  draw(frame) {
    this.frame = frame;
    const { hovered } = this, place = hovered ?? this.numbers.indexOf(frame);
    this.head.hidden = place < 0;
    if (place < 0) return;
    this.head.style.left = `${(100 * (place + 0.5)) / this.numbers.length}%`;
    this.output.textContent = hovered === undefined ? this.value(place) : `${this.numbers[place]}: ${this.value(place)}`;
    this.parts?.(place).forEach((words, i) => { this.told[i].textContent = words; });
    if (this.aside) this.#drawAside(this.aside(place) ?? []);
  }

  /** One frame's shares as bars beside the plot, the lowest below. */
  #drawAside(shares) {
    const most = Math.max(...shares, 0) || 1;
    setAttributes(this.bars, { viewBox: `0 0 1 ${shares.length || 1}` });
    this.bars.replaceChildren(svg("path", { d: shares.map((share, i) => `M0 ${shares.length - i - 1}h${share / most}v0.8H0z`).join("") }));
  }
}

/** A curve through the frames' values; gaps where there are none. */
function lineOf(values, [low, high], name) {
  const at = (value, i) => `${i + 0.5} ${WHOLE * (1 - (value - low) / (high - low))}`;
  const path = values.map((value, i) => (!Number.isFinite(value) ? "" : `${Number.isFinite(values[i - 1]) ? "L" : "M"}${at(value, i)}`));
  return svg("path", { class: `line ${name}`, d: path.join("") });
}

/** Bars from their feet upwards, or downwards where they are negative: [[foot, height]] of the frames. */
function barsOf(bars, ink) {
  const each = ([foot, height], i) => `M${i} ${WHOLE - foot}h0.9v${-height}h-0.9z`;
  return svg("path", { d: bars.map(each).join(""), fill: ink, stroke: "none" });
}

/** A thin level across the plot, with a word. */
function levelOf(share, word) { return make("div", { className: "level", style: `bottom: ${100 * share}%`, textContent: word }); }

/** Shares by frame and bin as brightness; the lowest bin is below. */
function heatOf(rows) {
  const bins = rows.find(Boolean)?.length ?? 1, most = Math.max(...rows.flatMap((row) => row ?? [0])) || 1;
  const lightOf = (i, bin) => (rows[i] ? 31 + 209 * Math.sqrt(rows[i][bin] / most) : 24);
  const map = make("canvas", { className: "heat", width: rows.length, height: bins });
  drawPixels(map, 0, rows.length, bins, (...at) => Array(3).fill(lightOf(...at)));
  return map;
}

/** Draw pixels of a canvas from column `left` on: `inkOf(x, y)` is red, green and blue; y goes upwards. */
function drawPixels(canvas, left, width, height, inkOf) {
  const image = new ImageData(width, height);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) image.data.set([...inkOf(x, y), 255], 4 * ((height - 1 - y) * width + x));
  }
  canvas.getContext("2d").putImageData(image, left, 0);
}
