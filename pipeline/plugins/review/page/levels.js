// The levels of the frame that is shown: waveforms of luma and of red, green and blue, and histograms.

const SCOPE_COLUMNS = 96, SCOPE_LEVELS = 64;  // of a waveform: `page_pictures.Scope` has the same
const SCOPE_CHANNELS = [["Luma", [236, 236, 236]], ["Red", [255, 92, 80]], ["Green", [92, 214, 104]], ["Blue", [98, 144, 255]]];
const WHITE_STEP = 253, BLACK_STEP = 2;  // from which on a channel counts as clipped, of 255

/**
 * Levels of a picture: how many pixels of each column have each level, and how many there are of each of 256 steps.
 *
 * waves   (4, SCOPE_LEVELS, SCOPE_COLUMNS) of luma, red, green, blue: 0 … 255, the root of the share of a column
 * counts  (4, 256) pixels
 */
class Scope {
  constructor(waves, counts) { Object.assign(this, { waves, counts }); }

  /** The levels of a script's bytes. */
  static unpacked(bytes) {
    const size = 4 * SCOPE_LEVELS * SCOPE_COLUMNS;
    return new Scope(bytes.subarray(0, size), new Uint32Array(bytes.slice(size).buffer));
  }

  /** The levels of red, green, blue and alpha of pixels, 8 bits. */
  static of({ data, width, height }) {
    const found = new Uint32Array(4 * SCOPE_LEVELS * SCOPE_COLUMNS), counts = new Uint32Array(4 * 256), sums = new Uint32Array(SCOPE_COLUMNS);
    const step = 256 / SCOPE_LEVELS;
    for (let x = 0; x < width; x++) {
      const column = Math.floor((x * SCOPE_COLUMNS) / width);
      sums[column] += height;
      for (let y = 0, i = 4 * x; y < height; y++, i += 4 * width) {
        const luma = Math.floor(0.2126 * data[i] + 0.7152 * data[i + 1] + 0.0722 * data[i + 2] + 0.5);
        for (let channel = 0; channel < 4; channel++) {
          const value = channel ? data[i + channel - 1] : luma;
          counts[256 * channel + value]++;
          found[(channel * SCOPE_LEVELS + Math.floor(value / step)) * SCOPE_COLUMNS + column]++;
        }
      }
    }
    const waves = Uint8Array.from(found, (count, i) => Math.floor(255 * Math.sqrt(count / (sums[i % SCOPE_COLUMNS] || 1)) + 0.5));
    return new Scope(waves, counts);
  }

  /** The step of luma below or at which a share of the pixels lies. */
  percentile(share) {
    const luma = this.counts.subarray(0, 256), total = luma.reduce((sum, count) => sum + count, 0);
    let below = 0;
    return luma.findIndex((count) => (below += count) >= share * total);
  }

  /** The largest share of pixels of red, green or blue whose step passes a test. */
  clipped(passes) {
    const total = this.counts.subarray(0, 256).reduce((sum, count) => sum + count, 0);
    const of = (channel) => this.counts.subarray(256 * channel, 256 * channel + 256).reduce((sum, count, step) => sum + (passes(step) ? count : 0), 0);
    return Math.max(of(1), of(2), of(3)) / total;
  }
}

class LevelsPanel {
  constructor(element, review) {
    Object.assign(this, { element, review, entries: new Map() });
    window.reviewScope = (file, data) => this.#decode(file, data);
  }

  draw() {
    if (this.element.hidden) return;
    if (!this.figures) this.#build();
    const { review } = this, sequence = review.shownSequence, { frame } = review.transport;
    const scope = this.scopeOf(sequence, frame);
    this.words.textContent = scope ? "" : this.#without(sequence, frame);
    for (const figure of this.figures) figure.canvas.hidden = !scope;
    this.numbers.hidden = !scope;
    if (!scope) return;
    this.#drawWaves(this.figures[0], scope, [0]);
    this.#drawWaves(this.figures[1], scope, [1, 2, 3]);
    this.#drawHistogram(this.figures[2], scope);
    const share = (value) => `${(100 * value).toFixed(value < 0.1 ? 2 : 1)} %`;
    const facts = [
      ["1 % of pixels up to", scope.percentile(0.01)], ["half of them up to", scope.percentile(0.5)], ["99 % up to", scope.percentile(0.99)],
      ["white", share(scope.clipped((step) => step >= WHITE_STEP))], ["black", share(scope.clipped((step) => step <= BLACK_STEP))],
    ];
    this.numbers.replaceChildren(...facts.map(([name, value]) => make("span", {}, `${name} `, make("b", {}, String(value)))));
  }

  resize() { this.draw(); }

  /** The levels of a frame as it is seen; null while they are read, or where the page has none. */
  scopeOf(sequence, frame) {
    const { viewing } = this.review;
    if (!viewing.isNeutral) {
      const canvas = viewing.source(sequence, frame);
      return canvas && Scope.of(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height));
    }
    const file = sequence.scopes[sequence.places.get(frame)];
    if (!file) return null;
    if (!this.entries.has(file)) {
      this.entries.set(file, null);
      script(`scopes/${file}`).catch(() => this.#settle(file, false));
    }
    return this.entries.get(file) || null;
  }

  async #decode(file, data) {
    try {
      this.#settle(file, Scope.unpacked(await inflated(data)));
    } catch {
      this.#settle(file, false);
    }
  }

  #settle(file, scope) {
    this.entries.set(file, scope);
    this.draw();
  }

  #without(sequence, frame) {
    if (!this.review.viewing.isNeutral) return this.review.viewing.without(sequence, frame);
    const file = sequence.scopes[sequence.places.get(frame)];
    if (!file) return `Frame ${frame} has no picture.`;
    return this.entries.get(file) === false ? "Its levels cannot be read; write the page again." : "The levels are being read.";
  }

  #build() {
    const figureOf = (title, hint, height) => {
      const canvas = make("canvas", { role: "img", ariaLabel: `${title}: ${hint}`, style: `height: ${height}px` });
      const figure = make("figure", "chart levels", make("figcaption", {}, make("span", {}, title), make("span", {}, hint)), canvas);
      this.element.append(figure);
      return { canvas, height };
    };
    this.words = this.element.appendChild(make("p", "note"));
    this.figures = [
      figureOf("Waveform", "luma by column", 150), figureOf("RGB parade", "red, green, blue by column", 150), figureOf("Histogram", "pixels by level", 96),
    ];
    this.numbers = this.element.appendChild(make("p", "legend"));
  }

  /** Size a canvas for the display; return its context in CSS pixels, and its width. */
  #begin({ canvas, height }) {
    const dots = dotsOf(), width = canvas.clientWidth;
    Object.assign(canvas, { width: width * dots, height: height * dots });
    const context = canvas.getContext("2d", { alpha: false });
    context.setTransform(dots, 0, 0, dots, 0, 0);
    context.fillStyle = "#1f1f1f";
    context.fillRect(0, 0, width, height);
    return [context, width];
  }

  #drawWaves(figure, scope, channels) {
    const [context, width] = this.#begin(figure), each = width / channels.length;
    const image = new ImageData(SCOPE_COLUMNS, SCOPE_LEVELS), map = make("canvas", { width: SCOPE_COLUMNS, height: SCOPE_LEVELS });
    channels.forEach((channel, place) => {
      const ink = SCOPE_CHANNELS[channel][1];
      for (let level = 0; level < SCOPE_LEVELS; level++) {
        for (let column = 0; column < SCOPE_COLUMNS; column++) {
          const wave = scope.waves[(channel * SCOPE_LEVELS + level) * SCOPE_COLUMNS + column], at = 4 * ((SCOPE_LEVELS - 1 - level) * SCOPE_COLUMNS + column);
          const light = wave ? Math.min(1, 0.25 + wave / 110) : 0;  // a single pixel of a column is seen
          image.data.set([...ink.map((value) => 31 + (value - 31) * light), 255], at);
        }
      }
      map.getContext("2d").putImageData(image, 0, 0);
      context.drawImage(map, place * each + (place ? 1 : 0), 0, each - (place ? 1 : 0), figure.height);
    });
    context.fillStyle = "rgba(255, 255, 255, 0.16)";
    for (const share of [0.25, 0.5, 0.75]) context.fillRect(0, Math.round(figure.height * share), width, 1);
  }

  #drawHistogram(figure, scope) {
    const [context, width] = this.#begin(figure), inner = (channel) => scope.counts.subarray(256 * channel + 1, 256 * channel + 255);
    const most = Math.max(1, ...[0, 1, 2, 3].map((channel) => Math.max(...inner(channel))));  // clipped pixels may go beyond
    SCOPE_CHANNELS.forEach(([, ink], channel) => {
      context.strokeStyle = `rgb(${ink.join(" ")})`;
      context.lineWidth = channel ? 1 : 1.5;
      context.beginPath();
      for (let step = 0; step < 256; step++) {
        const share = Math.min(1, Math.sqrt(scope.counts[256 * channel + step] / most));
        context.lineTo(((step + 0.5) / 256) * width, figure.height - 1 - share * (figure.height - 4));
      }
      context.stroke();
    });
  }
}
