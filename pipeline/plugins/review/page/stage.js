// The picture: one sequence, or two against each other, drawn into a canvas at the pixels of the display.

const GAINS = [1, 2, 4, 8, 16];

class Stage {
  constructor(canvas, review) {
    Object.assign(this, { canvas, review, context: canvas.getContext("2d"), scratch: make("canvas"), sheets: new Map() });
    Object.assign(this, { mode: "a", gain: 4, wipe: 0.5 });
    this.zoom = null;  // pixels of the display to a pixel of the picture; null: as large as fits
    this.pan = { x: 0, y: 0 };  // of the picture's middle from the stage's, in pixels of the display
  }

  get a() { return this.review.a; }
  get b() { return this.review.b; }
  get frame() { return this.review.transport.frame; }

  /** The frame that is mixed with it, and its weight; or null. */
  get beginning() { return this.review.transport.beginningWith(this.frame); }

  get needsB() { return this.mode !== "a"; }

  resize() {
    const box = this.canvas.parentElement.getBoundingClientRect(), dots = dotsOf();
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
    return middles.map((x) => ({
      x: Math.round(x + this.pan.x - size.width / 2),
      y: Math.round(height / 2 + this.pan.y - size.height / 2),
      ...size,
    }));
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

  draw() {
    const { context, canvas } = this;
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.imageSmoothingEnabled = this.scale < 2;
    context.imageSmoothingQuality = "high";
    const [one, other] = this.places();
    if (this.mode === "a") this.#picture(this.a, one);
    else if (this.mode === "b") this.#picture(this.b, one);
    else if (this.mode === "wipe") this.#wiped(one);
    else if (this.mode === "difference") this.#difference(one);
    else this.#sideBySide(one, other);
  }

  #sideBySide(one, other) {
    const half = this.canvas.width / 2;
    this.#within(0, half, () => this.#picture(this.a, one));
    this.#within(half, half, () => this.#picture(this.b, other));
    this.context.fillStyle = "#000";
    this.context.fillRect(half - 1, 0, 2, this.canvas.height);
  }

  /** Where the edge between A and B is, in pixels of the canvas. */
  wipeAt(place = this.places()[0]) { return Math.round(place.x + this.wipe * place.width); }

  #wiped(place) {
    const x = this.wipeAt(place), { context, canvas } = this;
    this.#within(0, x, () => this.#picture(this.a, place));
    this.#within(x, canvas.width - x, () => this.#picture(this.b, place));
    const top = Math.max(0, place.y), bottom = Math.min(canvas.height, place.y + place.height);
    context.fillStyle = "rgba(0, 0, 0, 0.55)";
    context.fillRect(x - 1, top, 3, bottom - top);
    context.fillStyle = "#f2f2f2";
    context.fillRect(x, top, 1, bottom - top);
    const dots = dotsOf(), y = (top + bottom) / 2;
    context.beginPath();
    context.arc(x + 0.5, y, 5 * dots, 0, 2 * Math.PI);
    context.fill();
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

  #within(x, width, draw) {
    this.context.save();
    this.context.beginPath();
    this.context.rect(x, 0, width, this.canvas.height);
    this.context.clip();
    draw();
    this.context.restore();
  }

  #bitmap(sequence, frame = this.frame) {
    const url = sequence.url(frame);
    return this.review.viewing.source(sequence, frame) ?? (url === null ? null : this.review.cache.get(url));
  }

  /** The sheet of small pictures of a sequence, or null while it is not there. */
  #sheet(sequence) {
    if (!sequence.sheet) return null;
    const url = `pictures/${sequence.sheet.file}`;
    if (!this.sheets.has(url)) {
      this.sheets.set(url, null);
      const image = make("img", { src: url });
      image.decode().then(() => { this.sheets.set(url, image); this.review.redraw(); }, () => {});
    }
    return this.sheets.get(url);
  }

  /** What stands for a picture that is still being read: its small one, where the sheet has it. */
  #soon(sequence, place) {
    const sheet = this.#sheet(sequence), thumb = sequence.thumb(this.frame);
    this.context.fillStyle = GREYS.ground;
    this.context.fillRect(place.x, place.y, place.width, place.height);
    if (!sheet || thumb?.number !== this.frame) return;
    const { x, y, width, height } = thumb;
    this.context.imageSmoothingEnabled = true;
    this.context.drawImage(sheet, x, y, width, height, place.x, place.y, place.width, place.height);
  }

  #picture(sequence, place) {
    const bitmap = this.#bitmap(sequence);
    if (bitmap) {
      this.context.drawImage(bitmap, place.x, place.y, place.width, place.height);
      const [frame, weight] = this.beginning ?? [], other = frame === undefined ? null : this.#bitmap(sequence, frame);
      if (!other) return;
      this.context.globalAlpha = weight;
      this.context.drawImage(other, place.x, place.y, place.width, place.height);
      this.context.globalAlpha = 1;
      return;
    }
    const url = sequence.url(this.frame), broken = url !== null && this.review.cache.isBroken(url);
    const [state, why] = broken ? ["missing", "its picture cannot be read; write the page again"] : sequence.state(this.frame);
    if (url === null || broken) drawSlate(this.context, place, `frame ${this.frame} ${state}`, why);
    else this.#soon(sequence, place);
  }
}
