// What data.js holds, and what the page reads when it is needed and lets go of again: pictures, and data in scripts. A page
// in a folder may load these, and nothing else. Each script calls a function with its name and its data.

const placesOf = (numbers) => new Map(numbers.map((number, place) => [number, place]));

/** Pictures of one shot, by frame. */
class Sequence {
  constructor(data, index, about) {
    Object.assign(this, data, { index, about, places: placesOf(data.numbers), factPlaces: placesOf(data.facts.numbers) });
  }

  /** What people choose it by; `alone` where the page has no other shot. */
  name(alone) { return alone ? this.label : `${this.shot} · ${this.label}`; }

  /** The frames that have a picture. */
  get there() { return this.numbers.filter((number, place) => this.files[place]); }

  /** The frame to show among others at `number`: a still has but one. */
  among(number) { return this.numbers.length === 1 ? this.numbers[0] : number; }

  /** Where the picture of a frame lies; null where there is none. */
  url(number) {
    const name = this.files[this.places.get(number)];
    return name ? `pictures/${name}` : null;
  }

  /** Where its sheet of small pictures lies; null where it has none. */
  get sheetUrl() { return this.sheet && `pictures/${this.sheet.file}`; }

  /** missing, failed, stale or done, and why. */
  state(number) {
    return this.states[number] ?? (this.places.has(number) ? ["done", ""] : ["missing", "it is not in this sequence"]);
  }

  /** The place of the nearest small picture on the sheet: {url, x, y, width, height, number}. */
  thumb(number) {
    if (!this.sheet) return null;
    const { frames, columns, size: [width, height] } = this.sheet, nearest = nearestOf(frames, number), place = frames.indexOf(nearest);
    return { url: this.sheetUrl, x: (place % columns) * width, y: Math.floor(place / columns) * height, width, height, number: nearest };
  }

  /** An entry of the header of a frame; undefined where it does not say. */
  fact(number, name) {
    const place = this.factPlaces.get(number), { same, differ } = this.facts;
    return place === undefined ? undefined : same[name] ?? differ[name]?.[place] ?? undefined;
  }

  /** How long a frame took to render, in words; "" where nobody knows. */
  renderingTime(number) {
    const seconds = this.timed[0]?.bars.rendering?.[this.places.get(number)];
    return seconds ? `${+seconds.toPrecision(3)} s` : "";
  }

  /** Hours, minutes, seconds and frames since the first frame of the shot. */
  timecode(number) {
    const whole = Math.max(1, Math.round(this.about.fps)), count = Math.max(0, number - this.about.numbers[0]);
    const parts = [count / whole / 3600, (count / whole / 60) % 60, (count / whole) % 60, count % whole];
    return parts.map((part) => String(Math.floor(part)).padStart(2, "0")).join(":");
  }
}

const PICTURE_BYTES = 640e6, AT_ONCE = 6;

function script(url) {
  return new Promise((resolve, reject) => {
    document.head.append(make("script", { src: url, onload: resolve, onerror: () => reject(new Error(`${url} cannot be read`)) }));
  });
}

class Store {
  /**
   * arrived  (name) called when something can be used, or is known to be broken
   * bytes    (value) how many it takes; `most` of all are kept
   */
  constructor(arrived, bytes = () => 0, most = Infinity) {
    Object.assign(this, { arrived, bytes, most, needed: new Set() });
    this.entries = new Map(); // by name, the latest used last; null while it is read, false if it is broken
  }

  isBroken(name) { return this.entries.get(name) === false; }

  /** Keep what a promise has; false where it fails. */
  async settle(name, promise) {
    this.entries.set(name, null);
    this.#put(name, await promise.catch(() => false));
    this.#drop();
    this.arrived(name);
  }

  /** What is there, as the latest used; null while it is read, or where there is none. */
  use(name) {
    const value = this.entries.get(name);
    if (value) this.#put(name, value);
    return value ?? null;
  }

  #put(name, value) {
    this.entries.delete(name);
    this.entries.set(name, value);
  }

  /** Let go of what is not needed, the oldest first, until the rest fits. */
  #drop() {
    let total = 0;
    for (const value of this.entries.values()) total += value ? this.bytes(value) : 0;
    for (const [name, value] of this.entries) {
      if (total <= this.most) return;
      if (!value || this.needed.has(name)) continue;
      total -= this.bytes(value);
      this.entries.delete(name);
      value.close?.();
    }
  }
}

/** Data of scripts in a folder, which call `window[caller]`; `decode` makes of it what is kept. */
class ScriptStore extends Store {
  constructor(folder, caller, decode, arrived, ...limits) {
    super(arrived, ...limits);
    this.folder = folder;
    window[caller] = (file, data) => this.settle(file, Promise.resolve(data).then(decode));
  }

  /** What a script has, or null while it is read; false if it cannot be. */
  get(file) {
    if (file && !this.entries.has(file)) {
      this.entries.set(file, null);
      script(`${this.folder}/${file}`).catch((error) => this.settle(file, Promise.reject(error)));
    }
    return this.use(file);
  }
}

/** Pictures that are decoded before they are needed. */
class PictureCache extends Store {
  constructor(arrived) { super(arrived, ({ width, height }) => 4 * width * height, PICTURE_BYTES); }

  /** The decoded picture, or null: it is not there yet, or cannot be read. */
  get(url) { return this.entries.get(url) || null; }

  isSettled(url) { return url === null || this.isBroken(url) || this.get(url) !== null; }

  /** What is needed next, the most urgent first; what was asked for before is forgotten. */
  want(urls) {
    this.needed = new Set(urls);
    this.#begin();
  }

  #begin() {
    const loading = [...this.entries.values()].filter((value) => value === null).length;
    const next = [...this.needed].filter((url) => !this.entries.has(url)).slice(0, AT_ONCE - loading);
    for (const url of next) this.settle(url, decodedPicture(url)).then(() => this.#begin());
  }

  /** How many pictures of a size fit. */
  static room(width, height) { return Math.max(8, Math.floor(PICTURE_BYTES / (4 * width * height))); }
}

async function decodedPicture(url) {
  const image = new Image();
  image.src = url;
  await image.decode();
  return createImageBitmap(image);
}

function decoded(text, Kind) { return new Kind(bytesIn(text).buffer); }
