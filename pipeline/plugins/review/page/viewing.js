// How pictures are looked at: which layer, exposure, gamma, channel, false colour; and saving what is seen.

const CHANNEL_NAMES = {
  rgb: ["RGB", "Shift C"], red: ["R", "Shift R"], green: ["G", "Shift G"], blue: ["B", "Shift B"], luminance: ["Y", "Shift Y"],
};
const LAYER_OF_PICTURE = "picture", LAYER_OF_HDR = "nits";

class Viewing {
  constructor(element, review) {
    Object.assign(this, { element, review, isOn: false, layer: LAYER_OF_PICTURE });
    this.grader = new Grader();
    this.layers = layerStore(() => review.redraw());
    this.probe = new Probe(id("probe"), review, this);
    this.#build();
  }

  /** Tell whether pictures are shown otherwise than their files are. */
  get isNeutral() {
    const { exposure, gamma, channel, clipping } = this.grader.settings;
    return this.layer === LAYER_OF_PICTURE && !exposure && gamma === 1 && channel === "rgb" && !clipping;
  }

  /** The canvas to show for a frame: null where the file is to be shown, or nothing is there yet. */
  source(sequence, frame) {
    if (this.isNeutral) return null;
    return this.#seen(sequence, frame);
  }

  /** The chosen layer of a frame as a canvas, or null where it or the table of its view is not there. */
  #seen(sequence, frame) {
    const layer = this.layerOf(sequence, frame, this.layer), view = layer?.view ? this.layers.get(layer.view) : null;
    return layer && (view || !layer.view) ? this.grader.graded(layer, view) : null;
  }

  /** A layer of a frame, or null while it is read, or where the page has none. */
  layerOf(sequence, frame, name) { return this.layers.get(sequence.layers[frame]?.[name]); }

  /** The names of the layers of the frame that is shown. */
  get names() { return Object.keys(this.review.shownSequence.layers[this.review.transport.frame] ?? {}).filter((name) => name !== "view"); }

  // What people ask for

  set(fields) {
    Object.assign(this.grader.settings, fields);
    this.toggle(true);
  }

  expose(stops) { this.set({ exposure: clamp(this.grader.settings.exposure + stops, -10, 10) }); }

  changeGamma(steps) { this.set({ gamma: clamp(+(this.grader.settings.gamma + 0.1 * steps).toFixed(2), 0.2, 4) }); }

  toggleClipping() { this.set({ clipping: !this.grader.settings.clipping }); }

  setLayer(name) {
    this.layer = name;
    this.toggle(true);
  }

  nextLayer() {
    const names = this.names.length ? this.names : [LAYER_OF_PICTURE];
    this.setLayer(names[(names.indexOf(this.layer) + 1) % names.length]);
  }

  /** Show alpha, or go back to the picture. */
  toggleAlpha() { this.setLayer(this.layer === "alpha" ? LAYER_OF_PICTURE : "alpha"); }

  reset() {
    Object.assign(this.grader.settings, { exposure: 0, gamma: 1, channel: "rgb", clipping: false });
    this.layer = LAYER_OF_PICTURE;
    this.review.redraw();
  }

  toggle(isOn = !this.isOn) {
    this.isOn = isOn;
    if (!isOn) this.reset();
    this.review.redraw();
  }

  /** Download the frame that is shown as PNG, in the size of its picture, with drawings or without. */
  save(withNotes) {
    const { review } = this, { transport: { frame }, shownSequence: sequence } = review;
    const file = this.isNeutral ? review.cache.get(sequence.url(frame)) : null, seen = this.#seen(sequence, frame) ?? file;
    if (!seen) return tell(this.without(sequence, frame), true);
    const [width, height] = sequence.size, canvas = make("canvas", { width, height });
    const context = canvas.getContext("2d");
    context.drawImage(seen, 0, 0, width, height);
    if (withNotes) review.ink.drawOver(context, sequence, { x: 0, y: 0, width, height }, frame);
    const name = `${sequence.shot}.${sequence.label.replace(/[^\w.-]+/g, "_")}.${String(frame).padStart(4, "0")}${withNotes ? ".notes" : ""}.png`;
    try {
      return canvas.toBlob((blob) => download(name, blob, "image/png"));
    } catch {  // a page in a folder may not read the pixels of picture files; one on a server may
      return tell(this.without(sequence, frame), true);
    }
  }

  /** What to do about a frame without layers, or with a layer that is still being read. */
  without(sequence, frame) {
    if (!this.grader.gl) return "This browser has no WebGL 2, which layers are drawn with.";
    const files = sequence.layers[frame], frames = Object.keys(sequence.layers).map(Number);
    if (files?.[this.layer] && !this.layers.isBroken(files[this.layer])) return "The layer is being read; try again.";
    if (files) return `Frame ${frame} has no layer ${this.layer}; it has ${this.names.join(", ")}.`;
    if (!frames.length) return "This page has no layers: flowsculpt review --layers 8 stores them for eight frames.";
    const nearest = frames.reduce((best, each) => (Math.abs(each - frame) < Math.abs(best - frame) ? each : best));
    return `Frame ${frame} has no layers on this page; the nearest that has is ${nearest}.`;
  }

  // Its bar

  #build() {
    const { review } = this;
    this.list = listOf("Layer", [], (name) => this.setLayer(name));
    this.channels = Object.entries(CHANNEL_NAMES).map(([channel, [words, key]]) => (
      buttonOf(words, `${channel === "rgb" ? "All channels" : `Only ${channel}`} (${key})`, () => this.set({ channel }), { channel })
    ));
    this.exposure = this.#slider("Exposure", "Stops (Page Up, Page Down)", -6, 6, 0.25, (exposure) => this.set({ exposure }));
    this.gamma = this.#slider("Gamma", "Gamma (Shift Page Up, Page Down)", 0.2, 3, 0.1, (gamma) => this.set({ gamma }));
    this.clipping = buttonOf("Clipping", "Red where white, blue where black, magenta where no number (Shift K)", () => this.toggleClipping());
    this.probing = buttonOf("Probe", "Values under the pointer (Shift P)", () => this.probe.toggle());
    this.words = make("p", "viewing-words");
    const save = buttonOf("Save", "Save this frame as PNG, with drawings (Shift S), without (Shift W)", () => this.save(true));
    const reset = buttonOf("Reset", "Show pictures as they are (0)", () => this.reset());
    this.element.append(this.list, segments("Channel", this.channels), this.exposure.label, this.gamma.label, this.clipping, this.probing, save, reset, this.words);
  }

  #slider(words, title, low, high, step, act) {
    const field = sliderOf(words, low, high, step, act, { title }), value = make("output");
    return { field, value, label: make("label", "inline", words, field, value) };
  }

  draw() {
    const { settings } = this.grader, { review } = this, frame = review.transport.frame;
    id("viewing-button").ariaPressed = this.isOn;
    this.element.hidden = !this.isOn;
    this.probe.draw();
    if (!this.isOn) return;
    const names = [...new Set([LAYER_OF_PICTURE, ...this.names, this.layer])];
    if (names.join() !== this.listed) this.list.replaceChildren(...names.map((name) => new Option(name, name)));
    this.listed = names.join();
    this.list.value = this.layer;
    for (const button of this.channels) button.ariaPressed = settings.channel === button.channel;
    this.exposure.field.value = settings.exposure;
    this.exposure.value.textContent = `${settings.exposure < 0 ? "−" : "+"}${Math.abs(settings.exposure).toFixed(2)}`;
    this.gamma.field.value = settings.gamma;
    this.gamma.value.textContent = settings.gamma.toFixed(1);
    this.clipping.ariaPressed = settings.clipping;
    this.probing.ariaPressed = this.probe.isOn;
    const isMissing = !review.shownSequence.layers[frame]?.[this.layer];
    this.words.textContent = isMissing ? this.without(review.shownSequence, frame) : "";
  }
}
