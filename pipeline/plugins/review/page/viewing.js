// How pictures are looked at: which layer, exposure, gamma, channel, false colour; and saving what is seen.

const CHANNEL_NAMES = {
  rgb: ["RGB", "Shift C"], red: ["R", "Shift R"], green: ["G", "Shift G"], blue: ["B", "Shift B"], luminance: ["Y", "Shift Y"],
};
const LAYER_OF_PICTURE = "picture", LAYER_OF_HDR = "nits";
const LAYER_BYTES = 512e6; // of decoded ones that are kept

class Viewing {
  constructor(element, review) {
    Object.assign(this, { element, review, isOn: false, layer: LAYER_OF_PICTURE });
    this.grader = new Grader();
    const read = async ({ data, ...about }) => new Layer(about, await inflated(data));
    this.layers = new ScriptStore("layers", "reviewLayer", read, () => review.redraw(), ({ bits }) => bits.byteLength, LAYER_BYTES);
    this.probe = new Probe(id("probe"), review, this);
    this.#build();
  }

  /** Tell whether pictures are shown otherwise than their files are. */
  get isNeutral() {
    const { exposure, gamma, channel, clipping } = this.grader.settings;
    return this.layer === LAYER_OF_PICTURE && !exposure && gamma === 1 && channel === "rgb" && !clipping;
  }

  /** The canvas to show for a frame: null where the file is to be shown, or nothing is there yet. */
  source(sequence, frame) { return this.isNeutral ? null : this.#seen(sequence, frame); }

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

  setLayer(layer) { this.review.change(this, { layer, isOn: true }); }

  nextLayer() { this.setLayer(nextOf(this.names.length ? this.names : [LAYER_OF_PICTURE], this.layer)); }

  /** Show alpha, or go back to the picture. */
  toggleAlpha() { this.setLayer(this.layer === "alpha" ? LAYER_OF_PICTURE : "alpha"); }

  reset() {
    Object.assign(this.grader.settings, { exposure: 0, gamma: 1, channel: "rgb", clipping: false });
    this.review.change(this, { layer: LAYER_OF_PICTURE });
  }

  toggle(isOn = !this.isOn) {
    if (!isOn) this.reset();
    this.review.change(this, { isOn });
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
    return `Frame ${frame} has no layers on this page; the nearest that has is ${nearestOf(frames, frame)}.`;
  }

  // Its bar

  #build() {
    const { review } = this, settings = () => this.grader.settings;
    this.list = listOf("Layer", [], (name) => this.setLayer(name), { value: () => this.layer });
    const channels = Object.entries(CHANNEL_NAMES).map(([channel, [words, key]]) => (
      [channel, words, `${channel === "rgb" ? "All channels" : `Only ${channel}`} (${key})`]
    ));
    const slider = (words, title, name, low, high, step, written) => {
      const field = sliderOf(words, low, high, step, (value) => this.set({ [name]: value }), { title, value: () => settings()[name] });
      return make("label", "inline", words, field, make("output", { textContent: () => written(settings()[name]) }));
    };
    const stops = (value) => `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(2)}`;
    const isMissing = () => !review.shownSequence.layers[review.transport.frame]?.[this.layer];
    give(this.element, { hidden: () => !this.isOn }).append(
      this.list, choiceOf("Channel", channels, () => settings().channel, (channel) => this.set({ channel })),
      slider("Exposure", "Stops (Page Up, Page Down)", "exposure", -6, 6, 0.25, stops),
      slider("Gamma", "Gamma (Shift Page Up, Page Down)", "gamma", 0.2, 3, 0.1, (value) => value.toFixed(1)),
      buttonOf("Clipping", "Red where white, blue where black, magenta where no number (Shift K)", () => this.toggleClipping(), { ariaPressed: () => settings().clipping }),
      buttonOf("Probe", "Values under the pointer (Shift P)", () => review.toggle(this.probe, "isOn"), { ariaPressed: () => this.probe.isOn }),
      buttonOf("Save", "Save this frame as PNG, with drawings (Shift S), without (Shift W)", () => this.save(true)),
      buttonOf("Reset", "Show pictures as they are (0)", () => this.reset()),
      make("p", { className: "viewing-words", textContent: () => (isMissing() ? this.without(review.shownSequence, review.transport.frame) : "") }),
    );
  }

  draw() {
    this.probe.draw();
    const names = [...new Set([LAYER_OF_PICTURE, ...this.names, this.layer])];
    if (names.join() === this.listed) return;
    this.listed = names.join();
    this.list.replaceChildren(...names.map((name) => new Option(name, name)));
    refresh(this.element);
  }
}
