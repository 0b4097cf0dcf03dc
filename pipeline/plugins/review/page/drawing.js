// Drawing over the picture: which tool, which ink, and what the pointer does.

const TOOLS = { pen: ["Pen", "3"], arrow: ["Arrow", "4"], rectangle: ["Rectangle", "5"], text: ["Text", "6"] };
const INKS = { "#ffb000": "amber", "#ff5a4d": "red", "#5ac8fa": "blue", "#7bd88f": "green", "#ffffff": "white" };
const WIDTHS = [12, 24, 48, 96];
const NEAREST = 12;  // units between two points of a line

class Drawing {
  constructor(element, review) {
    Object.assign(this, { element, review, isOn: false, tool: "pen", ink: Object.keys(INKS)[0], width: 24, unfinished: null });
    this.buttons = {};
    this.#build();
  }

  toggle(isOn = !this.isOn) {
    if (isOn && this.review.mode === "grid") this.review.setMode("a");
    this.isOn = isOn;
    this.#endWords();
    if (isOn) this.review.transport.pause();
    this.review.redraw();
  }

  setTool(tool) {
    this.tool = tool;
    this.toggle(true);
  }

  nextInk() { this.#setInk(Object.keys(INKS)[(Object.keys(INKS).indexOf(this.ink) + 1) % Object.keys(INKS).length]); }

  changeWidth(steps) {
    this.width = WIDTHS[clamp(WIDTHS.indexOf(this.width) + steps, 0, WIDTHS.length - 1)];
    this.review.redraw();
  }

  /** Erase what the chosen note, or the note of this frame, has on this frame. */
  erase() {
    const { review } = this, { frame } = review.transport;
    const note = this.#noteOf(review.shownSequence, frame);
    if (!note?.drawings.some((stroke) => stroke.frame === frame)) return;
    review.notes.editUndoably(note.id, { drawings: note.drawings.filter((stroke) => stroke.frame !== frame) });
    tell(`The drawing of frame ${frame} is erased; U brings it back.`);
  }

  // The pointer: points are in pixels of the stage

  down(point) {
    const part = this.review.ink.at(point);
    if (!part) return;
    const { tool: kind, ink, width } = this, frame = this.review.transport.frame;
    const [x, y] = this.#units(point, part.place);
    const stroke = { frame, kind, ink, width, points: [x, y], text: "" };
    this.#endWords();
    if (kind === "text") this.#askWords(part, stroke, point);
    else this.unfinished = { ...part, stroke: kind === "pen" ? stroke : { ...stroke, points: [x, y, x, y] } };
    this.review.ink.draw();
  }

  move(point) {
    if (!this.unfinished) return;
    const { stroke, place } = this.unfinished, { points } = stroke, [x, y] = this.#units(point, place);
    if (stroke.kind !== "pen") points.splice(2, 2, x, y);
    else if (Math.hypot(x - points.at(-2), y - points.at(-1)) >= NEAREST && points.length < 20000) points.push(x, y);
    this.review.ink.draw();
  }

  up() {
    if (!this.unfinished) return;
    const { stroke, sequence } = this.unfinished, [x, y, toX, toY] = stroke.points;
    this.unfinished = null;
    if (stroke.kind === "pen" || Math.hypot(toX - x, toY - y) >= NEAREST) this.#add(sequence, stroke);
    else this.review.ink.draw();
  }

  #units(point, place) {
    const unit = UNITS / place.width, within = (value) => Math.round(clamp(value, -1e5, 1e5));
    return [within((point.x - place.x) * unit), within((point.y - place.y) * unit)];
  }

  /** The note that a stroke is added to: the chosen one, or the latest drawn or written on this frame. */
  #noteOf(sequence, frame) {
    const mine = this.review.notes.of(sequence).filter((note) => note.first <= frame && frame <= note.last);
    return mine.find((note) => note.id === this.review.chosenNote) ?? mine.findLast((note) => note.author === this.review.notes.author);
  }

  #add(sequence, stroke) {
    const { notes } = this.review, note = this.#noteOf(sequence, stroke.frame);
    if (note) {
      notes.editUndoably(note.id, { drawings: [...note.drawings, stroke] });
    } else {
      const id = notes.add(sequence, stroke.frame, stroke.frame);
      this.review.chosenNote = id;
      notes.editUndoably(id, { drawings: [stroke] });
    }
  }

  /** Ask for the words of a text where it will stand. */
  #askWords({ sequence, place }, stroke, point) {
    const field = make("input", { type: "text", className: "ink-words", maxLength: 400, ariaLabel: "Words on the picture" }), dots = dotsOf();
    Object.assign(field.style, {
      left: `${point.x / dots}px`, top: `${point.y / dots}px`, color: stroke.ink,
      fontSize: `${Math.max(9, (6 * stroke.width * place.width) / UNITS / dots)}px`,
    });
    field.addEventListener("keydown", (event) => {
      if (event.key === "Escape") field.value = "";
      if (["Escape", "Enter"].includes(event.key)) this.#endWords();
    });
    field.addEventListener("blur", () => this.#endWords());
    this.words = { field, sequence, stroke };
    id("viewer").append(field);
    setTimeout(() => field.focus());  // after the click, which takes the focus
  }

  #endWords() {
    if (!this.words) return;
    const { field, sequence, stroke } = this.words, text = printed(field.value);
    this.words = null;
    field.remove();
    if (text) this.#add(sequence, { ...stroke, text });
  }

  // Its bar

  #build() {
    const { review } = this, gap = () => make("i");
    const tools = Object.entries(TOOLS).map(([name, [words, key]]) => (this.buttons[name] = iconButton(name, `${words} (${key})`, () => this.setTool(name))));
    const inks = Object.entries(INKS).map(([ink, name]) => {
      const button = iconButton("dot", `Ink ${name} (Shift I: the next)`, () => this.#setInk(ink));
      button.classList.add("ink");
      button.style.color = ink;
      return (this.buttons[ink] = button);
    });
    this.thinner = iconButton("thinner", "Thinner ({)", () => this.changeWidth(-1));
    this.thicker = iconButton("thicker", "Thicker (})", () => this.changeWidth(1));
    this.undo = iconButton("undo", "Undo (U)", () => review.notes.undo());
    this.redo = iconButton("redo", "Redo (Shift U)", () => review.notes.redo());
    this.onion = iconButton("onion", "Onion skin: drawings of the frames before and after (Y)", () => review.toggleOnion());
    const erase = iconButton("erase", "Erase this frame's drawing (Backspace)", () => this.erase());
    const close = iconButton("close", "End drawing (B or Esc)", () => this.toggle(false));
    this.element.append(...tools, gap(), ...inks, gap(), this.thinner, this.thicker, gap(), this.undo, this.redo, erase, this.onion, gap(), close);
  }

  #setInk(ink) {
    this.ink = ink;
    this.review.redraw();
  }

  draw() {
    this.element.hidden = !this.isOn;
    if (!this.isOn) return;
    for (const [name, button] of Object.entries(this.buttons)) button.ariaPressed = [this.tool, this.ink].includes(name);
    this.onion.ariaPressed = this.review.ink.showsOnion;
    this.thinner.disabled = this.width === WIDTHS[0];
    this.thicker.disabled = this.width === WIDTHS.at(-1);
    this.undo.disabled = !this.review.notes.done.length;
    this.redo.disabled = !this.review.notes.undone.length;
  }
}

/** Text as a note may have it: without control characters. */
const printed = (text) => text.replace(/\r\n?/g, "\n").replace(/[\x00-\x08\x0b-\x1f\x7f-\x9f]|\p{Surrogate}/gu, "").trim().slice(0, 20000);
