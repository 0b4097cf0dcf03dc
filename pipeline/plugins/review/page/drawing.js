// Drawings of notes over the picture: vectors in ten-thousandths of its width, drawn at any size; and how they are drawn.

const UNITS = 10000;
const GHOSTS = [[-1, 0.34], [1, 0.2]];  // onion skin: the drawn frame before, and the one after
const RIGHT_TO_LEFT = /[\p{Script=Arabic}\p{Script=Hebrew}\p{Script=Syriac}\p{Script=Thaana}\p{Script=Nko}\p{Script=Adlam}]/u;

class InkLayer {
  constructor(canvas, review) {
    Object.assign(this, { canvas, review, context: canvas.getContext("2d"), showsOnion: false, isVisible: true });
  }

  draw() {
    const { canvas, context, review } = this, { width, height } = review.stage.canvas;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    else context.clearRect(0, 0, width, height);
    if (!this.isVisible) return;
    review.stage.drawParts(context, (sequence, place) => {
      this.drawOver(context, sequence, place, review.transport.frame);
      const { unfinished } = review.drawing;
      if (unfinished?.sequence === sequence) drawStroke(context, unfinished.stroke, place);
    });
  }

  /** Draw the strokes of a frame, and with onion skin those of the drawn frames around it, faintly. */
  drawOver(context, sequence, place, frame) {
    const strokes = this.review.notes.of(sequence).flatMap((note) => note.drawings);
    if (this.showsOnion) {
      const drawn = [...new Set(strokes.map((stroke) => stroke.frame))].sort((one, other) => one - other);
      for (const [way, alpha] of GHOSTS) {
        const near = way < 0 ? drawn.findLast((each) => each < frame) : drawn.find((each) => each > frame);
        context.globalAlpha = alpha;
        for (const stroke of strokes) if (stroke.frame === near) drawStroke(context, stroke, place);
      }
      context.globalAlpha = 1;
    }
    for (const stroke of strokes) if (stroke.frame === frame) drawStroke(context, stroke, place);
  }
}

/** Draw one stroke over a picture that lies at `place`, with a dark edge so that it is seen on any ground. */
function drawStroke(context, stroke, place) {
  const unit = place.width / UNITS, { kind, points } = stroke;
  const at = (i) => [place.x + points[i] * unit, place.y + points[i + 1] * unit];
  const width = Math.max(1, stroke.width * unit);
  context.save();
  Object.assign(context, { lineJoin: "round", lineCap: "round", shadowColor: "rgba(0, 0, 0, 0.75)", shadowBlur: Math.max(2, 0.6 * width) });
  Object.assign(context, { strokeStyle: stroke.ink, fillStyle: stroke.ink, lineWidth: width });
  if (kind === "text") drawWords(context, stroke, at(0), 6 * width);
  else context.stroke(new Path2D(pathOf(stroke, at, width)));
  context.restore();
}

/** The path of a stroke, as SVG has paths; `at(i)` is the point whose numbers begin at i. */
function pathOf({ kind, points: { length } }, at, width) {
  const [x, y] = at(0), [toX, toY] = at(length - 2), line = `L${toX} ${toY}`;
  if (kind === "rectangle") return `M${x} ${y}H${toX}V${toY}H${x}Z`;
  if (kind === "arrow") {
    const angle = Math.atan2(toY - y, toX - x), head = Math.min(4.5 * width, 0.6 * Math.hypot(toX - x, toY - y));
    const side = (turn) => `M${toX - head * Math.cos(angle + turn)} ${toY - head * Math.sin(angle + turn)}${line}`;
    return `M${x} ${y}${line}${side(-0.5)}${side(0.5)}`;
  }
  let path = `M${x} ${y}`; // a smooth line: curves between the middles of its points; of one point a dot
  for (let i = 2; i < length - 2; i += 2) {
    const [bendX, bendY] = at(i), [nextX, nextY] = at(i + 2);
    path += `Q${bendX} ${bendY} ${(bendX + nextX) / 2} ${(bendY + nextY) / 2}`;
  }
  return path + line;
}

function drawWords(context, stroke, [x, y], size) {
  Object.assign(context, { font: `600 ${size}px system-ui, sans-serif`, textBaseline: "top", textAlign: "left" });
  stroke.text.split("\n").forEach((line, i) => {
    context.direction = RIGHT_TO_LEFT.test(line.match(/\p{L}/u)?.[0] ?? "") ? "rtl" : "ltr";
    context.fillText(line, x, y + 1.25 * size * i);
  });
}

const TOOLS = { pen: ["Pen", "3"], arrow: ["Arrow", "4"], rectangle: ["Rectangle", "5"], text: ["Text", "6"] };
const INKS = { "#ffb000": "amber", "#ff5a4d": "red", "#5ac8fa": "blue", "#7bd88f": "green", "#ffffff": "white" };
const WIDTHS = [12, 24, 48, 96];
const NEAREST = 12;  // units between two points of a line

class Drawing {
  constructor(element, review) {
    Object.assign(this, { element, review, isOn: false, tool: "pen", ink: Object.keys(INKS)[0], width: 24, unfinished: null });
    this.#build();
  }

  toggle(isOn = !this.isOn) {
    if (isOn && this.review.mode === "grid") this.review.setMode("a");
    this.#endWords();
    if (isOn) this.review.transport.pause();
    this.review.change(this, { isOn });
  }

  setTool(tool) {
    this.tool = tool;
    this.toggle(true);
  }

  nextInk() { this.review.change(this, { ink: nextOf(Object.keys(INKS), this.ink) }); }

  changeWidth(steps) { this.review.change(this, { width: WIDTHS[clamp(WIDTHS.indexOf(this.width) + steps, 0, WIDTHS.length - 1)] }); }

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
    const part = this.review.stage.partAt(point);
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
    const id = note?.id ?? notes.add(sequence, stroke.frame, stroke.frame);
    if (!note) this.review.chosenNote = id;
    notes.editUndoably(id, { drawings: [...notes.get(id).drawings, stroke] });
  }

  /** Ask for the words of a text where it will stand. */
  #askWords({ sequence, place }, stroke, point) {
    const field = make("input", { type: "text", className: "ink-words", maxLength: 400, ariaLabel: "Words on the picture" }), dots = devicePixelRatio;
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

  #build() {
    const { review } = this, { notes } = review, gap = () => make("i");
    const tools = Object.entries(TOOLS).map(([tool, [words, key]]) => (
      iconButton(tool, `${words} (${key})`, () => this.setTool(tool), { ariaPressed: () => this.tool === tool })
    ));
    const inks = Object.entries(INKS).map(([ink, name]) => (
      iconButton("dot", `Ink ${name} (Shift I: the next)`, () => review.change(this, { ink }), { className: "icon plain ink", style: `color: ${ink}`, ariaPressed: () => this.ink === ink })
    ));
    give(this.element, { hidden: () => !this.isOn }).append(
      ...tools, gap(), ...inks, gap(),
      iconButton("thinner", "Thinner ({)", () => this.changeWidth(-1), { disabled: () => this.width === WIDTHS[0] }),
      iconButton("thicker", "Thicker (})", () => this.changeWidth(1), { disabled: () => this.width === WIDTHS.at(-1) }), gap(),
      iconButton("undo", "Undo (U)", () => notes.undo(), { disabled: () => !notes.done.length }),
      iconButton("redo", "Redo (Shift U)", () => notes.redo(), { disabled: () => !notes.undone.length }),
      iconButton("erase", "Erase this frame's drawing (Backspace)", () => this.erase()),
      iconButton("onion", "Onion skin: drawings of the frames before and after (Y)", () => review.toggle(review.ink, "showsOnion"), { ariaPressed: () => review.ink.showsOnion }), gap(),
      iconButton("close", "End drawing (B or Esc)", () => this.toggle(false)),
    );
  }
}

/** Text as a note may have it: without control characters. */
const printed = (text) => text.replace(/\r\n?/g, "\n").replace(/[\x00-\x08\x0b-\x1f\x7f-\x9f]|\p{Surrogate}/gu, "").trim().slice(0, 20000);
