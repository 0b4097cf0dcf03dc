// The probe: values of the pixel under the pointer, of A, B and their difference; and the loupe.

const LOUPE = { size: 168, zoom: 8 };

class Probe {
  constructor(element, review, viewing) {
    Object.assign(this, { element, review, viewing, isOn: false, hasLoupe: false, at: null });
    this.loupe = id("loupe");
    review.stage.canvas.addEventListener("pointermove", (event) => this.#moved(event));
    review.stage.canvas.addEventListener("pointerleave", () => { this.loupe.hidden = true; });
  }

  #moved(event) {
    const dots = devicePixelRatio;
    this.at = { x: event.offsetX * dots, y: event.offsetY * dots, left: event.offsetX, top: event.offsetY };
    if (this.isOn || this.hasLoupe) this.draw();
  }

  draw() {
    this.element.hidden = !this.isOn;
    if (this.isOn) this.#drawValues();
    this.loupe.hidden = !this.hasLoupe || !this.at;
    if (!this.loupe.hidden) this.#drawLoupe();
  }

  /** The pixel of A under the pointer: shares of its width and height, or null. */
  #pixel() {
    const part = this.at && this.review.stage.partAt(this.at);
    if (!part) return null;
    const x = (this.at.x - part.place.x) / part.place.width, y = (this.at.y - part.place.y) / part.place.height;
    return x >= 0 && x < 1 && y >= 0 && y < 1 ? { x, y } : null;
  }

  #drawValues() {
    const { review, viewing } = this, pixel = this.#pixel(), { frame } = review.transport;
    if (!pixel) return this.element.replaceChildren(make("p", "note", "Point at the picture."));
    const [width, height] = review.a.size, place = make("p", "note", `Pixel ${Math.floor(pixel.x * width)}, ${Math.floor(pixel.y * height)}`);
    const sides = Object.entries(review.a === review.b ? { A: review.a } : { A: review.a, B: review.b });
    const layers = sides.map(([, sequence]) => sequence.layers[sequence.among(frame)]), linear = viewing.layer === LAYER_OF_PICTURE ? "beauty" : viewing.layer;
    if (!layers.some(Boolean)) return this.element.replaceChildren(place, make("p", "note", viewing.without(review.a, review.a.among(frame))));
    const shown = [["Display", LAYER_OF_PICTURE, 0], [linear, linear, 4]];
    if (linear !== LAYER_OF_HDR && layers.some((each) => each?.[LAYER_OF_HDR])) shown.push(["HDR, nits", LAYER_OF_HDR, 1]);
    return this.element.replaceChildren(place, ...shown.map(([words, layer, digits]) => {
      const rows = sides.map(([side, sequence]) => [side, this.#values(sequence, frame, layer, pixel)]), [a, b] = rows.map(([, values]) => values);
      if (rows.length > 1) rows.push(["A − B", a && b ? a.map((value, k) => value - b[k]) : null]);
      return this.#table(words, rows, digits);
    }));
  }

  #values(sequence, frame, name, pixel) {
    const layer = this.viewing.layerOf(sequence, sequence.among(frame), name);
    return layer && layer.at(Math.floor(pixel.x * layer.width), Math.floor(pixel.y * layer.height));
  }

  #table(words, rows, digits) {
    const written = (value) => value.toFixed(digits).replace("-", "−");
    const lines = rows.map(([name, values]) => rowOf(name, values ? values.map(written) : ["no layers here"]));
    return make("table", {}, make("caption", {}, words), make("tbody", {}, ...lines));
  }

  /** The stage around the pointer, larger; its middle is framed. */
  #drawLoupe() {
    const dots = devicePixelRatio, side = LOUPE.size * dots, part = side / LOUPE.zoom;
    Object.assign(this.loupe, { width: side, height: side });
    Object.assign(this.loupe.style, { left: `${this.at.left + 22}px`, top: `${this.at.top + 22}px` });
    const context = this.loupe.getContext("2d"), { x, y } = this.at;
    context.imageSmoothingEnabled = false;
    for (const canvas of [this.review.stage.canvas, this.review.ink.canvas]) {
      context.drawImage(canvas, Math.round(x - part / 2), Math.round(y - part / 2), part, part, 0, 0, side, side);
    }
    for (const [ink, inset] of [["#000000", 0], ["#ffffff", 1]]) {
      context.strokeStyle = ink;
      context.strokeRect(side / 2 - inset, side / 2 - inset, LOUPE.zoom + 2 * inset, LOUPE.zoom + 2 * inset);
    }
  }
}
