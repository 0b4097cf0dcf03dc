// The controls of time: buttons, fields and keys, and the frames side by side.

class Playback {
  /** Makes the elements `buttons`, those of `names`, and `field`, `range` and `speed`, from which a page takes some. */
  constructor(transport, names) {
    const acts = this.#acts(transport), shown = names ?? Object.keys(acts);
    const buttons = shown.map((name) => iconButton(name, ...acts[name])), play = buttons[shown.indexOf("play")];
    const range = () => (transport.isLooped ? `Loop ${transport.inPoint}–${transport.outPoint}` : `${transport.first}–${transport.last}`);
    const speeds = SPEEDS.map((speed) => [speed, `${speed}×`]);
    Object.assign(this, {
      transport,
      buttons: make("div", { className: "cluster", role: "group", ariaLabel: "Playback" }, ...buttons),
      field: make("input", {
        type: "text", id: "frame", inputMode: "numeric", size: 5, autocomplete: "off", ariaLabel: "Frame",
        value: () => Math.min(Math.round(transport.frame), transport.last), onchange: () => this.#type(),
      }),
      range: make("span", { id: "range", className: "range", textContent: range }),
      speed: listOf("Speed", speeds, (speed) => transport.setSpeed(+speed), { id: "speed", value: () => transport.speed }),
    });
    transport.listen((what) => {
      if (what === "playing") play.replaceChildren(icon(transport.playing ? "pause" : "play"));
    });
  }

  /** What each button says and does, by its icon. */
  #acts(t) {
    const words = () => (t.playing ? "Pause (Space)" : "Play (Space)");
    return {
      first: ["First frame (Home)", () => t.jump(t.first)],
      back: ["Back a frame (←)", () => t.step(-1)],
      play: ["Play (Space)", () => t.toggle(), { title: words, ariaLabel: words, disabled: () => t.numbers.length < 2 }],
      ahead: ["On a frame (→)", () => t.step(1)],
      last: ["Last frame (End)", () => t.jump(t.last)],
      loopIn: ["Loop from here ([)", () => t.setIn()],
      loopOut: ["Loop to here (])", () => t.setOut()],
      loopReset: ["Loop over all (\\)", () => t.resetRange()],
    };
  }

  #type() {
    const frame = Number.parseInt(this.field.value, 10);
    this.field.blur();
    if (Number.isFinite(frame)) this.transport.jump(frame);
    refresh(this.field.parentElement);
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

const RULER_STEPS = [1, 2, 5, 10, 12, 24, 48, 100, 250, 500, 1000, 5000];

/** The frames side by side: their states, their numbers, the loop, and where time is. A drag scrubs. */
class FrameStrip {
  /**
   * stateOf   (frame) the class of its mark, "" for none
   * describe  (frame) words about it, for those who listen
   * hovered   (event, frame) the pointer is over a frame
   */
  constructor(element, transport, { stateOf, describe = () => "", hovered }) {
    Object.assign(this, { element, transport, stateOf, describe });
    Object.assign(element, { role: "slider", tabIndex: 0, ariaLabel: "Frame" });
    this.marks = svg("svg", { class: "marks", preserveAspectRatio: "none" });
    Object.assign(this, { ruler: make("div", "ruler"), loop: make("div", "loop"), head: make("div", "head") });
    element.append(this.loop, this.marks, this.ruler, this.head);
    const seek = (event) => transport.go(this.frameAt(event));
    gestures(element, { start: seek, move: seek, hover: (event) => hovered?.(event, this.frameAt(event)) });
    whenResized(element, () => this.draw());
    transport.listen((what) => (what === "frame" ? this.drawHead() : this.draw()));
  }

  get #count() { return this.transport.numbers.length; }

  /** The frame under a pointer. */
  frameAt(event) { return this.transport.numbers[columnAt(this.element, event, this.#count)]; }

  /** Where the frame at a place begins, as the share of the width that CSS takes. */
  left(place) { return `${(100 * place) / this.#count}%`; }

  /** Draw everything again. */
  draw() {
    this.marks.setAttribute("viewBox", `0 0 ${this.#count} 1`);
    this.marks.replaceChildren(...this.#runs().map(([state, from, to]) => svg("rect", { class: state, x: from, y: 0, width: to - from, height: 1 })));
    this.#drawRuler();
    const { numbers, isLooped, inPoint, outPoint } = this.transport;
    this.loop.hidden = !isLooped;
    Object.assign(this.loop.style, { left: this.left(numbers.indexOf(inPoint)), right: this.left(numbers.length - 1 - numbers.indexOf(outPoint)) });
    this.drawHead();
  }

  /** Frames with one state after another: [state, place of the first, place after the last]. */
  #runs() {
    const runs = [];
    this.transport.numbers.forEach((frame, place) => {
      const state = this.stateOf(frame);
      if (runs.at(-1)?.[0] === state) runs.at(-1)[2] = place + 1;
      else runs.push([state, place, place + 1]);
    });
    return runs.filter(([state]) => state);
  }

  #drawRuler() {
    const { numbers } = this.transport, cell = this.element.clientWidth / numbers.length;
    const step = RULER_STEPS.find((each) => each * cell > 52) ?? 10000;
    const shown = numbers.map((number, place) => [number, place]).filter(([number, place]) => !place || (number % step === 0 && place >= 0.6 * step));
    this.ruler.replaceChildren(...shown.map(([number, place]) => make("span", { textContent: number, style: `left: ${this.left(place + 0.5)}` })));
  }

  /** Show where time is. */
  drawHead() {
    const { transport, element } = this, { numbers, first, last } = transport, frame = Math.min(transport.frame, last);
    const place = numbers.includes(frame) ? numbers.indexOf(frame) : ((frame - first) / (last - first || 1)) * (numbers.length - 1);
    Object.assign(this.head.style, { left: this.left(place), width: this.left(1) });
    const words = this.describe(frame);
    Object.assign(element, { ariaValueMin: first, ariaValueMax: last, ariaValueNow: Math.round(frame) });
    element.ariaValueText = `frame ${Math.round(frame)} of ${last}${words && `, ${words}`}`;
  }
}
