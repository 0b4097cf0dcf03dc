// The shot file as the server tells it, its values by their paths, and edits of them. Each request to the server has a JSON
// object as its answer, or is refused with one message.

/** The file was changed meanwhile, a value is bad, the disk refuses, or the server has ended. */
class RefusedError extends Error {}

const ENDED = "flowsculpt has ended, so nothing was written. Start it again and open its new address.";

/** Ask the server by the name of a request. Throws RefusedError. */
async function ask(name, body) {
  const about = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  const answer = await fetch(name, about).catch(() => { throw new RefusedError(ENDED); });
  const data = await answer.json().catch(() => ({ error: `The server answers ${answer.status}; load the page again.` }));
  if (!answer.ok) throw new RefusedError(data.error);
  return data;
}

const nameOf = (where) => where.join(".");

class Shot {
  constructor(page) {
    Object.assign(this, { page, state: null, values: new Map(), last: Promise.resolve() });
    this.writes = 0; // edits that the server has not answered yet
  }

  get(where) { return this.values.get(nameOf(where)); }

  /** What a value is called, which may be gone from the file. */
  wordsOf(where) { return this.get(where)?.words ?? nameOf(where); }

  /** Read the file anew. */
  refresh() { return this.#next(() => ask("state", { frame: this.page.film.at }), false); }

  /** Write edits. Those with the same gesture, one after another, are undone together. A drag names the text that it
   *  began with; other edits are of the text that the page shows. */
  edit(edits, gesture = "", digest = "") {
    if (this.page.perform.isRecording) return Promise.resolve(this.page.perform.play(edits));
    this.state = { ...this.state, can_undo: true }; // undo waits for it
    refresh();
    return this.#next(() => ask("edit", { digest: digest || this.state.digest, edits, gesture, frame: this.page.film.at }));
  }

  undo() {
    this.page.camera.settle();
    return this.#step("undo", "can_undo");
  }

  redo() { return this.#step("redo", "can_redo"); }

  #step(name, can) { return this.#next(() => this.state?.[can] && ask(name, { digest: this.state.digest, frame: this.page.film.at })); }

  /** Requests go one after another, for each names the text that the one before has made. One may find that there is
   *  nothing to ask. */
  #next(request, isEdit = true) {
    this.writes += isEdit;
    this.last = this.last.then(async () => {
      try {
        const state = await request();
        if (state) this.#take(state);
        if (isEdit) this.page.refused("");
      } catch (error) {
        if (!(error instanceof RefusedError)) throw error;
        if (isEdit) {
          this.page.refused(error.message);
          this.page.film.endTrial();
          await ask("state", {}).then((state) => this.#take(state), () => this.page.draw());
        }
      } finally {
        this.writes -= isEdit;
      }
    });
    return this.last;
  }

  #take(state) {
    this.state = state;
    this.values = new Map(state.values.map((value) => [nameOf(value.where), value]));
    this.page.draw();
  }

  /** The frame by the time of a flow, where `speed`, `reversed` or `repeated` gives it one of its own. */
  frameOf(where, frame) {
    const around = this.state.flow_frames.filter((each) => each.where.every((part, i) => part === where[i]));
    const { frames } = around.reduce((inner, each) => (each.where.length > (inner.where?.length ?? -1) ? each : inner), {});
    return frames?.[frame - this.state.first] ?? frame;
  }

  /** The value at a frame: of a curve by its samples, three numbers of a vector or an axis. */
  at(value, frame) {
    if (value.form === "axis" && typeof value.value === "string") return vectorOf(value.value);
    const live = this.page.perform.live.get(nameOf(value.where)); // as it is performed
    if (live !== undefined || !value.curve) return live ?? value.value;
    const { frames, values } = value.curve, last = frames.length - 1;
    const place = clamp(((frame - frames[0]) / (frames[last] - frames[0] || 1)) * last, 0, last);
    const i = Math.min(last - 1, Math.floor(place)), share = last ? place - i : 0;
    const row = last ? values[i].map((start, k) => start + share * (values[i + 1][k] - start)) : values[0];
    return value.is_vector ? row : row[0];
  }

  /** The edits that give a value something new at a frame: of keys the key there, which may be new. */
  change(value, given, frame) {
    if (!value.curve) return [{ kind: "set", where: value.where, value: given }];
    if (value.curve.formula !== null) return [];
    const key = value.curve.keys.find((each) => Math.abs(each.frame - frame) < 1e-6);
    const where = [...value.where, "keys", key ? key.time : frame];
    if (key?.is_detailed) where.push("value");
    return [{ kind: "set", where, value: given }];
  }
}

const formulaNote = (value) => `${nameOf(value.where)} is a formula, which the pointer does not change.`;

/** A number in as many digits as a drag of this length deserves. */
function rounded(number, step) {
  const digits = Math.max(0, Math.min(9, Math.ceil(-Math.log10(Math.abs(step) || 1)) + 1));
  return +number.toFixed(digits);
}
