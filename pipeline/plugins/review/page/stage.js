// The picture: one sequence, or two against each other, drawn into a canvas at the pixels of the display; and what the
// pointer does to it.

const GAINS = [1, 2, 4, 8, 16];
const GREYS = { ground: "#232323", line: "#3a3a3a", quiet: "#a3a3a3", ink: "#ededed" };

class Stage {
  constructor(canvas, review) {
    Object.assign(this, { canvas, review, context: canvas.getContext("2d"), scratch: make("canvas") });
    Object.assign(this, { gain: 4, wipe: 0.5 });
    this.zoom = null;  // pixels of the display to a pixel of the picture; null: as large as fits
    this.pan = { x: 0, y: 0 };  // of the picture's middle from the stage's, in pixels of the display
  }

  get a() { return this.review.a; }
  get b() { return this.review.b; }
  get mode() { return this.review.mode; }
  get frame() { return this.review.transport.frame; }

  /** The frame that is mixed with it, and its weight; or null. */
  get beginning() { return this.review.transport.beginningWith(this.frame); }

  get needsB() { return !["a", "grid"].includes(this.mode); }

  resize() {
    const box = this.canvas.parentElement.getBoundingClientRect(), dots = devicePixelRatio;
    const width = Math.max(1, Math.round(box.width * dots)), height = Math.max(1, Math.round(box.height * dots));
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
  }

  /** Display pixels to a picture's pixel. */
  get scale() { return this.zoom ?? this.fitting; }

  get fitting() {
    const [width, height] = this.a.size, margin = 0.985;
    const room = this.mode === "side" ? this.canvas.width / 2 : this.canvas.width;
    return margin * Math.min(room / width, this.canvas.height / height);
  }

  /** Where the picture lies in the canvas; with two of them side by side, one for each. */
  places() {
    const { width, height } = this.canvas, [w, h] = this.a.size;
    const size = { width: w * this.scale, height: h * this.scale };
    const middles = this.mode === "side" ? [0.25 * width, 0.75 * width] : [0.5 * width];
    const y = Math.round(height / 2 + this.pan.y - size.height / 2);
    return middles.map((x) => ({ x: Math.round(x + this.pan.x - size.width / 2), y, ...size }));
  }

  /** Zoom about a point of the canvas, which stays where it is. */
  zoomTo(zoom, at = { x: this.canvas.width / 2, y: this.canvas.height / 2 }) {
    const old = this.scale, place = this.places().find((p, i, all) => i === all.length - 1 || at.x < this.canvas.width / 2);
    const middle = { x: place.x + place.width / 2, y: place.y + place.height / 2 };
    this.zoom = clamp(zoom, 0.05, 64);
    const ratio = this.zoom / old;
    this.pan.x += (1 - ratio) * (at.x - middle.x);
    this.pan.y += (1 - ratio) * (at.y - middle.y);
  }

  fit() {
    this.zoom = null;
    this.pan = { x: 0, y: 0 };
  }

  /** Which sequence's picture lies where, and between which columns it is seen; none under the grid. */
  get parts() {
    const { mode, canvas: { width: to }, a, b } = this, [one, other = one] = this.places();
    if (mode === "grid") return [];
    if (mode !== "side" && mode !== "wipe") return [{ sequence: mode === "b" ? b : a, place: one, from: 0, to }];
    const { edge } = this;
    return [{ sequence: a, place: one, from: 0, to: edge }, { sequence: b, place: other, from: edge, to }];
  }

  /** The part of the stage at a point. */
  partAt({ x }) { return this.parts.find(({ from, to }) => x >= from && x < to); }

  /** Call `draw(sequence, place)` for each part of the stage, within its columns of a canvas as large. */
  drawParts(context, draw) {
    for (const { sequence, place, from, to } of this.parts) {
      const columns = { x: from, y: 0, width: to - from, height: this.canvas.height };
      drawWithin(context, columns, () => draw(sequence, place));
    }
  }

  draw() {
    const { context, canvas, mode } = this;
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.imageSmoothingEnabled = this.scale < 2;
    context.imageSmoothingQuality = "high";
    if (mode === "difference") return this.#difference(this.places()[0]);
    this.drawParts(context, (...part) => this.#picture(...part));
  }

  /** Where the edge between A and B is, in pixels of the canvas; null where one picture is shown. */
  get edge() {
    if (this.mode === "side") return this.canvas.width / 2;
    const [{ x, width }] = this.places();
    return this.mode === "wipe" ? Math.round(x + this.wipe * width) : null;
  }

  /** |A - B| as displayed, made brighter by doubling; of pictures of two sizes, at that of A. */
  #difference(place) {
    const [width, height] = this.a.size, pictures = [this.a, this.b].map((each) => this.#bitmap(each));
    if (pictures.includes(null)) return this.#picture(pictures[0] ? this.b : this.a, place);
    Object.assign(this.scratch, { width, height });
    const scratch = this.scratch.getContext("2d", { alpha: false });
    scratch.drawImage(pictures[0], 0, 0, width, height);
    scratch.globalCompositeOperation = "difference";
    scratch.drawImage(pictures[1], 0, 0, width, height);
    scratch.globalCompositeOperation = "lighter";
    for (let gain = 1; gain < this.gain; gain *= 2) scratch.drawImage(this.scratch, 0, 0);
    scratch.globalCompositeOperation = "source-over";
    return this.context.drawImage(this.scratch, place.x, place.y, place.width, place.height);
  }

  #bitmap(sequence, frame = this.frame) {
    const url = sequence.url(frame);
    return this.review.viewing.source(sequence, frame) ?? (url === null ? null : this.review.cache.get(url));
  }

  /** What stands for a picture that is still being read: its small one, where the sheet has it. */
  #drawThumb(sequence, place) {
    const sheet = this.review.cache.get(sequence.sheetUrl), thumb = sequence.thumb(this.frame);
    this.context.fillStyle = GREYS.ground;
    this.context.fillRect(place.x, place.y, place.width, place.height);
    if (!sheet || thumb?.number !== this.frame) return;
    this.context.imageSmoothingEnabled = true;
    this.context.drawImage(sheet, thumb.x, thumb.y, thumb.width, thumb.height, place.x, place.y, place.width, place.height);
  }

  #picture(sequence, place) {
    const { context, frame } = this, { x, y, width, height } = place, bitmap = this.#bitmap(sequence);
    if (bitmap) {
      context.drawImage(bitmap, x, y, width, height);
      const [first, weight] = this.beginning ?? [], other = first === undefined ? null : this.#bitmap(sequence, first);
      if (!other) return;
      context.globalAlpha = weight;
      context.drawImage(other, x, y, width, height);
      context.globalAlpha = 1;
      return;
    }
    const url = sequence.url(frame), isBroken = this.review.cache.isBroken(url);
    const [state, why] = isBroken ? ["missing", "its picture cannot be read; write the page again"] : sequence.state(frame);
    if (url !== null && !isBroken) this.#drawThumb(sequence, place);
    else drawWithin(context, place, () => drawSlate(context, place, `frame ${frame} ${state}`, why));
  }
}

/** Draw only within a rectangle of a canvas. */
function drawWithin(context, { x, y, width, height }, draw) {
  context.save();
  context.beginPath();
  context.rect(x, y, width, height);
  context.clip();
  draw();
  context.restore();
}

/** Draw what stands in the place of a picture that is not there: `title` large, `note` below it. */
function drawSlate(context, { x, y, width, height }, title, note) {
  const size = Math.max(11, Math.min(height / 11, width / 16)), middle = x + width / 2;
  const big = `600 ${size}px system-ui, sans-serif`, small = `${size * 0.52}px system-ui, sans-serif`;
  const wideness = (text, font) => Object.assign(context, { font }).measureText(text).width;
  const lines = wrapped(note, (text) => wideness(text, small) < 0.8 * width).slice(0, 4);
  const wide = Math.max(wideness(title, big), ...lines.map((line) => wideness(line, small))) + 2 * size;
  const tall = size * (1.9 + 0.85 * lines.length), top = y + (height - tall) / 2;
  Object.assign(context, { fillStyle: GREYS.ground, strokeStyle: GREYS.line, lineWidth: Math.max(1, height / 360) });
  context.fillRect(x, y, width, height);
  context.stroke(new Path2D(`M${x} ${y}l${width} ${height}M${x + width} ${y}l${-width} ${height}`));
  context.fillRect(middle - wide / 2, top, wide, tall);
  Object.assign(context, { textAlign: "center", textBaseline: "alphabetic", fillStyle: GREYS.ink, font: big });
  context.fillText(title, middle, top + 1.25 * size);
  Object.assign(context, { fillStyle: GREYS.quiet, font: small });
  lines.forEach((line, i) => context.fillText(line, middle, top + (2.15 + 0.8 * i) * size));
}

/** Text in lines that fit. */
function wrapped(text, fits) {
  const lines = [];
  for (const word of text.split(/\s+/).filter(Boolean)) {
    const longer = lines.length ? `${lines.at(-1)} ${word}` : word;
    if (lines.length && fits(longer)) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}

const WIPE_REACH = 12; // CSS pixels around the edge where it is taken hold of

function stagePointer(stage, drawing, changed) {
  const { canvas } = stage;
  const at = (event) => ({ x: event.offsetX * devicePixelRatio, y: event.offsetY * devicePixelRatio }); // in pixels of the display
  const isAtWipe = (event) => stage.mode === "wipe" && Math.abs(event.offsetX - stage.edge / devicePixelRatio) < WIPE_REACH;
  let drawsWipe;
  const pan = (dx, dy) => {
    if (stage.zoom === null) stage.zoomTo(stage.fitting);
    stage.pan = { x: stage.pan.x + dx * devicePixelRatio, y: stage.pan.y + dy * devicePixelRatio };
    changed();
  };
  const setWipe = (event) => {
    const [place] = stage.places();
    stage.wipe = clamp((at(event).x - place.x) / place.width, 0, 1);
    changed();
  };
  gestures(canvas, {
    start: (event) => {
      drawsWipe = isAtWipe(event);
      if (drawing.isOn) drawing.down(at(event));
    },
    move: (event, begun, dx, dy) => {
      if (drawing.isOn) drawing.move(at(event));
      else if (drawsWipe) setWipe(event);
      else pan(dx, dy);
    },
    over: () => drawing.up(),
    pan,
    zoom: (factor, event) => {
      stage.zoomTo(stage.scale / factor, at(event));
      changed();
    },
    hover: (event) => { canvas.style.cursor = drawing.isOn ? "crosshair" : isAtWipe(event) ? "ew-resize" : "grab"; },
  });
  canvas.addEventListener("dblclick", () => { stage.fit(); changed(); });
}

const NARROWEST = 300, PANEL = 372, KEY_STEP = 24;

/** The edge between the picture and the panel is dragged, or moved by arrow keys; a double click resets it. */
function splitterOf(element, panel) {
  const page = document.documentElement, most = () => Math.max(NARROWEST, page.clientWidth - 320);
  const set = (width) => {
    const chosen = Math.round(clamp(width, NARROWEST, most()));
    panel.style.width = `${chosen}px`;
    give(element, { ariaValueNow: chosen, ariaValueMin: NARROWEST, ariaValueMax: most() });
  };
  gestures(element, { move: (event) => set(page.clientWidth - event.clientX) });
  element.addEventListener("dblclick", () => set(PANEL));
  arrowKeys(element, (right) => set(panel.offsetWidth - right * KEY_STEP));
  set(PANEL);
}
