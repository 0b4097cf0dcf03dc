// While something is dragged, the current frame as it would be. One request is under way at a time; of the states in
// between only the latest is asked for.

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

class Follow {
  constructor(page) {
    Object.assign(this, { page, waiting: null, isAsking: false, drags: false });
  }

  /** The pointer goes down on a value: until it moves the server can prepare the first picture. */
  prepare(where) { ask("prepare", { where, frame: this.page.film.at }).catch(() => {}); }

  /** Show the current frame with edits that are not written. */
  show(edits) {
    if (!edits.length) return;
    if (!this.drags) this.digest = this.page.shot.writes ? "" : this.page.shot.state.digest; // which our own edit changes
    this.drags = true;
    this.page.film.hold();
    this.waiting = edits;
    if (!this.isAsking) this.#ask();
  }

  /** The drag has ended with these edits: write them. */
  end(edits, gesture = "") {
    const digest = this.drags ? this.digest : "";
    this.waiting = null;
    this.drags = false;
    if (this.page.film.trial) this.page.film.trial.isDragged = false;
    if (edits.length) return this.page.shot.edit(edits, gesture, digest);
    this.cancel();
    return Promise.resolve();
  }

  /** The drag was given up: show the file as it is. */
  cancel() {
    this.waiting = null;
    this.drags = false;
    this.page.film.endTrial();
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
