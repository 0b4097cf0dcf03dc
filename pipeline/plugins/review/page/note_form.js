// The form on a card in which the words and the frames of a note are written.

class NoteForm {
  constructor(review) {
    Object.assign(this, { review, id: null, words: "", frames: "" });
    window.addEventListener("pagehide", () => this.finish());
  }

  begin(note) { Object.assign(this, { id: note.id, words: note.text, frames: framesOf(note) }); }

  /** Save what was typed, if a note is being written; frames that are not in the shot stay as they were. */
  finish() {
    if (!this.id) return;
    const { notes } = this.review, note = notes.get(this.id), [first, last] = this.#framesTyped(note) ?? [note.first, note.last];
    const fields = { text: printed(this.words), first, last };
    if (Object.entries(fields).some(([name, value]) => note[name] !== value)) notes.editUndoably(this.id, fields);
    this.#end();
  }

  /** Leave the note as it was; one that was just begun goes. */
  #end() {
    const { notes } = this.review, note = notes.get(this.id);
    this.id = null;
    document.activeElement.blur();
    if (saysNothing(note)) notes.forget(note.id);
    this.review.redraw();
  }

  element(note) {
    const words = make("textarea", { value: this.words, rows: 4, placeholder: "What should change, or what is right", ariaLabel: "Words of the note" });
    const frames = make("input", { type: "text", value: this.frames, autocomplete: "off", ariaLabel: "Frames of the note, as 12 or 12-20" });
    const save = () => {
      if (this.#framesTyped(note)) return this.finish();
      tell(`“${frames.value}” are no frames of the shot, which has ${this.#framesOfShot(note).join("–")}: write 12, or 12-20.`, true);
      return frames.focus();
    };
    for (const field of [words, frames]) {
      field.addEventListener("input", () => Object.assign(this, { words: words.value, frames: frames.value }));
      field.addEventListener("keydown", (event) => {
        if (event.key === "Enter" && (event.ctrlKey || event.metaKey || field === frames)) save();
        else if (event.key === "Escape") this.#end();
        else return;
        event.preventDefault();
      });
    }
    const label = make("label", "inline", "Frames ", frames);
    return make("div", "note-form", words, make("div", "note-actions", label, make("span", "grow"),
      buttonOf("Cancel", "Leave the note as it was (Esc)", () => this.#end()), buttonOf("Save", "Save (Ctrl Enter)", save)));
  }

  /** The frames that were typed as [first, last], or null where they are not in the shot. */
  #framesTyped(note) {
    const [, first, last = first] = /^\s*(-?\d+)\s*(?:[-–:]\s*(-?\d+))?\s*$/.exec(this.frames) ?? [];
    const frames = [Number(first), Number(last)].sort((one, other) => one - other), [low, high] = this.#framesOfShot(note);
    return first !== undefined && low <= frames[0] && frames[1] <= high ? frames : null;
  }

  /** The first and the last frame that a note may have. */
  #framesOfShot({ shot, first, last }) {
    const numbers = this.review.shots[shot]?.numbers ?? [-1e6, 1e6];
    return [Math.min(first, numbers[0]), Math.max(last, numbers.at(-1))];
  }
}
