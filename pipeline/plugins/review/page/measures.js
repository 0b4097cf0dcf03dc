// The measures of a shot's meshes, and the seconds its frames took, as charts over the frames: those that `figures` draws.

const BAR_INKS = ["#a9c6b6", "#d6ab95", "#d8c8a4", "#8796a8"];
const WHOLE = 100; // the height of a plot

class MeasuresPanel {
  constructor(element, review) { Object.assign(this, { element, review }); }

  draw() {
    if (this.shown !== this.review.a) this.#build(this.review.a);
    for (const chart of this.charts) chart.draw(this.review.transport.frame);
  }

  #build(sequence) {
    const { numbers, panels } = sequence.about;
    this.shown = sequence;
    this.charts = [...panels, ...sequence.timed].map((panel) => new Chart(panel, numbers, (frame) => this.review.transport.go(frame)));
    const none = panels.length ? [] : ["No meshes of this shot are in the store, and so there are no measures."];
    this.element.replaceChildren(...this.charts.map((chart) => chart.figure), ...none);
  }
}

const count = (value) => value.toLocaleString("en").replaceAll(",", "\u2009");
const short = (value) => value.toLocaleString("en", { notation: "compact", maximumSignificantDigits: 3 });

/** A number of a frame in words: all digits of what is counted, four of what is measured. */
function measured(value) {
  if (value === null || value === undefined) return "–";
  return Number.isInteger(value) ? count(value) : String(+value.toPrecision(4));
}

class Chart {
  /**
   * panel  {title, unit, frames, range} and what is over these frames: `curves`, values each; `bars`, values by the names
   *        of parts, which are stacked; `heat`, shares of each frame, the lowest bin first; `levels`, [value, word] each;
   *        `told`, values by name that are only written
   */
  constructor(panel, numbers, seek) {
    const { title, unit, heat, bars, curves, levels } = panel, [low, high] = panel.range, isHeat = heat.length > 0;
    Object.assign(this, { panel, numbers, output: make("span", "about"), head: make("div", "head") });
    this.parts = Object.keys(bars).map(() => make("b"));
    this.aside = svg("svg", { class: "aside", preserveAspectRatio: "none" });
    const height = (value) => WHOLE * (1 - (value - low) / (high - low)), places = panel.frames.map((frame) => numbers.indexOf(frame));
    const drawing = svg("svg", { viewBox: `0 0 ${numbers.length} ${WHOLE}`, preserveAspectRatio: "none" },
      ...stackedBars(Object.values(bars), places, height), ...curves.map((values) => lineOf(values, places, height)));
    const lines = levels.map(([value, word]) => (
      make("div", { className: "level", style: `top: ${height(value)}%`, textContent: `${word} ${measured(value)}` })
    ));
    const about = { className: "plot", role: "img", ariaLabel: `${title} by frame${unit && `, ${unit}`}` };
    this.plot = make("div", about, ...(isHeat ? [heatOf(heat)] : []), ...lines, drawing, this.head);
    const ends = make("div", "ends", ...(isHeat ? [] : [high, low]).map((value) => make("span", {}, short(value))));
    const legend = make("p", "legend", ...Object.keys(bars).map((name, i) => (
      make("span", {}, make("i", { style: `background: ${BAR_INKS[i]}` }), `${name} `, this.parts[i])
    )));
    const tall = isHeat ? 80 : this.parts.length ? 60 : 44;
    this.figure = chartOf(title, this.output, make("div", "chart-box", this.plot, make("div", "beside", this.aside, ends)), legend);
    give(this.figure, { title: unit, style: `--tall: ${tall}` });
    this.#listen(seek);
  }

  #listen(seek) {
    const frameAt = (event) => this.numbers[columnAt(this.plot, event, this.numbers.length)];
    const go = (event) => seek(frameAt(event));
    const hover = (event) => { this.hovered = event && frameAt(event); this.draw(this.frame); };
    gestures(this.plot, { start: go, move: go, hover });
    this.plot.addEventListener("pointerleave", () => hover());
  }

  draw(frame) {
    this.frame = frame;
    const { panel, hovered, numbers } = this, shown = hovered ?? frame, column = numbers.indexOf(shown);
    this.head.hidden = column < 0;
    this.head.style.left = `${(100 * (column + 0.5)) / numbers.length}%`;
    const place = panel.frames.indexOf(shown), { curves, bars, told, heat } = panel;
    const words = [
      ...curves.map((values) => measured(values[place])),
      ...Object.entries(told).map(([name, values]) => `${measured(values[place])} ${name}`),
    ];
    this.output.textContent = (hovered === undefined ? "" : `${hovered}: `) + words.join(", ");
    Object.values(bars).forEach((values, i) => { this.parts[i].textContent = measured(values[place]).replace("-", ""); });
    this.#drawAside(heat[place] ?? []);
  }

  /** One frame's shares as bars beside the plot, the lowest below. */
  #drawAside(shares) {
    const most = Math.max(...shares, 0) || 1;
    setAttributes(this.aside, { viewBox: `0 0 1 ${shares.length || 1}` });
    this.aside.replaceChildren(svg("path", { d: shares.map((share, i) => `M0 ${shares.length - i - 1}h${share / most}v0.8H0z`).join("") }));
  }
}

/** A figure with its title and, beside this, words about it. */
function chartOf(title, words, ...shapes) {
  return make("figure", "chart", make("figcaption", {}, make("span", {}, title), words), ...shapes);
}

/** A curve through the frames' values; gaps where there are none. */
function lineOf(values, places, height) {
  const step = (value, i) => (value === null ? "" : `${Number.isFinite(values[i - 1]) ? "L" : "M"}${places[i] + 0.5} ${height(value)}`);
  return svg("path", { class: "line", d: values.map(step).join("") });
}

/** Bars of parts, one upon another from zero upwards, or downwards where they are negative. */
function stackedBars(parts, places, height) {
  const above = places.map(() => 0), below = places.map(() => 0);
  return parts.map((values, part) => {
    const bars = values.map((value, i) => {
      const side = value < 0 ? below : above, foot = side[i];
      side[i] += value;
      return `M${places[i]} ${height(foot)}V${height(side[i])}h0.9V${height(foot)}z`;
    });
    return svg("path", { d: bars.join(""), fill: BAR_INKS[part], stroke: "none" });
  });
}

/** Shares by frame and bin as brightness; the lowest bin is below. */
function heatOf(rows) {
  const bins = rows[0].length, most = Math.max(...rows.flat()) || 1;
  const map = make("canvas", { className: "heat", width: rows.length, height: bins });
  drawPixels(map, 0, rows.length, bins, (x, y) => Array(3).fill(31 + 209 * Math.sqrt(rows[x][y] / most)));
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
