// The strip of A: its frames side by side, what is wrong with them, its notes, and where time is.

const FILM = 46; // CSS pixels that the pictures are high
const NOTE_LANES = 4;

class ReviewStrip extends FrameStrip {
  constructor(element, review) {
    super(element, review.transport, {
      stateOf: (frame) => this.#state(frame),
      describe: (frame) => this.#words(frame),
      hovered: (event, frame) => this.#showHover(event, frame),
    });
    Object.assign(this, { review, film: make("div", "film"), lanes: make("div", "lanes") });
    this.hover = make("div", { className: "hover", hidden: true });
    element.prepend(this.film);
    element.append(this.lanes, this.hover);
    element.addEventListener("pointerleave", () => { this.hover.hidden = true; });
  }

  #state(frame) {
    const { a, cache } = this.review, [state] = a.state(frame);
    return state !== "done" ? state : cache.get(a.url(frame)) ? "there" : "old";
  }

  #notesAt(frame) { return this.review.notes.of(this.review.a).filter(({ first, last }) => first <= frame && frame <= last); }

  #words(frame) {
    const [state] = this.review.a.state(frame), count = this.#notesAt(frame).length;
    return [state === "done" ? "" : state, count ? `${count} ${count === 1 ? "note" : "notes"}` : ""].filter(Boolean).join(", ");
  }

  draw() {
    if (!this.review) return;
    super.draw();
    this.#drawFilm();
    this.#drawNotes();
  }

  /** Small pictures, as many as there is room for. */
  #drawFilm() {
    const { a, transport: { numbers } } = this.review, wide = this.element.clientWidth;
    const state = [a.index, numbers, wide].join();
    if (!a.sheet || this.drawn === state) return;
    this.drawn = state;
    const count = Math.max(1, Math.round(wide / (FILM * (a.size[0] / a.size[1]))));
    this.film.replaceChildren(...Array.from({ length: count }, (_, i) => {
      const from = Math.floor((i / count) * numbers.length), to = Math.ceil(((i + 1) / count) * numbers.length);
      const middle = numbers[Math.min(numbers.length - 1, (from + to) >> 1)];
      const number = [middle, ...numbers.slice(from, to)].find((each) => a.url(each));
      return number === undefined ? make("div") : this.#tile(a, number, wide / count);
    }));
  }

  /** The middle of a small picture, at the height of the film. */
  #tile(sequence, number, wide) {
    const { url, x, y, width, height } = sequence.thumb(number), scale = FILM / height, { columns } = sequence.sheet;
    const place = `${(wide - width * scale) / 2 - x * scale}px ${-y * scale}px / ${columns * width * scale}px auto`;
    return make("div", { style: `background: url("${url}") ${place}` });
  }

  /** Lines over the frames of notes in the colours of their statuses. */
  #drawNotes() {
    const { numbers } = this.transport, ends = [];
    const lines = this.review.notes.of(this.review.a).flatMap((note) => {
      const from = numbers.findIndex((number) => number >= note.first), to = numbers.findLastIndex((number) => number <= note.last);
      if (from < 0 || to < from) return [];
      const free = ends.findIndex((end) => end < from), lane = Math.min(NOTE_LANES - 1, free < 0 ? ends.length : free);
      ends[lane] = Math.max(to, ends[lane] ?? 0);
      const style = `left: ${this.left(from)}; width: ${this.left(to - from + 1)}; top: ${2 + 7 * lane}px`;
      return [make("i", { className: note.status, style })];
    });
    this.lanes.replaceChildren(...lines);
  }

  #showHover(event, frame) {
    const { a } = this.review, thumb = a.thumb(frame), box = this.element.getBoundingClientRect(), [state, why] = a.state(frame);
    const words = make("span", { textContent: `${frame}  ${a.timecode(frame)}${state === "done" ? "" : `  ${state}`}`, title: why });
    const notes = this.#notesAt(frame).map((note) => {
      const [line] = (note.text || note.drawings.find(({ text }) => text)?.text || "drawing").split("\n");
      return make("div", `hover-note ${note.status}`, line.length > 60 ? `${line.slice(0, 60)}…` : line);
    });
    this.hover.replaceChildren(words, ...notes);
    if (thumb && a.url(frame)) {
      const background = `url("${thumb.url}") -${thumb.x}px -${thumb.y}px`;
      const style = `width: ${thumb.width}px; height: ${thumb.height}px; background: ${background}`;
      this.hover.prepend(make("div", { style }));
    }
    this.hover.hidden = false;
    const half = this.hover.offsetWidth / 2;
    this.hover.style.left = `${clamp(event.clientX, half + 4, box.width - half - 4)}px`;
    this.hover.style.bottom = `${window.innerHeight - box.top + 4}px`;
  }
}
