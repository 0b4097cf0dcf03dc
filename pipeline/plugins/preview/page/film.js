"use strict";
// The pictures, as they come. A take is what one text of the shot makes; while its frames are missing, those of the
// take before are shown, and while something is dragged, a trial.

class Film {
  constructor(page) {
    Object.assign(this, { page, take: null, pictures: new Map(), arrived: new Set(), at: 0, playing: true, trial: null });
    this.follows = true; // the newest frame, until the whole take is there
    this.begun = this.due = 0;
    requestAnimationFrame((now) => this.#tick(now));
  }

  listen() {
    const events = new EventSource("events");
    events.onmessage = (event) => {
      const message = JSON.parse(event.data);
      if (message.event === "begin") this.#begin(message);
      else if (message.event === "frame") this.#frame(message);
      else this.page.say(message.words, message.trouble);
    };
    events.onerror = () => this.page.say(ENDED, false);
  }

  #begin(message) {
    const { take } = this;
    const isSame = take && take.session === message.session && take.first === message.first && take.last === message.last;
    if (!isSame) Object.assign(this, { pictures: new Map(), at: message.first, follows: true });
    Object.assign(this, { take: message, arrived: new Set(), begun: performance.now() });
    this.page.began(isSame);
  }

  #frame(message) {
    const { take } = this, { session } = take ?? {};
    if (!take || message.take !== take.take) return;
    const image = new Image();
    image.onload = () => {
      if (session !== this.take.session || message.take !== this.take.take) return;
      const held = this.pictures.get(message.frame);
      if (held && held.take === message.take && held.drawn > message.drawn) return;
      this.pictures.set(message.frame, { image, take: message.take, drawn: message.drawn, camera: message.camera });
      this.arrived.add(message.frame);
      const isWhole = this.arrived.size > take.last - take.first;
      if (this.follows && this.playing && !isWhole && !this.#isReused(message)) this.at = message.frame;
      if (isWhole) this.follows = false;
      if (this.at === message.frame) this.trial = this.trial?.isDragged ? this.trial : null;
      this.page.drawFrame();
    };
    image.src = `frames/${message.take}/${message.frame}.jpg?${take.session}${message.drawn}`;
  }

  /** What an edit left as it was comes at once, and is nothing to look at. */
  #isReused(message) { return performance.now() - this.begun < 250 && message.frame !== this.take.first; }

  /** Whether the current frame is shown as the file has it. */
  get isCurrent() { return !this.trial && this.pictures.get(this.at)?.take === this.take?.take; }

  /** The picture and camera to show now; null while there is none. */
  get shown() {
    const held = this.pictures.get(this.at);
    return this.trial?.frame === this.at ? this.trial : held ? { source: held.image.src, camera: held.camera } : null;
  }

  /** Show the current frame as it would be; until a picture of the file comes. */
  setTrial(trial) {
    this.trial = { ...trial, frame: this.at };
    this.page.drawFrame();
  }

  endTrial() {
    this.trial = null;
    this.page.drawFrame();
  }

  go(frame) {
    if (!this.take) return;
    this.at = Math.min(this.take.last, Math.max(this.take.first, frame));
    this.page.drawFrame();
  }

  /** Stop, and go to a frame. */
  seek(frame) {
    this.play(false);
    this.go(frame);
  }

  play(wanted) {
    this.playing = wanted;
    this.page.drawFrame();
  }

  follow() {
    this.follows = true;
    this.play(true);
  }

  #tick(now) {
    requestAnimationFrame((next) => this.#tick(next));
    if (!this.playing || this.follows || !this.take || now < this.due) return;
    this.due = Math.max(this.due + 1000 / this.take.fps, now - 100);
    this.go(this.at >= this.take.last ? this.take.first : this.at + 1);
  }

  /** Draw which frames there are, and the playhead. */
  drawStrip(canvas) {
    if (!this.take) return;
    const { first, last } = this.take, many = last - first + 1, dots = window.devicePixelRatio || 1;
    Object.assign(canvas, { width: Math.round(canvas.clientWidth * dots), height: Math.round(canvas.clientHeight * dots) });
    const context = canvas.getContext("2d"), wide = canvas.width / many;
    context.fillStyle = "#1f1f1f";
    context.fillRect(0, 0, canvas.width, canvas.height);
    for (let i = 0; i < many; i++) {
      const held = this.pictures.get(first + i);
      if (!held) continue;
      context.fillStyle = held.take === this.take.take ? "#8c8c8c" : "#4b4b4b";
      context.fillRect(Math.floor(i * wide), canvas.height - 7 * dots, Math.ceil(wide), 7 * dots);
    }
    const step = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((each) => each * wide > 46 * dots) ?? 5000;
    context.fillStyle = "#b4b4b4";
    context.font = `${11 * dots}px system-ui, sans-serif`;
    context.textAlign = "center";
    for (let frame = Math.ceil(first / step) * step; frame <= last; frame += step) {
      context.fillText(frame, Math.max(12 * dots, Math.min(canvas.width - 14 * dots, (frame - first + 0.5) * wide)), 15 * dots);
    }
    context.fillStyle = "#ffffff";
    context.fillRect((this.at - first + 0.5) * wide - dots, 0, 2 * dots, canvas.height);
  }
}
