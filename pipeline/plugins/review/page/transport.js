"use strict";
// Time: which frame is shown, and when the next one is due.

const SPEEDS = [0.25, 0.5, 1, 1.5, 2];

class Transport {
  /**
   * `isReady(frame)` says whether a frame could be shown at once; playing never skips one, but waits.
   * `changed(what)` is called with "frame", "playing", "range" or "speed".
   */
  constructor(isReady, changed) {
    this.isReady = isReady;
    this.changed = changed;
    this.numbers = [1];
    this.dissolve = 0;
    this.frame = 1;
    this.fps = 24;
    this.speed = 1;
    this.direction = 1;
    this.playing = false;
    this.measured = 0;
    this.shownAt = [];
  }

  /**
   * Go over to other frames, staying at the frame where it is among them. Of a shot that loops, the last
   * `dissolve` frames dissolve into the first: they are shown mixed while all of it plays, as in the movie.
   */
  setNumbers(numbers, fps, dissolve = 0) {
    this.dissolve = dissolve;
    const same = numbers.length === this.numbers.length && numbers.every((n, i) => n === this.numbers[i]);
    this.numbers = numbers;
    this.fps = fps;
    if (!same) {
      this.inPoint = numbers[0];
      this.outPoint = numbers[numbers.length - 1];
      this.changed("range");
    }
    this.go(this.frame);
  }

  get first() { return this.numbers[0]; }
  get last() { return this.numbers[this.numbers.length - 1]; }
  get isLooped() { return this.inPoint !== this.first || this.outPoint !== this.last; }

  /** Where playing begins again: a dissolve has shown the frames before. */
  get start() { return this.isLooped ? this.inPoint : this.numbers[this.dissolve]; }

  /** The frame of the beginning that is mixed with a frame while it plays, and its weight; or null. */
  beginningWith(frame) {
    const place = this.numbers.indexOf(frame) - this.numbers.length + this.dissolve;
    return this.playing && !this.isLooped && place >= 0 ? [this.numbers[place], (place + 1) / (this.dissolve + 1)] : null;
  }

  /** The nearest frame that there is. */
  nearest(frame) {
    return this.numbers.reduce((best, n) => (Math.abs(n - frame) < Math.abs(best - frame) ? n : best));
  }

  go(frame) {
    const nearest = this.nearest(frame);
    if (nearest !== this.frame) {
      this.frame = nearest;
      this.changed("frame");
    }
  }

  /** Stop, and move by so many frames, no further than to the ends. */
  step(count) {
    this.pause();
    const place = this.numbers.indexOf(this.frame) + count;
    this.go(this.numbers[Math.min(this.numbers.length - 1, Math.max(0, place))]);
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

  setIn(frame = this.frame) { this.inPoint = frame; this.outPoint = Math.max(frame, this.outPoint); this.changed("range"); }
  setOut(frame = this.frame) { this.outPoint = frame; this.inPoint = Math.min(frame, this.inPoint); this.changed("range"); }
  resetRange() { this.inPoint = this.first; this.outPoint = this.last; this.changed("range"); }

  setSpeed(speed) {
    this.speed = speed;
    this.shownAt = [];
    this.changed("speed");
  }

  /** Faster or slower by so many of SPEEDS. */
  changeSpeed(steps) {
    const place = SPEEDS.indexOf(this.speed) + steps;
    this.setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, place))]);
  }

  /** J and L: begin to play, or play faster if it is going that way already. */
  shuttle(direction) {
    if (this.playing && this.direction === direction) return this.changeSpeed(1);
    this.setSpeed(1);
    this.play(direction);
  }

  toggle() { if (this.playing) this.pause(); else this.play(1); }

  play(direction) {
    this.direction = direction;
    this.shownAt = [];
    if (!this.playing) {
      this.playing = true;
      this.due = performance.now();
      requestAnimationFrame((now) => this.#tick(now));
    }
    this.changed("playing");
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.direction = 1;
    this.measured = 0;
    this.changed("playing");
  }

  #tick(now) {
    if (!this.playing) return;
    const next = this.following(this.frame), each = 1000 / (this.fps * this.speed);
    if (now >= this.due + each - 2 && this.isReady(next)) {  // 2 ms: what a display is early by
      this.due = now - this.due > 3 * each ? now : this.due + each;
      this.#measure(now);
      this.go(next);
    }
    requestAnimationFrame((then) => this.#tick(then));
  }

  /** Frames a second over the last second. */
  #measure(now) {
    this.shownAt.push(now);
    while (this.shownAt[0] < now - 1000) this.shownAt.shift();
    const span = now - this.shownAt[0];
    this.measured = span > 0 ? (1000 * (this.shownAt.length - 1)) / span : 0;
  }
}
