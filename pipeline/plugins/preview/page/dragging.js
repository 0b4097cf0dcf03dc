// What is dragged: elements that edit a value, and the camera. Meanwhile the current frame is shown as it would be: one
// request is under way at a time; of the states in between only the latest is asked for.

/**
 * Edit a value by dragging an element, and by its arrow keys. Until a drag is over no new state is drawn, which would
 * replace what is dragged.
 *
 * edits(event, begun)        what a drag changes, from event to event
 * draw(event, begun)         moves what is dragged
 * keyed(right, down, many)   what arrow keys change; `gesture(right)` names changes that are undone together
 */
function editable(page, element, where, { edits, draw, keyed, gesture, many, isOn, ...more }) {
  gestures(element, {
    ...more,
    start: () => { more.start?.(); page.follow.prepare(where); },
    move: (event, begun) => { draw?.(event, begun); page.follow.show(edits(event, begun)); },
    end: (event, begun) => page.follow.end(edits(event, begun)),
    cancel: () => page.follow.cancel(),
    over: (isDone) => isDone || page.draw(),
  });
  const press = (...way) => {
    const change = keyed(...way);
    if (change.length) page.shot.edit(change, gesture(...way));
  };
  arrowKeys(element, press, { many, isOn });
}

/** What is dragged, or moved by arrow keys: a slider in words, whose name for `redrawn` is `focus`. */
function handleOf(label, focus, now, words = now) {
  return svg("g", { class: "point", tabindex: 0, role: "slider", "aria-label": label, "aria-valuenow": now, "aria-valuetext": words, data: { focus } });
}

class Follow {
  constructor(page) { Object.assign(this, { page, waiting: null, isAsking: false, drags: false }); }

  /** The pointer goes down on a value: until it moves the server can prepare the first picture. */
  prepare(where) { ask("prepare", { where, frame: this.page.film.at }).catch(() => {}); }

  /** Show the current frame with edits that are not written. */
  show(edits) {
    if (!edits.length) return;
    if (this.performs ||= this.page.perform.isRecording) return this.page.perform.play(edits);
    if (!this.drags) this.digest = this.page.shot.writes ? "" : this.page.shot.state.digest; // which our own edit changes
    this.drags = true;
    this.page.film.hold();
    this.waiting = edits;
    if (!this.isAsking) this.#ask();
  }

  /** The drag has ended with these edits: write them. */
  end(edits, gesture = "") {
    const digest = this.drags ? this.digest : "", isLate = this.performs && !this.page.perform.isRecording;
    Object.assign(this, { waiting: null, drags: false, performs: false });
    if (this.page.film.trial) this.page.film.trial.isDragged = false;
    if (edits.length && !isLate) return this.page.shot.edit(edits, gesture, digest); // late: its recording has ended
    this.cancel();
    return Promise.resolve();
  }

  /** The drag was given up: show the file as it is. */
  cancel() {
    Object.assign(this, { waiting: null, drags: false, performs: false });
    if (!this.page.perform.isRecording) this.page.film.endTrial();
    this.page.draw();
  }

  async #ask() {
    this.isAsking = true;
    while (this.waiting) {
      const edits = this.waiting, { film, shot } = this.page, frame = film.at;
      this.waiting = null;
      try {
        const answer = await ask("follow", { digest: shot.state.digest, edits, frame });
        if (this.drags && film.at === frame) {
          film.setTrial({ source: `data:image/jpeg;base64,${answer.picture}`, camera: answer.camera, words: answer.words, isDragged: true });
        }
      } catch (error) {
        if (!(error instanceof RefusedError)) throw error;
        this.page.note(error.message); // a value on the way that the shot cannot have; the release says it aloud
      }
    }
    this.isAsking = false;
  }
}

const SETTLED = 350; // ms after the last turn of the wheel
const DEGREES = 180 / Math.PI;

class CameraDrag {
  constructor(page, picture) {
    Object.assign(this, { page, wheeled: null });
    editable(page, picture, ["camera"], {
      start: () => { this.from = this.view; }, // while it is performed, the camera of the shot moves on
      edits: (event, begun) => this.turned(event.clientX - begun.clientX, event.clientY - begun.clientY, this.from),
      keyed: (right, down, many) => this.turned(10 * many * right, 10 * many * down),
      gesture: () => "camera",
      many: 3,
      isOn: () => picture.matches(":focus-visible"), // a click leaves them to time
      zoom: (factor) => this.zoom(factor),
    });
  }

  #value(name, otherwise) {
    const where = ["camera", name];
    return this.page.shot.get(where) ?? { where, form: "number", value: otherwise, curve: null };
  }

  /** Where the camera is now: its position, azimuth and elevation. */
  get view() {
    const { shot, film } = this.page, position = shot.get(["camera", "position"]);
    return [position, this.#value("azimuth", -30), this.#value("elevation", 14)].map((value) => value && shot.at(value, film.at));
  }

  /** The edits that orbit the camera by a drag of so many pixels, from where it was. */
  turned(dx, dy, [place, turn, height] = this.view) {
    const { shot, film, projection } = this.page, position = shot.get(["camera", "position"]);
    if (!shot.state || !projection) return [];
    if (position) {
      const view = { position: place, target: projection.camera.target, up: [0, 1, 0] };
      return shot.change(position, turnedView(view, dx, dy).position.map((part) => rounded(part, 0.01)), film.at);
    }
    const azimuth = this.#value("azimuth", -30), elevation = this.#value("elevation", 14);
    const formula = [azimuth, elevation].find((value) => value.curve && value.curve.formula !== null);
    if (formula) this.page.note(formulaNote(formula));
    const around = turn - TURN * DEGREES * dx, up = clamp(height + TURN * DEGREES * dy, -89, 89);
    return [
      ...(dx ? shot.change(azimuth, rounded(around, 1), film.at) : []),
      ...(dy ? shot.change(elevation, rounded(up, 1), film.at) : []),
    ];
  }

  /** Move closer or farther; it is written a while after the last time. */
  zoom(factor) {
    const { shot, film, follow } = this.page;
    if (!shot.state || shot.get(["camera", "position"])) return;
    const value = shot.get(["camera", "distance"]) ?? this.#value("dolly", 1);
    this.wheeled ??= { factor: 1 };
    this.wheeled.factor *= factor;
    const now = shot.at(value, film.at) * this.wheeled.factor, edits = shot.change(value, rounded(now, now / 100), film.at);
    follow.show(edits);
    clearTimeout(this.wheeled.timer);
    Object.assign(this.wheeled, { edits, timer: setTimeout(() => this.settle(), SETTLED) });
  }

  /** Write what the wheel has done, if anything. */
  settle() {
    const { wheeled } = this;
    if (!wheeled) return;
    this.wheeled = null;
    clearTimeout(wheeled.timer);
    this.page.follow.end(wheeled.edits);
  }
}
