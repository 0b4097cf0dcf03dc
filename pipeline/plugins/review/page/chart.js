"use strict";
// A chart over frames: its drawing is made once, and the playhead runs over it.

const AXIS = 56;  // pixels right of the frames, for numbers and histograms
const CHART_INKS = { line: "#e6e6e6", second: "#9c9c9c", rule: "#3b3b3b", label: "#a6a6a6", back: "#1f1f1f" };

class Chart {
  /**
   * about     {title, hint, height, legend}
   * numbers   the frames
   * paint     (context, chart) draws it once, in CSS pixels
   * value     (place) words for a frame, by its place among the numbers
   * parts     (place) words for each name of about.legend, where there is one
   * aside     (context, chart, place) draws what belongs to one frame, right of the frames
   */
  constructor(parent, about, numbers, { paint, value, aside, parts }, seek) {
    Object.assign(this, { about, numbers, paint, value, aside, parts, seek });
    this.figure = parent.appendChild(document.createElement("figure"));
    this.figure.className = "chart";
    const caption = this.figure.appendChild(document.createElement("figcaption"));
    caption.append(Object.assign(document.createElement("span"), { textContent: about.title, title: about.hint }));
    this.output = caption.appendChild(document.createElement("span"));
    this.canvas = this.figure.appendChild(document.createElement("canvas"));
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${about.title} by frame: ${about.hint}`);
    this.layer = document.createElement("canvas");
    this.#addLegend();
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.drags = true;
      this.seek(this.#frameAt(event));
    });
    this.canvas.addEventListener("pointermove", (event) => {
      this.hovered = this.#placeAt(event);
      if (this.drags) this.seek(this.#frameAt(event));
      this.draw(this.frame);
    });
    this.canvas.addEventListener("pointerup", () => { this.drags = false; });
    this.canvas.addEventListener("pointerleave", () => { this.hovered = undefined; this.draw(this.frame); });
  }

  /** Names in their inks, each with its part of the value. */
  #addLegend() {
    if (!this.about.legend) return;
    const legend = this.figure.appendChild(Object.assign(document.createElement("p"), { className: "legend" }));
    this.told = this.about.legend.map(([name, ink]) => {
      const item = legend.appendChild(document.createElement("span"));
      item.append(Object.assign(document.createElement("i"), { style: `background: ${ink}` }), `${name} `);
      return item.appendChild(document.createElement("b"));
    });
  }

  /** Make it so many times as high as it must be. */
  stretch(factor) {
    this.height = Math.round(this.about.height * factor);
    this.canvas.style.height = `${this.height}px`;
  }

  get plotWidth() { return Math.max(10, this.width - AXIS); }

  /** The middle of a frame's column. */
  x(place) { return ((place + 0.5) / this.numbers.length) * this.plotWidth; }

  #placeAt(event) {
    const place = Math.floor((event.offsetX / this.plotWidth) * this.numbers.length);
    return Math.min(this.numbers.length - 1, Math.max(0, place));
  }

  #frameAt(event) { return this.numbers[this.#placeAt(event)]; }

  resize() {
    const dots = window.devicePixelRatio || 1, width = this.canvas.clientWidth;
    if (!width || (this.width === width && this.dots === dots)) return;
    Object.assign(this, { width, dots });
    for (const each of [this.canvas, this.layer]) Object.assign(each, { width: width * dots, height: this.height * dots });
    const context = this.layer.getContext("2d", { alpha: false });
    context.setTransform(dots, 0, 0, dots, 0, 0);
    context.fillStyle = "#262626";
    context.fillRect(0, 0, width, this.height);
    context.fillStyle = CHART_INKS.back;
    context.fillRect(0, 0, this.plotWidth, this.height);
    this.paint(context, this);
  }

  draw(frame) {
    this.frame = frame;
    this.resize();
    if (!this.width) return;
    const context = this.canvas.getContext("2d", { alpha: false }), place = this.numbers.indexOf(frame);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(this.layer, 0, 0);
    context.setTransform(this.dots, 0, 0, this.dots, 0, 0);
    const shown = this.hovered ?? place;
    if (this.hovered !== undefined) this.#line(context, this.hovered, "rgba(255, 255, 255, 0.35)");
    if (place >= 0) this.#line(context, place, "#ffffff");
    if (shown >= 0) {
      this.aside?.(context, this, shown);
      const told = this.value(shown);
      this.parts?.(shown).forEach((part, i) => { this.told[i].textContent = part; });
      this.output.textContent = this.hovered === undefined ? told : `${this.numbers[shown]}: ${told}`;
    }
  }

  #line(context, place, ink) {
    const x = Math.round(this.x(place));
    context.fillStyle = "rgba(0, 0, 0, 0.6)";
    context.fillRect(x - 1, 0, 3, this.height);
    context.fillStyle = ink;
    context.fillRect(x, 0, 1, this.height);
  }
}

/** The lowest and highest of values that are there, a little apart; null where none is. */
function extent(values) {
  const there = values.filter((value) => Number.isFinite(value));
  if (!there.length) return null;
  const low = Math.min(...there), high = Math.max(...there), room = high > low ? 0.06 * (high - low) : Math.abs(high) * 0.1 || 1;
  return [low - room, high + room];
}

/** Words beside the plot, at its top and its bottom. */
function labelAxis(context, chart, top, bottom) {
  context.font = "11px system-ui, sans-serif";
  context.fillStyle = CHART_INKS.label;
  context.textAlign = "left";
  context.textBaseline = "top";
  context.fillText(top, chart.plotWidth + 6, 2);
  context.textBaseline = "bottom";
  context.fillText(bottom, chart.plotWidth + 6, chart.height - 1);
}

/** A curve through the frames' values; gaps where there are none. */
function paintLine(context, chart, values, [low, high], ink, dash = []) {
  context.strokeStyle = ink;
  context.lineWidth = 1.5;
  context.lineJoin = "round";
  context.setLineDash(dash);
  context.beginPath();
  let goes = false;
  values.forEach((value, i) => {
    if (!Number.isFinite(value)) { goes = false; return; }
    const y = chart.height - ((value - low) / (high - low)) * chart.height;
    if (goes) context.lineTo(chart.x(i), y); else context.moveTo(chart.x(i), y);
    goes = true;
  });
  context.stroke();
  context.setLineDash([]);
}

/** Shares by frame and bin as brightness; the lowest bin is below. */
function paintHeat(context, chart, rows) {
  const bins = rows.find(Boolean)?.length ?? 0, most = Math.max(...rows.flatMap((row) => row ?? [0]));
  if (!bins || !most) return;
  const image = new ImageData(rows.length, bins);
  rows.forEach((row, i) => {
    for (let bin = 0; bin < bins; bin++) {
      const light = row ? 31 + 209 * Math.sqrt(row[bin] / most) : 24, at = 4 * ((bins - 1 - bin) * rows.length + i);
      image.data.set([light, light, light, 255], at);
    }
  });
  const map = Object.assign(document.createElement("canvas"), { width: rows.length, height: bins });
  map.getContext("2d").putImageData(image, 0, 0);
  context.imageSmoothingEnabled = false;
  context.drawImage(map, 0, 0, chart.plotWidth, chart.height);
}

/** One frame's shares as bars beside the plot. */
function paintHistogram(context, chart, row) {
  const left = chart.plotWidth + 6, room = AXIS - 8;
  context.fillStyle = "#262626";
  context.fillRect(chart.plotWidth, 0, AXIS, chart.height);
  if (!row) return;
  const most = Math.max(...row) || 1, each = chart.height / row.length;
  context.fillStyle = "#bdbdbd";
  row.forEach((share, bin) => {
    context.fillRect(left, chart.height - (bin + 1) * each, (share / most) * room, Math.max(1, each - 0.35));
  });
}

/** A thin level across the plot, with a word. */
function paintLevel(context, chart, share, word) {
  const y = Math.round(chart.height * (1 - share)) + 0.5;
  context.strokeStyle = "rgba(255, 255, 255, 0.4)";
  context.lineWidth = 1;
  context.setLineDash([3, 3]);
  context.beginPath();
  context.moveTo(0, y);
  context.lineTo(chart.plotWidth, y);
  context.stroke();
  context.setLineDash([]);
  context.font = "10.5px system-ui, sans-serif";
  context.textAlign = "left";
  context.textBaseline = share > 0.85 ? "top" : "bottom";
  const wide = context.measureText(word).width + 6, top = share > 0.85 ? y + 2 : y - 15;
  context.fillStyle = "rgba(24, 24, 24, 0.8)";
  context.fillRect(3, top, wide, 13);
  context.fillStyle = "#d6d6d6";
  context.textBaseline = "top";
  context.fillText(word, 6, top + 1);
}
