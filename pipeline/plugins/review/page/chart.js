// A chart over frames: shapes that are made once, and a playhead that runs over them. Frames are 1 wide, and the chart
// is 100 high, from its foot upwards.

const WHOLE = 100;

class Chart {
  /**
   * about    {title, hint, height, legend}
   * parts    {shapes: elements, value: (place) words, parts: (place) words for each name of the legend,
   *          aside: (place) shares beside the frames, ends: [highest, lowest] in words beside them}
   */
  constructor(about, numbers, parts, seek) {
    Object.assign(this, { about, numbers, ...parts });
    this.output = make("span");
    this.bars = svg("svg", { class: "aside", preserveAspectRatio: "none" });
    this.head = make("div", "head");
    const drawing = svg("svg", { viewBox: `0 0 ${numbers.length} ${WHOLE}`, preserveAspectRatio: "none" });
    drawing.append(...this.shapes.filter((shape) => shape instanceof SVGElement));
    const flat = this.shapes.filter((shape) => shape instanceof HTMLElement);
    this.plot = make("div", { className: "plot", role: "img", ariaLabel: `${about.title} by frame: ${about.hint}` }, ...flat, drawing, this.head);
    const ends = make("div", "ends", ...(this.ends ?? []).map((words) => make("span", {}, words)));
    const caption = make("figcaption", {}, make("span", { title: about.hint }, about.title), this.output);
    this.figure = make("figure", "chart", caption, make("div", "chart-box", this.plot, make("div", "beside", this.bars, ends)));
    this.figure.style.setProperty("--tall", about.height);
    this.#addLegend();
    const go = (event) => seek(this.numbers[this.#placeAt(event)]);
    const hover = (event) => { this.hovered = this.#placeAt(event); this.draw(this.frame); };
    gestures(this.plot, { start: go, move: go, hover });
    this.plot.addEventListener("pointerleave", () => { this.hovered = undefined; this.draw(this.frame); });
  }

  /** Names in their inks, each with its part of the value. */
  #addLegend() {
    if (!this.about.legend) return;
    this.told = this.about.legend.map(() => make("b"));
    const items = this.about.legend.map(([name, ink], i) => make("span", {}, make("i", { style: `background: ${ink}` }), `${name} `, this.told[i]));
    this.figure.append(make("p", "legend", ...items));
  }

  #placeAt(event) {
    const box = this.plot.getBoundingClientRect(), count = this.numbers.length;
    return clamp(Math.floor(((event.clientX - box.left) / box.width) * count), 0, count - 1);
  }

  draw(frame) {
    this.frame = frame;
    const place = this.hovered ?? this.numbers.indexOf(frame);
    this.head.hidden = place < 0;
    if (place < 0) return;
    this.head.style.left = `${(100 * (place + 0.5)) / this.numbers.length}%`;
    this.output.textContent = this.hovered === undefined ? this.value(place) : `${this.numbers[place]}: ${this.value(place)}`;
    this.parts?.(place).forEach((words, i) => { this.told[i].textContent = words; });
    if (this.aside) this.#drawAside(this.aside(place) ?? []);
  }

  /** One frame's shares as bars beside the plot, the lowest below. */
  #drawAside(shares) {
    const most = Math.max(...shares, 0) || 1;
    this.bars.setAttribute("viewBox", `0 0 1 ${shares.length || 1}`);
    this.bars.replaceChildren(svg("path", { d: shares.map((share, i) => `M0 ${shares.length - i - 1}h${share / most}v0.8H0z`).join("") }));
  }
}

/** The lowest and highest of values that are there, a little apart; null where none is. */
function extent(values) {
  const there = values.filter(Number.isFinite);
  if (!there.length) return null;
  const low = Math.min(...there), high = Math.max(...there), room = high > low ? 0.06 * (high - low) : Math.abs(high) * 0.1 || 1;
  return [low - room, high + room];
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
  const image = new ImageData(rows.length, bins);
  rows.forEach((row, i) => {
    for (let bin = 0; bin < bins; bin++) {
      const light = row ? 31 + 209 * Math.sqrt(row[bin] / most) : 24;
      image.data.set([light, light, light, 255], 4 * ((bins - 1 - bin) * rows.length + i));
    }
  });
  const map = make("canvas", { className: "heat", width: rows.length, height: bins });
  map.getContext("2d").putImageData(image, 0, 0);
  return map;
}
