// The pictures, as they come. A take is what one text of the shot makes; while its frames are missing, those of the
// take before are shown, and while something is dragged, a trial.

class Film {
  constructor(page) {
    Object.assign(this, { page, take: null, pictures: new Map(), arrived: new Set(), trial: null, begun: 0 });
    this.follows = true; // the newest frame, until the whole take is there; then time goes on by itself
    this.transport = new Transport({ isReady: () => !this.follows });
  }

  get at() { return this.transport.frame; }
  get isPlaying() { return this.transport.playing && !this.follows; }

  listen() {
    const events = new EventSource("events");
    events.onmessage = (event) => {
      const message = JSON.parse(event.data);
      if (message.event === "begin") this.#begin(message);
      else if (message.event === "frame") this.#frame(message);
      else if (message.event === "perform") this.page.perform.take(message);
      else if (message.event === "live") this.page.perform.heard(message);
      else this.page.say(message.words, message.trouble);
    };
    events.onerror = () => this.page.say(ENDED, false);
  }

  #begin(message) {
    const { take, transport } = this, { session, first, last, fps } = message;
    const isSame = take && take.session === session && take.first === first && take.last === last;
    Object.assign(this, { take: message, arrived: new Set(), begun: performance.now() });
    if (!isSame) {
      Object.assign(this, { pictures: new Map(), follows: true });
      transport.setNumbers(Array.from({ length: last - first + 1 }, (_, i) => first + i), fps);
      transport.go(first);
      if (!take) transport.play();
    }
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
      if (this.follows && this.transport.playing && !isWhole && !this.#isReused(message)) this.transport.go(message.frame);
      if (isWhole) this.follows = false;
      if (this.at === message.frame) this.trial = this.trial?.isDragged ? this.trial : null;
      this.page.drawFrame();
      this.page.strip.draw();
    };
    image.src = `frames/${message.take}/${message.frame}.jpg?${take.session}${message.drawn}`;
  }

  /** What an edit left as it was comes at once, and is nothing to look at. */
  #isReused(message) { return performance.now() - this.begun < 250 && message.frame !== this.take.first; }

  /** Whether the current frame is shown as the file has it. */
  get isCurrent() { return !this.trial && this.stateOf(this.at) === "there"; }

  /** Whether the picture of a frame is there, or an old one. */
  stateOf(frame) {
    const held = this.pictures.get(frame);
    return !held ? "" : held.take === this.take?.take ? "there" : "old";
  }

  /** The picture and camera to show now; null while there is none. */
  get shown() {
    const held = this.pictures.get(this.at);
    return this.trial?.frame === this.at ? this.trial : held ? { source: held.image.src, camera: held.camera } : null;
  }

  /** Show the current frame as it would be, until a picture of the file comes. */
  setTrial(trial) {
    this.trial = { ...trial, frame: this.at };
    this.page.drawFrame();
  }

  endTrial() {
    this.trial = null;
    this.page.drawFrame();
  }

  /** Stay at this frame, whatever comes. */
  hold() {
    this.follows = false;
    this.transport.pause();
  }

  follow() {
    this.follows = true;
    this.transport.play();
  }
}
