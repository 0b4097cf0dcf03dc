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

  /** Pixels by steps of luma, red, green or blue. */
  countsOf(channel) { return this.counts.subarray(256 * channel, 256 * channel + 256); }

  get total() { return this.countsOf(0).reduce((sum, count) => sum + count, 0); }

  /** The step of luma below or at which a share of the pixels lies. */
  percentile(share) {
    const { total } = this;
    let below = 0;
    return this.countsOf(0).findIndex((count) => (below += count) >= share * total);
  }

  /** The largest share of pixels of red, green or blue whose step passes a test. */
  clipped(passes) {
    const passing = [1, 2, 3].map((channel) => this.countsOf(channel).reduce((sum, count, step) => sum + (passes(step) ? count : 0), 0));
    return Math.max(...passing) / this.total;
  }
}

class LevelsPanel {
  constructor(element, review) {
    Object.assign(this, { element, review });
    const read = async (data) => Scope.unpacked(await inflated(data));
    this.scopes = new ScriptStore("scopes", "reviewScope", read, () => review.drawPanel());
    const waves = (channels) => make("canvas", { className: "waves", role: "img", width: channels * SCOPE_COLUMNS, height: SCOPE_LEVELS });
    Object.assign(this, { words: make("p", "note"), numbers: make("p", "legend"), luma: waves(1), parade: waves(3) });
    this.lines = svg("svg", { viewBox: "0 0 256 100", preserveAspectRatio: "none", role: "img" });
    const figureOf = (title, hint, shape, holder = shape) => {
      shape.ariaLabel = `${title}: ${hint}`;
      return chartOf(title, make("span", "about", hint), holder);
    };
    this.figures = make("div", {}, figureOf("Waveform", "luma by column", this.luma), figureOf("RGB parade", "red, green, blue by column", this.parade),
      figureOf("Histogram", "pixels by level", this.lines, make("div", "histogram", this.lines)), this.numbers);
    element.append(this.words, this.figures);
  }

  draw() {
    const { review } = this, sequence = review.shownSequence, { frame } = review.transport;
    const scope = this.scopeOf(sequence, frame);
    this.words.textContent = scope ? "" : this.#without(sequence, frame);
    this.figures.hidden = !scope;
    if (!scope) return;
    this.#drawWaves(this.luma, scope, [0]);
    this.#drawWaves(this.parade, scope, [1, 2, 3]);
    this.#drawHistogram(scope);
    const share = (value) => `${(100 * value).toFixed(value < 0.1 ? 2 : 1)} %`;
    const facts = [
      ["1 % of pixels up to", scope.percentile(0.01)], ["half of them up to", scope.percentile(0.5)], ["99 % up to", scope.percentile(0.99)],
      ["white", share(scope.clipped((step) => step >= WHITE_STEP))], ["black", share(scope.clipped((step) => step <= BLACK_STEP))],
    ];
    this.numbers.replaceChildren(...facts.map(([name, value]) => make("span", {}, `${name} `, make("b", {}, String(value)))));
  }

  /** The levels of a frame as it is seen; null while they are read, or where the page has none. */
  scopeOf(sequence, frame) {
    const { viewing } = this.review, canvas = viewing.source(sequence, frame);
    if (viewing.isNeutral) return this.scopes.get(sequence.scopes[sequence.places.get(frame)]);
    return canvas && Scope.of(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height));
  }

  #without(sequence, frame) {
    const file = sequence.scopes[sequence.places.get(frame)];
    if (!this.review.viewing.isNeutral) return this.review.viewing.without(sequence, frame);
    if (!file) return `Frame ${frame} has no picture.`;
    return this.scopes.isBroken(file) ? "Its levels cannot be read; write the page again." : "The levels are being read.";
  }

  /** Draw waveforms of channels side by side, a pixel for each level of each column. */
  #drawWaves(canvas, scope, channels) {
    channels.forEach((channel, place) => {
      drawPixels(canvas, place * SCOPE_COLUMNS, SCOPE_COLUMNS, SCOPE_LEVELS, (column, level) => {
        const wave = scope.waves[(channel * SCOPE_LEVELS + level) * SCOPE_COLUMNS + column];
        const rule = level && level % 16 === 0 ? 0.12 : 0; // at each quarter
        const light = wave ? Math.min(1, 0.25 + wave / 110) : rule; // a single pixel of a column is seen
        return SCOPE_CHANNELS[channel][1].map((value) => 31 + (value - 31) * light);
      });
    });
  }

  #drawHistogram(scope) {
    const most = Math.max(1, ...[0, 1, 2, 3].flatMap((channel) => [...scope.countsOf(channel).subarray(1, 255)])); // clipped pixels may go beyond
    this.lines.replaceChildren(...SCOPE_CHANNELS.map(([, ink], channel) => {
      const shares = Array.from(scope.countsOf(channel), (count) => Math.min(1, Math.sqrt(count / most)));
      return svg("path", { d: `M${shares.map((share, step) => `${step + 0.5} ${98 - 96 * share}`).join("L")}`, stroke: `rgb(${ink.join(" ")})` });
    }));
  }
}
