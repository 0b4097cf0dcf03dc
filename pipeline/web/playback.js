// The controls of a transport: its buttons, its fields and its keys.

class Playback {
  /** `buttons` is the element that they are put into, `field` the one of the frame's number; both may be null. */
  constructor(transport, buttons, field, names = Object.keys(Playback.acts(transport))) {
    Object.assign(this, { transport, field });
    const acts = Playback.acts(transport);
    for (const name of names) {
      const button = buttons.appendChild(iconButton(name, ...acts[name]));
      if (name === "play") this.button = button;
    }
    field.addEventListener("change", () => this.#type());
    this.range = id("range");
    this.speed = id("speed");
    this.speed?.append(...SPEEDS.map((speed) => new Option(`${speed}×`, speed)));
    this.speed?.addEventListener("change", () => transport.setSpeed(+this.speed.value));
    this.draw();
  }

  /** What each button says and does, by its icon. */
  static acts(transport) {
    return {
      first: ["First frame (Home)", () => transport.jump(transport.first)],
      back: ["Back a frame (←)", () => transport.step(-1)],
      play: ["Play (Space)", () => transport.toggle()],
      ahead: ["On a frame (→)", () => transport.step(1)],
      last: ["Last frame (End)", () => transport.jump(transport.last)],
      loopIn: ["Loop from here ([)", () => transport.setIn()],
      loopOut: ["Loop to here (])", () => transport.setOut()],
      loopReset: ["Loop over all (\\)", () => transport.resetRange()],
    };
  }

  #type() {
    const frame = Number.parseInt(this.field.value, 10);
    if (Number.isFinite(frame)) this.transport.jump(frame);
    this.drawFrame(true);
    this.field.blur();
  }

  /** Show the number of the frame, unless somebody is typing one. */
  drawFrame(isTyped = false) {
    const { field, transport } = this;
    if (isTyped || document.activeElement !== field) field.value = Math.min(Math.round(transport.frame), transport.last);
  }

  draw() {
    const { transport, range, speed } = this, { inPoint, outPoint } = transport;
    const words = transport.playing ? "Pause (Space)" : "Play (Space)";
    this.button.replaceChildren(icon(transport.playing ? "pause" : "play"));
    Object.assign(this.button, { title: words, ariaLabel: words, disabled: transport.numbers.length < 2 });
    if (range) range.textContent = transport.isLooped ? `Loop ${inPoint}–${outPoint}` : `${transport.first}–${transport.last}`;
    if (speed) speed.value = transport.speed;
    this.drawFrame();
  }

  /** The keys that all pages share, for the help. */
  get keys() {
    const { transport: t, field } = this;
    return [
      ["Space", "Play, pause", { " ": () => t.toggle() }],
      ["← →", "A frame back, on; also , and .", { ArrowLeft: () => t.step(-1), ",": () => t.step(-1), ArrowRight: () => t.step(1), ".": () => t.step(1) }],
      ["Shift ← →", "Ten frames", { "Shift+ArrowLeft": () => t.step(-10), "Shift+ArrowRight": () => t.step(10) }],
      ["Home End", "First, last frame", { Home: () => t.jump(t.first), End: () => t.jump(t.last) }],
      ["J K L", "Backwards, pause, forwards; again: faster", { j: () => t.shuttle(-1), k: () => t.pause(), l: () => t.shuttle(1) }],
      ["< >", "Slower, faster: 0.25× to 2×", { "<": () => t.changeSpeed(-1), ">": () => t.changeSpeed(1) }],
      ["I O", "Loop from here, to here; also [ ]", { i: () => t.setIn(), "[": () => t.setIn(), o: () => t.setOut(), "]": () => t.setOut() }],
      ["\\", "Loop over all frames", { "\\": () => t.resetRange() }],
      ["Enter", "Type a frame", { Enter: () => field.select() }],
    ];
  }
}
