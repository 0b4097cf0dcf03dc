// Time: which frame is shown, and when the next one is due.

const SPEEDS = [0.25, 0.5, 1, 1.5, 2];
const EARLY = 2; // ms by which a display may be before the time of a frame

/** The nearest of numbers to one. */
function nearestOf(numbers, wanted) {
  return numbers.reduce((best, each) => (Math.abs(each - wanted) < Math.abs(best - wanted) ? each : best));
}

class Transport {
  /**
   * isReady(frame)  tells whether a frame could be shown at once; playing never skips one, but waits
   * isSmooth        shows all times between frames too, and waits for none
   * tail            frames of smooth time after the last one, until the first comes again
   */
  constructor({ isReady = () => true, isSmooth = false, tail = 0 } = {}) {
    Object.assign(this, { isReady, isSmooth, tail, numbers: [1], dissolve: 0, frame: 1, fps: 24, listeners: [] });
    Object.assign(this, { speed: 1, direction: 1, playing: false, measured: 0, shownAt: [] });
  }

  /** Call `act` with "frame", "playing", "range" or "speed" whenever that has changed. */
  listen(act) { this.listeners.push(act); }

  #tell(what) { for (const act of this.listeners) act(what); }

  /**
   * Go over to other frames, staying at the frame where it is among them. Of a shot that loops, the last
   * `dissolve` frames dissolve into the first: they are shown mixed while all of it plays, as in the movie.
   */
  setNumbers(numbers, fps, dissolve = 0) {
    const isSame = String(numbers) === String(this.numbers) && this.inPoint !== undefined;
    Object.assign(this, { numbers, fps, dissolve });
    if (!isSame) this.resetRange();
    this.go(this.frame);
  }

  get first() { return this.numbers[0]; }
  get last() { return this.numbers.at(-1); }
  get isLooped() { return this.inPoint !== this.first || this.outPoint !== this.last; }

  /** Where playing begins again: a dissolve has shown the frames before. */
  get start() { return this.isLooped ? this.inPoint : this.numbers[this.dissolve]; }

  /** The frame of the beginning that is mixed with a frame while it plays, and its weight; or null. */
  beginningWith(frame) {
    const place = this.numbers.indexOf(frame) - this.numbers.length + this.dissolve;
    return this.playing && !this.isLooped && place >= 0 ? [this.numbers[place], (place + 1) / (this.dissolve + 1)] : null;
  }

  /** The nearest frame that there is. */
  nearest(frame) { return nearestOf(this.numbers, frame); }

  go(frame) {
    const next = this.isSmooth ? clamp(frame, this.first, this.last + this.tail) : this.nearest(frame);
    if (next === this.frame) return;
    this.frame = next;
    this.#tell("frame");
  }

  /** Stop, and go to a frame. */
  jump(frame) {
    this.pause();
    this.go(frame);
  }

  /** Stop, and move by so many frames, no further than to the ends. */
  step(count) {
    const place = this.numbers.indexOf(this.nearest(this.frame)) + count;
    this.jump(this.numbers[clamp(place, 0, this.numbers.length - 1)]);
  }

  /** The frame after another in the direction of play: from one end of the loop it goes to the other. */
  following(frame, direction = this.direction) {
    const next = this.numbers[this.numbers.indexOf(frame) + direction];
    if (direction > 0) return next === undefined || next > this.outPoint || frame < this.inPoint ? this.start : next;
    return next === undefined || next < this.start || frame > this.outPoint ? this.outPoint : next;
  }

  /** The frames to come, the next first. */
  ahead(count) {
    const coming = [this.frame];
    while (coming.length < Math.min(count, this.numbers.length)) coming.push(this.following(coming.at(-1)));
    return coming;
  }

  setIn(frame = this.nearest(this.frame)) { this.#loop(frame, Math.max(frame, this.outPoint)); }
  setOut(frame = this.nearest(this.frame)) { this.#loop(Math.min(frame, this.inPoint), frame); }
  resetRange() { this.#loop(this.first, this.last); }

  #loop(inPoint, outPoint) {
    Object.assign(this, { inPoint, outPoint });
    this.#tell("range");
  }

  setSpeed(speed) {
    Object.assign(this, { speed, shownAt: [] });
    this.#tell("speed");
  }

  /** Faster or slower by so many of SPEEDS. */
  changeSpeed(steps) { this.setSpeed(SPEEDS[clamp(SPEEDS.indexOf(this.speed) + steps, 0, SPEEDS.length - 1)]); }

  /** J and L: begin to play, or play faster if it is going that way already. */
  shuttle(direction) {
    if (this.playing && this.direction === direction) return this.changeSpeed(1);
    this.setSpeed(1);
    this.play(direction);
  }

  toggle() { if (this.playing) this.pause(); else this.play(); }

  play(direction = 1) {
    if (this.numbers.length < 2) return;
    const wasPlaying = this.playing;
    Object.assign(this, { direction, shownAt: [], playing: true });
    if (!wasPlaying) {
      this.due = performance.now();
      requestAnimationFrame((now) => this.#tick(now));
    }
    this.#tell("playing");
  }

  pause() {
    if (!this.playing) return;
    Object.assign(this, { playing: false, direction: 1, measured: 0 });
    this.#tell("playing");
  }

  #tick(now) {
    if (!this.playing) return;
    if (this.isSmooth) {
      this.glide(clamp(now - this.due, 0, 100) / 1000); // a page in the background does not jump
      this.due = now;
    } else {
      this.#advance(now);
    }
    requestAnimationFrame((then) => this.#tick(then));
  }

  /** Let seconds of smooth time pass. */
  glide(seconds) {
    const begin = this.start, span = (this.isLooped ? this.outPoint : this.last + this.tail) - begin;
    const at = this.frame - begin + this.direction * seconds * this.fps * this.speed;
    this.go(begin + (span ? ((at % span) + span) % span : 0));
  }

  #advance(now) {
    const next = this.following(this.frame), each = 1000 / (this.fps * this.speed);
    if (now < this.due + each - EARLY || !this.isReady(next)) return;
    this.due = now - this.due > 3 * each ? now : this.due + each;
    this.#measure(now);
    this.go(next);
  }

  /** Frames a second over the last second. */
  #measure(now) {
    this.shownAt.push(now);
    while (this.shownAt[0] < now - 1000) this.shownAt.shift();
    const span = now - this.shownAt[0];
    this.measured = span > 0 ? (1000 * (this.shownAt.length - 1)) / span : 0;
  }
}
