"use strict";
// The strip: all frames of A side by side, what is wrong with them, and where time is.

const STRIP = { film: 46, bar: 5, ruler: 17 };
const NOTE_LANES = 4;
const STATUS_INKS = { open: "#7fb7e6", change: "#f0a24e", approved: "#86cf8e" };
const STATE_INKS = { missing: "#6b6b6b", failed: "#e0705f", stale: "#d9b35c" };

class Strip {
  constructor(element, review) {
    this.element = element;
    this.review = review;
    this.canvas = element.appendChild(document.createElement("canvas"));
    this.hover = document.createElement("div");
    this.hover.className = "hover";
    this.hover.hidden = true;
    element.append(this.hover);
    this.sheets = new Map();
    element.addEventListener("pointerdown", (event) => this.#down(event));
    element.addEventListener("pointermove", (event) => this.#move(event));
    element.addEventListener("pointerup", () => { this.scrubs = false; });
    element.addEventListener("pointerleave", () => { this.hover.hidden = true; });
  }

  #numbers() { return this.review.transport.numbers; }

  #frameAt(event) {
    const box = this.element.getBoundingClientRect(), numbers = this.#numbers();
    const place = Math.floor(((event.clientX - box.left) / box.width) * numbers.length);
    return numbers[Math.min(numbers.length - 1, Math.max(0, place))];
  }

  #down(event) {
    this.element.setPointerCapture(event.pointerId);
    this.scrubs = true;
    this.review.seek(this.#frameAt(event));
  }

  #move(event) {
    const frame = this.#frameAt(event);
    if (this.scrubs) this.review.seek(frame);
    this.#showHover(event, frame);
  }

  #showHover(event, frame) {
    const sequence = this.review.a, thumb = sequence.thumb(frame), box = this.element.getBoundingClientRect();
    const [state, why] = sequence.state(frame);
    this.hover.replaceChildren();
    if (thumb && sequence.url(frame)) {
      const picture = this.hover.appendChild(document.createElement("div"));
      Object.assign(picture.style, {
        width: `${thumb.width}px`, height: `${thumb.height}px`,
        background: `url("${thumb.url}") -${thumb.x}px -${thumb.y}px`,
      });
    }
    const words = this.hover.appendChild(document.createElement("span"));
    words.textContent = `${frame}  ${sequence.timecode(frame)}${state === "done" ? "" : `  ${state}`}`;
    words.title = why;
    for (const note of this.review.notes.of(sequence).filter(({ first, last }) => first <= frame && frame <= last)) {
      const [line] = (note.text || note.drawings.find(({ text }) => text)?.text || "drawing").split("\n");
      this.hover.append(part("div", `hover-note ${note.status}`, line.length > 60 ? `${line.slice(0, 60)}…` : line));
    }
    this.hover.hidden = false;
    const half = this.hover.offsetWidth / 2, x = event.clientX - box.left;
    this.hover.style.left = `${Math.min(box.width - half - 4, Math.max(half + 4, x))}px`;
  }

  /** The sheet of small pictures of a sequence, once it is decoded. */
  sheet(sequence) {
    if (!sequence.sheet) return null;
    const url = `pictures/${sequence.sheet.file}`;
    if (!this.sheets.has(url)) {
      this.sheets.set(url, null);
      const image = new Image();
      image.src = url;
      image.decode().then(() => { this.sheets.set(url, image); this.draw(); }, () => {});
    }
    return this.sheets.get(url);
  }

  draw() {
    const dots = window.devicePixelRatio || 1, box = this.element.getBoundingClientRect();
    const width = Math.max(1, Math.round(box.width * dots)), height = Math.round((STRIP.film + STRIP.bar + STRIP.ruler) * dots);
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const context = this.canvas.getContext("2d", { alpha: false });
    context.fillStyle = "#1e1e1e";
    context.fillRect(0, 0, width, height);
    const film = STRIP.film * dots, cell = width / this.#numbers().length;
    this.#drawFilm(context, width, film);
    this.#drawStates(context, cell, film, dots);
    this.#drawRange(context, cell, film);
    this.#drawRuler(context, cell, film + STRIP.bar * dots, dots);
    this.#drawNotes(context, cell, dots);
    this.#drawHead(context, cell, film + STRIP.bar * dots, dots);
    this.#tell();
  }

  #drawFilm(context, width, film) {
    const sequence = this.review.a, sheet = this.sheet(sequence), numbers = this.#numbers();
    if (!sheet) return;
    const tile = film * (sequence.size[0] / sequence.size[1]), count = Math.max(1, Math.round(width / tile));
    const each = width / count;
    for (let i = 0; i < count; i++) {
      const from = Math.floor((i / count) * numbers.length), to = Math.ceil(((i + 1) / count) * numbers.length);
      const middle = numbers[Math.min(numbers.length - 1, (from + to) >> 1)];
      const number = [middle, ...numbers.slice(from, to)].find((each) => sequence.url(each));
      if (number === undefined) continue;
      const { x, y, width: w, height: h } = sequence.thumb(number);
      const part = Math.min(w, (h * each) / film);
      context.drawImage(sheet, x + (w - part) / 2, y, part, h, i * each, 0, each + 1, film);
    }
  }

  #drawStates(context, cell, film, dots) {
    const bar = STRIP.bar * dots;
    this.#numbers().forEach((number, i) => {
      const [state] = this.review.a.state(number), x = Math.floor(i * cell), width = Math.ceil((i + 1) * cell) - x;
      if (state === "missing" || state === "failed") {
        context.fillStyle = "rgba(24, 24, 24, 0.82)";
        context.fillRect(x, 0, width, film);
      }
      context.fillStyle = STATE_INKS[state] ?? (this.review.isCached(number) ? "#8c8c8c" : "#3c3c3c");
      const inset = state === "done" ? 0.5 * bar : 0;
      context.fillRect(x, film + inset, cell > 4 ? width - 1 : width, bar - inset);
    });
  }

  /** Lines over the frames of notes in the colours of their statuses, and ends where they begin. */
  #drawNotes(context, cell, dots) {
    const numbers = this.#numbers(), ends = [];
    for (const note of this.review.notes.of(this.review.a)) {
      const from = numbers.findIndex((number) => number >= note.first), to = numbers.findLastIndex((number) => number <= note.last);
      if (from < 0 || to < from) continue;
      const free = ends.findIndex((end) => end < from), lane = Math.min(NOTE_LANES - 1, free < 0 ? ends.length : free);
      ends[lane] = Math.max(to, ends[lane] ?? 0);
      const x = from * cell, y = (2 + 7 * lane) * dots, width = Math.max(5 * dots, (to - from + 1) * cell - dots);
      context.fillStyle = "rgba(0, 0, 0, 0.6)";
      context.fillRect(x - dots, y - dots, width + 2 * dots, 7 * dots);
      context.fillStyle = STATUS_INKS[note.status];
      context.fillRect(x, y + dots, width, 3 * dots);
      context.fillRect(x, y, 3 * dots, 5 * dots);
    }
  }

  #drawRange(context, cell, film) {
    const { transport } = this.review, numbers = this.#numbers();
    if (!transport.isLooped) return;
    const from = numbers.indexOf(transport.inPoint) * cell, to = (numbers.indexOf(transport.outPoint) + 1) * cell;
    context.fillStyle = "rgba(20, 20, 20, 0.72)";
    context.fillRect(0, 0, from, film);
    context.fillRect(to, 0, this.canvas.width - to, film);
    context.fillStyle = "#f0f0f0";
    for (const [x, way] of [[from, 1], [to, -1]]) {
      context.fillRect(Math.round(x) - (way > 0 ? 0 : 2), 0, 2, film);
      context.fillRect(way > 0 ? x : x - 7, 0, 7, 2);
      context.fillRect(way > 0 ? x : x - 7, film - 2, 7, 2);
    }
  }

  #drawRuler(context, cell, top, dots) {
    const numbers = this.#numbers(), steps = [1, 2, 5, 10, 12, 24, 48, 100, 250, 500, 1000, 5000];
    const step = steps.find((s) => s * cell > 52 * dots) ?? 10000;
    context.font = `${11 * dots}px system-ui, sans-serif`;
    context.textBaseline = "top";
    context.textAlign = "center";
    numbers.forEach((number, i) => {
      const x = (i + 0.5) * cell;
      if (i && (number % step || i < 0.6 * step)) return;
      context.fillStyle = "#5a5a5a";
      context.fillRect(Math.round(x), top, 1, 3 * dots);
      context.fillStyle = "#9d9d9d";
      const label = String(number), half = context.measureText(label).width / 2 + 2;
      context.fillText(label, Math.max(half, Math.min(this.canvas.width - half, x)), top + 4.5 * dots);
    });
  }

  #drawHead(context, cell, bottom, dots) {
    const i = this.#numbers().indexOf(this.review.transport.frame);
    const x = Math.round(i * cell), width = Math.max(2 * dots, Math.round((i + 1) * cell) - x);
    if (width < 30 * dots) {
      context.fillStyle = "rgba(255, 255, 255, 0.16)";
      context.fillRect(x, 0, width, bottom);
    }
    context.strokeStyle = "rgba(0, 0, 0, 0.7)";
    context.lineWidth = 3 * dots;
    context.strokeRect(x, dots, width, bottom - 2 * dots);
    context.strokeStyle = "#ffffff";
    context.lineWidth = 1.5 * dots;
    context.strokeRect(x, dots, width, bottom - 2 * dots);
  }

  #tell() {
    const { transport, a } = this.review, [state] = a.state(transport.frame);
    const facts = { valuemin: transport.first, valuemax: transport.last, valuenow: transport.frame };
    for (const [name, value] of Object.entries(facts)) this.element.setAttribute(`aria-${name}`, value);
    const count = this.review.notes.of(a).filter(({ first, last }) => first <= transport.frame && transport.frame <= last).length;
    const words = (state === "done" ? "" : `, ${state}`) + (count ? `, ${count} ${count === 1 ? "note" : "notes"}` : "");
    this.element.setAttribute("aria-valuetext", `frame ${transport.frame} of ${transport.last}${words}`);
  }
}
