// Performing: values are armed, and what hands and devices do to them is recorded while the shot plays. The server records,
// fits keys and keeps takes; the page sends what it hears, and shows what comes.

const HEARTBEAT = 500; // ms after which the server hears of the page while it records
const DRIFT = 0.15; // seconds by which sound and picture may differ
const MOVES = "onpointerrawupdate" in window ? "pointerrawupdate" : "pointermove"; // at once, or once a frame of the display

class Perform {
  constructor(page) {
    Object.assign(this, { page, state: { armed: [], takes: [], controls: [], recording: false, words: "" }, speed: 1, whole: true });
    Object.assign(this, { number: 0, live: new Map(), waiting: [], pads: new Map(), sound: new ShotSound() });
    this.element = make("details", { open: true, data: { group: "perform" } });
    const record = buttonOf("", "Record what moves the armed values (R)", () => this.record(), {
      id: "record", className: "record", textContent: () => (this.isRecording ? "Stop" : "Record"), ariaPressed: () => this.isRecording,
    });
    id("perform").append(record, listOf("Speed of recording", [[1, "1×"], [0.5, "½×"], [0.25, "¼×"]], (speed) => { this.speed = +speed; }));
    for (const name of ["pointerdown", MOVES]) id("viewer").addEventListener(name, (event) => this.#point(event), true);
    for (const name of [MOVES, "pointermove"]) addEventListener(name, (event) => this.#passOn(event), true);
    setInterval(() => { if (this.isRecording) this.#send(true); }, HEARTBEAT);
    this.draw();
  }

  get isRecording() { return this.state.recording; }
  isArmed(where) { return this.state.armed.some((each) => nameOf(each.where) === nameOf(where)); }

  async #ask(what, more = {}) {
    try {
      await ask("perform", { do: what, ...more });
      this.page.refused("");
    } catch (error) {
      if (!(error instanceof RefusedError)) throw error;
      this.page.refused(error.message);
    }
  }

  /** Another text of the shot: it may have the keys of other takes. */
  refresh() { return this.state.takes.length && this.#ask("state"); }

  /** Arm a value, or disarm it. */
  arm(where) {
    this.#openDevices();
    return this.#ask("arm", { where });
  }

  /** Arm the value whose row, handle or key has the focus; on the picture the direction of the camera. */
  armFocused() {
    const focused = document.activeElement, { values } = this.page.shot;
    const name = focused.closest("[data-path]")?.dataset.path ?? focused.dataset.focus?.split(" ")[0];
    for (const each of focused === id("picture") ? ["camera.azimuth", "camera.elevation"] : [name]) if (values.has(each)) this.arm(values.get(each).where);
  }

  async record() {
    if (this.isRecording) return this.#ask("stop");
    await this.page.shot.last;
    await this.sound.load(this.page.film.take.take);
    this.page.film.hold();
    return this.#ask("record", { frame: this.page.film.at, speed: this.speed, whole: this.whole });
  }

  /** What the server says of all that is armed, and of takes. */
  take(state) {
    const wasRecording = this.isRecording;
    this.state = state;
    this.live.clear();
    this.draw();
    refresh();
    if (!wasRecording || state.recording) return this.page.handles.draw();
    this.sound.stop();
    this.page.film.endTrial();
    this.page.shot.refresh();
  }

  /** A picture of the performance came. All else is drawn once a frame of the display, for the latest of several. */
  heard(message) {
    if (!this.isRecording) return;
    if (!this.latest) requestAnimationFrame(() => this.show(this.latest));
    this.latest = message;
    this.number = message.number;
    this.#send(true); // the server waits for the page, so that pictures do not queue up
    message.source = `data:image/jpeg;base64,${message.picture}`;
    id("picture").src = message.source; // at once: it is decoded before the next frame of the display
  }

  show({ frame, position, source, camera, words, values }) {
    const { film } = this.page;
    this.latest = null;
    if (!this.isRecording) return;
    for (const [where, row] of values) this.live.set(nameOf(where), row.length > 1 ? row : row[0]);
    film.trial = { source, camera, words, isDragged: true, frame };
    if (film.at !== frame) film.transport.go(frame);
    this.sound.play((position - film.take.first) / film.take.fps, this.state.fps / film.take.fps);
  }

  /** Edits that would be written are samples while the server records. */
  play(edits) {
    if (!this.isRecording) return;
    for (const { where, value } of edits) {
      const end = where.indexOf("keys"), path = end < 0 ? where : where.slice(0, end);
      if (this.isArmed(path)) {
        this.live.set(nameOf(path), value);
        this.#hear(this.movedAt ?? performance.now(), "value", path, value);
      } else this.page.note(`${nameOf(path)} is not armed, so it is not recorded.`);
    }
  }

  #hear(time, ...input) {
    this.waiting.push([time, ...input]);
    this.#send();
  }

  /** Send what was heard, by a connection that stays open: a request for each movement would keep the page busy. */
  #send(always = false) {
    this.socket ??= Object.assign(new WebSocket(new URL("inputs", location.href.replace("http", "ws"))), {
      onopen: () => this.#send(), onmessage: ({ data }) => this.page.refused(data), onclose: () => { this.socket = null; },
    });
    if (this.socket.readyState !== WebSocket.OPEN) return; // what waits is sent once it is open
    for (let first = always; first || this.waiting.length; first = false) {
      const now = performance.now(), inputs = this.waiting.splice(0, 1000).map(([time, ...input]) => [now - time, ...input]);
      this.socket.send(JSON.stringify({ do: "play", shown: this.number, inputs }));
    }
  }

  /** Let what is dragged follow the pointer at once: browsers tell of its moves once a frame of the display. */
  #passOn(event) {
    if (!this.isRecording || !event.isTrusted || MOVES === "pointermove") return;
    if (event.type === "pointermove") return event.stopImmediatePropagation(); // it was passed on before
    this.movedAt = event.timeStamp;
    event.target.dispatchEvent(new PointerEvent("pointermove", event));
    this.movedAt = null;
  }

  #isBound(start) { return this.state.armed.some(({ parts }) => parts.some(({ control }) => control.startsWith(start) || control === "learn")); }

  /** The pointer over the picture, with all places between two frames of the display. */
  #point(event) {
    if (!this.isRecording || !this.#isBound("p")) return;
    for (const each of event.getCoalescedEvents?.().concat(event.type === "pointerdown" ? event : []) ?? [event]) {
      const { x, y } = shareOf(id("picture"), each);
      this.#hear(each.timeStamp, "pointer", clamp(x, 0, 1), clamp(1 - y, 0, 1), ...(each.pointerType === "pen" ? [each.pressure] : []));
    }
  }

  /** Listen to MIDI and gamepads, once something is armed: the browser may ask whoever sits there. */
  #openDevices() {
    if (this.isOpen) return;
    this.isOpen = true;
    navigator.requestMIDIAccess?.().then((midi) => {
      const listen = () => midi.inputs.forEach((input) => {
        input.onmidimessage = ({ data, timeStamp }) => this.#isBound("midi") && this.#hear(timeStamp, "midi", ...data);
      });
      midi.onstatechange = listen;
      listen();
    }, () => {}); // refused: there are other ways to perform
    const poll = () => {
      if (this.#isBound("gamepad")) this.#pollGamepads();
      requestAnimationFrame(poll);
    };
    poll();
  }

  #pollGamepads() {
    for (const pad of navigator.getGamepads?.() ?? []) {
      [pad?.axes ?? [], pad?.buttons.map(({ value }) => value) ?? []].forEach((values, kind) => values.forEach((value, i) => {
        const name = `${pad.index} ${kind} ${i}`, last = this.pads.get(name);
        this.pads.set(name, value);
        if (last !== undefined && Math.abs(value - last) > 0.002) this.#hear(performance.now(), "gamepad", kind, i, value);
      }));
    }
  }

  /** The group of the panel: what moves each armed value, and which take each value has. */
  draw() {
    const { armed, takes, words } = this.state;
    redrawn(this.element, () => this.element.replaceChildren(
      make("summary", {}, make("b", {}, "Perform"), " ", make("small", {}, armed.length ? `${armed.length} armed` : "nothing armed")),
      ...(armed.length ? [] : [make("p", "note", "● beside a value arms it, and A the handle that has the focus. R records.")]),
      ...armed.flatMap((each) => this.#armedRows(each)),
      ...(armed.length ? [make("label", "inline", make("input", { type: "checkbox", checked: this.whole, onchange: (event) => { this.whole = event.target.checked; } }), "keys on whole frames")] : []),
      ...takes.map((each) => this.#takeRow(each)),
      make("p", { className: "note", role: "status" }, words),
    ));
  }

  #armedRows({ where, parts }) {
    const title = this.page.shot.wordsOf(where), disarm = buttonOf("●", "Disarm", () => this.arm(where), { className: "key plain armed", ariaLabel: `${title}: disarm` });
    return [make("div", "bound", make("span", { className: "name", title: nameOf(where) }, title), disarm), ...parts.map((bound, part) => this.#boundRow(where, bound, part, parts.length > 1 ? "xyz"[part] : ""))];
  }

  #boundRow(where, bound, part, letter) {
    const name = `${this.page.shot.wordsOf(where)} ${letter}`;
    const bind = (change) => this.#ask("bind", { where, part, ...bound, ...change });
    const list = listOf(`${name}: moved by`, this.state.controls, (control) => bind({ control }), { value: bound.control, data: { focus: `${name} by` } });
    const ends = ["low", "high"].map((end) => make("input", {
      type: "text", inputMode: "decimal", value: written(bound[end]), ariaLabel: `${name}: ${end} end`, title: `Its value at the ${end} end of the control`, data: { focus: `${name} ${end}` },
      onchange: (event) => { if (Number.isFinite(+event.target.value)) bind({ [end]: +event.target.value }); },
    }));
    return make("div", "bound", make("span", "about", letter), list, ends[0], make("span", "about", "to"), ends[1]);
  }

  #takeRow({ where, takes, chosen }) {
    const name = this.page.shot.wordsOf(where), choose = (take) => this.#ask("choose", { where, take });
    return make("div", "bound", make("span", { className: "name", title: nameOf(where) }, name), listOf(`${name}: take`, takes, choose, { value: chosen, data: { focus: `${name} take` } }));
  }
}

/** The sound of the shot, which plays with a performance. */
class ShotSound {
  /** Load the sound of a take of the film, unless it is there. */
  async load(take) {
    if (this.take === take) return;
    Object.assign(this, { take, buffer: null });
    const data = await fetch("sound.wav").then((answer) => answer.arrayBuffer(), () => null);
    if (!data?.byteLength) return; // a silent shot
    this.context ??= new AudioContext();
    this.buffer = await this.context.decodeAudioData(data).catch(() => null);
  }

  /** Be at a second of the shot, at a speed. */
  play(second, speed) {
    if (!this.buffer) return;
    if (this.source && Math.abs(this.begun + speed * (this.context.currentTime - this.at) - second) < DRIFT) return;
    this.stop();
    this.source = new AudioBufferSourceNode(this.context, { buffer: this.buffer, playbackRate: speed });
    this.source.connect(this.context.destination);
    Object.assign(this, { begun: second, at: this.context.currentTime });
    this.source.start(0, clamp(second, 0, this.buffer.duration));
  }

  stop() {
    this.source?.stop();
    this.source = null;
  }
}
