// Pictures are decoded before they are needed, and kept as long as the budget lasts.

const CACHE_BYTES = 640e6;
const AT_ONCE = 6;

class PictureCache {
  /** `arrived(url)` is called whenever a picture can be shown, or is known to be none. */
  constructor(arrived) {
    this.arrived = arrived;
    this.entries = new Map();  // url -> {bitmap, bytes, failed}
    this.wanted = [];
    this.loading = new Set();
    this.bytes = 0;
  }

  /** The decoded picture, or null: it is not there yet, or cannot be read. */
  get(url) {
    const entry = this.entries.get(url);
    return entry ? entry.bitmap : null;
  }

  isSettled(url) { return url === null || this.entries.has(url); }
  isBroken(url) { return this.entries.get(url)?.failed === true; }

  /** What is needed next, the most urgent first; what was asked for before is forgotten. */
  want(urls) {
    this.wanted = urls;
    this.keep = new Set(urls);
    this.#begin();
  }

  #begin() {
    for (const url of this.wanted) {
      if (this.loading.size >= AT_ONCE) return;
      if (url !== null && !this.entries.has(url) && !this.loading.has(url)) this.#load(url);
    }
  }

  async #load(url) {
    this.loading.add(url);
    const image = new Image();
    image.src = url;
    let entry;
    try {
      await image.decode();
      const bitmap = await createImageBitmap(image);
      entry = { bitmap, bytes: 4 * bitmap.width * bitmap.height, failed: false };
    } catch {
      entry = { bitmap: null, bytes: 0, failed: true };
    }
    this.loading.delete(url);
    this.entries.set(url, entry);
    this.bytes += entry.bytes;
    this.#drop();
    this.arrived(url);
    this.#begin();
  }

  /** Let go of what is not wanted, the oldest first, until the rest fits. */
  #drop() {
    for (const [url, entry] of this.entries) {
      if (this.bytes <= CACHE_BYTES) return;
      if (!entry.bitmap || this.keep.has(url)) continue;
      entry.bitmap.close();
      this.entries.delete(url);
      this.bytes -= entry.bytes;
    }
  }

  /** How many pictures of a size fit. */
  static room(width, height) {
    return Math.max(8, Math.floor(CACHE_BYTES / (4 * width * height)));
  }
}
