// Layers of frames: linear half floats and display values, whose pixels a page in a folder may read.

const LAYER_BYTES = 512e6;  // of decoded ones that are kept

/** Layers by their files; `arrived()` is called when one can be shown. */
class LayerCache {
  constructor(arrived) {
    this.arrived = arrived;
    this.entries = new Map();  // file -> layer; null while it is read, false if it cannot be
    window.reviewLayer = (file, data) => this.#decode(file, data);
  }

  /** The layer of a file, or null: it is not there yet, or cannot be read. */
  get(file) {
    if (!file) return null;
    if (!this.entries.has(file)) {
      this.entries.set(file, null);
      script(`layers/${file}`).catch(() => this.#settle(file, false));
    }
    const layer = this.entries.get(file);
    if (layer) this.#put(file, layer);
    return layer || null;
  }

  /** Keep an entry as the one that was used last. */
  #put(file, layer) {
    this.entries.delete(file);
    this.entries.set(file, layer);
  }

  async #decode(file, { data, ...about }) {
    try {
      this.#settle(file, new Layer(about, await inflated(data)));
    } catch {
      this.#settle(file, false);
    }
  }

  #settle(file, layer) {
    this.#put(file, layer);
    let bytes = 0;
    for (const [key, each] of [...this.entries].reverse()) {
      if (each) bytes += each.bits.byteLength;
      if (each && bytes > LAYER_BYTES) this.entries.delete(key);
    }
    this.arrived();
  }
}

/** One layer of a frame. `bits` are half floats, or display steps, as red, green, blue and alpha of each pixel. */
class Layer {
  constructor(about, bytes) {
    Object.assign(this, about);
    const { width, height, channels } = this, count = width * height, values = count * channels;
    this.bits = new Uint16Array(4 * count);
    for (let channel = 0; channel < channels; channel++) {
      for (let y = 0, from = channel * count; y < height; y++) {
        for (let x = 0, left = 0; x < width; x++, from++) {
          left = (left + bytes[from] + 256 * bytes[values + from]) & 65535;
          this.bits[4 * (y * width + x) + channel] = left;
        }
      }
    }
    if (channels === 1) {  // grey
      for (let i = 0; i < this.bits.length; i += 4) this.bits[i + 1] = this.bits[i + 2] = this.bits[i];
    }
  }

  /** The values of a pixel, as many as the layer has channels. */
  at(x, y) {
    const from = 4 * (y * this.width + x), value = this.kind === "display" ? (bits) => bits : fromHalf;
    return Array.from(this.bits.subarray(from, from + this.channels), value);
  }
}

/** The number that 16 bits are as a half float. */
function fromHalf(bits) {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, fraction = bits & 1023;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -24 * fraction);
}
