// Layers of frames: linear half floats and display values, whose pixels a page in a folder may read.

const LAYER_BYTES = 512e6;  // of decoded ones that are kept

/** Layers by their files. */
function layerStore(arrived) {
  return new ScriptStore("layers", "reviewLayer", async ({ data, ...about }) => new Layer(about, await inflated(data)), arrived, LAYER_BYTES);
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
