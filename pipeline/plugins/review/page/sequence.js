// What data.js holds, with answers to what the page asks of it.

/** Pictures of one shot, by frame. */
class Sequence {
  constructor(data, index, shot) {
    Object.assign(this, data);
    this.index = index;
    this.about = shot;
    this.places = new Map(this.numbers.map((number, place) => [number, place]));
    this.factPlaces = new Map(this.facts.numbers.map((number, place) => [number, place]));
    this.thumbs = new Map((this.sheet ? this.sheet.frames : []).map((number, place) => [number, place]));
  }

  /** What people choose it by; `alone` where the page has no other shot. */
  name(alone) {
    return alone ? this.label : `${this.shot} · ${this.label}`;
  }

  /** The frames that have a picture. */
  get there() { return this.numbers.filter((number, place) => this.files[place]); }

  get first() { return this.numbers[0]; }
  get last() { return this.numbers[this.numbers.length - 1]; }

  /** The frame to show among others at `number`: a still has but one. */
  among(number) { return this.numbers.length === 1 ? this.numbers[0] : number; }

  /** Where the picture of a frame lies; null where there is none. */
  url(number) {
    const name = this.files[this.places.get(number)];
    return name ? `pictures/${name}` : null;
  }

  /** missing, failed, stale or done, and why. */
  state(number) {
    if (this.states[number]) return this.states[number];
    return this.places.has(number) ? ["done", ""] : ["missing", "it is not in this sequence"];
  }

  /** The place of the nearest small picture on the sheet: {url, x, y, width, height, number}. */
  thumb(number) {
    if (!this.sheet) return null;
    const { frames, columns, size: [width, height], file } = this.sheet;
    let place = this.thumbs.get(number);
    if (place === undefined) {
      place = frames.reduce((best, n, i) => Math.abs(n - number) < Math.abs(frames[best] - number) ? i : best, 0);
    }
    const x = (place % columns) * width, y = Math.floor(place / columns) * height;
    return { url: `pictures/${file}`, x, y, width, height, number: frames[place] };
  }

  /** An entry of the header of a frame; undefined where it does not say. */
  fact(number, name) {
    if (name in this.facts.same) return this.factPlaces.has(number) ? this.facts.same[name] : undefined;
    const values = this.facts.differ[name], place = this.factPlaces.get(number);
    return values === undefined || place === undefined ? undefined : values[place] ?? undefined;
  }

  /** Every entry of the header of a frame, by name. */
  header(number) {
    const names = [...Object.keys(this.facts.same), ...Object.keys(this.facts.differ)].sort();
    return names.map((name) => [name, this.fact(number, name)]).filter(([, value]) => value !== undefined);
  }

  /** Hours, minutes, seconds and frames since the first frame of the shot. */
  timecode(number) {
    const whole = Math.max(1, Math.round(this.about.fps));
    const count = Math.max(0, number - this.about.numbers[0]);
    const parts = [count / whole / 3600, (count / whole / 60) % 60, (count / whole) % 60, count % whole];
    return parts.map((part) => String(Math.floor(part)).padStart(2, "0")).join(":");
  }
}
