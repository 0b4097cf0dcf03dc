// While something is dragged, the current frame as it would be. One request is under way at a time; of the states in
// between only the latest is asked for.

/** Follow a drag of a part of the page. Until it is over no new state is drawn, which would replace what is dragged. */
function dragOf(element, acts) { gestures(element, { ...acts, over: (isDone) => isDone || page.draw() }); }

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
