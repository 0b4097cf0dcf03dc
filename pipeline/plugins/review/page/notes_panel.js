// The panel of notes: who says what about which frames, what has been decided, and the form in which a note is written.

const STATUS_NAMES = { open: ["Open", "7"], change: ["Change", "8"], approved: ["Approved", "9"] };

class NotesPanel {
  constructor(element, review) {
    Object.assign(this, { element, review, showsAll: false, status: null, found: [], form: new NoteForm(review) });
    element.classList.add("notes");
    this.#build();
  }

  // What people ask for

  /** Begin a note on this frame, or on these frames, and wait for its words. */
  write(first, last) {
    const { review } = this;
    review.transport.pause();
    review.showTab("notes");
    this.#choose(review.notes.add(review.shownSequence, first, last));
    this.edit();
  }

  /** Edit the words and the frames of the chosen note. */
  edit() {
    if (!this.#chosen()) return;
    this.review.showTab("notes");
    this.form.begin(this.#chosen());
    this.#list();
    this.element.querySelector("textarea")?.focus();
    if (!this.review.notes.author) tell("Write your name above the notes, so that others know whose they are.");
  }

  setStatus(status) {
    const note = this.#chosen();
    if (note && note.status !== status) this.review.notes.editUndoably(note.id, { status });
  }

  remove() {
    const note = this.#chosen();
    if (!note) return;
    this.review.notes.editUndoably(note.id, { deleted: true });
    tell("The note is deleted; U brings it back.");
  }

  /** Choose the note before or after, and go to its frame. */
  step(way) {
    const notes = this.#notes(), frame = this.review.transport.frame;
    const place = notes.findIndex((note) => note.id === this.review.chosenNote);
    let next = notes[place + way];
    if (place < 0) next = way > 0 ? notes.find((note) => note.first >= frame) : notes.findLast((note) => note.first <= frame);
    if (next) this.#goTo(next);
  }

  /** List the notes of the whole page, or those of what is shown; of one status, or with null all. */
  list({ showsAll = this.showsAll, status = this.status }) { this.review.change(this, { showsAll, status }); }

  /** List notes of the next status; after the last, all. */
  listNext() {
    this.review.showTab("notes");
    this.list({ status: nextOf([null, ...STATUSES], this.status) });
  }

  #chosen() {
    const note = this.review.notes.get(this.review.chosenNote);
    return note && !note.deleted ? note : null;
  }

  /** Choose a note; the words of another one that is being edited are saved. */
  #choose(id) {
    this.review.chosenNote = id;
    if (this.form.id !== id) this.form.finish();
  }

  /** Show what a note is about: its first frame, of its sequence. */
  #goTo(note) {
    const { review } = this;
    const own = this.#sequenceOf(note);
    this.#choose(note.id);
    if (own && !review.shownSequences.some((each) => review.notes.of(each).includes(note))) review.choose(review.mode === "b" ? "b" : "a", own);
    review.transport.jump(note.first);
    review.redraw();
  }

  /** The notes of the page, or of the sequences that are shown. */
  #inScope() {
    const { notes, shownSequences } = this.review;
    if (this.showsAll) return notes.all;
    const shown = new Set(shownSequences.flatMap((each) => notes.of(each)));
    return notes.all.filter((note) => shown.has(note));
  }

  /** Those of them that are listed; the chosen one and the one being edited stay. */
  #notes() {
    const kept = [this.review.chosenNote, this.form.id];
    return this.#inScope().filter((note) => !this.status || note.status === this.status || kept.includes(note.id));
  }

  /** Tell whether cards name their sequence. */
  get #namesSequences() { return this.showsAll || this.review.shownSequences.length > 1; }

  // How it looks

  #build() {
    const { review } = this, { notes } = review;
    const name = make("input", {
      type: "text", maxLength: 200, placeholder: "Your name", autocomplete: "name", ariaLabel: "Your name, which your notes carry",
      value: () => notes.author, onchange: () => { notes.author = name.value; },
    });
    const scopes = [[false, "Shown", "Notes of the sequence that is shown (Shift Q)"], [true, "All", "All notes of this page (Shift Q)"]];
    const scope = choiceOf("Which notes", scopes, () => this.showsAll, (showsAll) => this.list({ showsAll }));
    const begin = buttonOf("Note on this frame", "Write a note on this frame (A); on the loop: Shift N", () => review.writeNote());
    const draw = buttonOf("Draw", "Draw over the picture (B)", () => review.drawing.toggle(), { ariaPressed: () => review.drawing.isOn });
    const count = (status) => this.found.filter((note) => note.status === status).length;
    const statuses = STATUSES.map((status) => {
      const act = () => this.list({ status: this.status === status ? null : status });
      const about = { className: status, textContent: () => `${STATUS_NAMES[status][0]} ${count(status)}`, ariaPressed: () => this.status === status };
      return buttonOf("", "List only these notes, or all (Shift X: the next)", act, about);
    });
    const counts = make("div", { className: "notes-counts", role: "group", ariaLabel: "Notes by status", hidden: () => !this.found.length }, ...statuses);
    const downloads = Object.entries(NOTE_FORMS).map(([form, [words, key]]) => (
      buttonOf(words, `Download all notes as ${words} (${key})`, () => downloadNotes(review, form))
    ));
    const kept = make("span", {
      className: () => `notes-kept${notes.isSaved ? "" : " fault"}`, textContent: () => (notes.isSaved ? "Download" : "Not kept: download"),
    });
    const load = buttonOf("Load…", "Merge a file of notes; or drop it on the page (Shift L)", () => id("notes-file").click());
    this.cards = make("ul", "notes-list");
    this.element.append(
      make("div", "notes-bar", name, scope), make("div", "notes-begin", begin, draw), counts, this.cards,
      make("div", "notes-files", kept, ...downloads, make("span", "grow"), load),
    );
  }

  draw() {
    this.found = this.#inScope();
    refresh(this.element);
    if (!this.cards.contains(document.activeElement) || !document.activeElement.matches("textarea, input")) this.#list();
  }

  /** Draw the cards again where anything on them has changed, and tell those of the frame that is shown. */
  #list() {
    const notes = this.#notes(), { frame } = this.review.transport, { chosenNote } = this.review;
    const states = notes.map((note) => [note.id, note.modified, note.id === chosenNote, note.id === this.form.id, this.#namesSequences].join());
    if (states.join("\n") !== this.state) this.#showCards(notes, states);
    this.state = states.join("\n");
    notes.forEach((note, i) => this.cards.children[i].classList.toggle("here", note.first <= frame && frame <= note.last));
  }

  /** Show a card for each note; those whose note is as it was stay, for a list may be long. */
  #showCards(notes, states) {
    const focused = document.activeElement.closest("[data-note]")?.dataset.note;
    const there = new Map([...this.cards.children].map((card) => [card.state, card]));
    const cards = notes.map((note, i) => there.get(states[i]) ?? Object.assign(this.#card(note), { state: states[i] }));
    const none = make("li", "notes-none", this.showsAll ? "No notes on this page yet." : "No notes on this sequence yet.");
    this.cards.replaceChildren(...(notes.length ? cards : [none]));
    refresh(this.cards);
    const cardOf = (id) => cards.find((card) => card.dataset.note === id);
    if (focused && document.activeElement === document.body) cardOf(focused)?.querySelector("button").focus();
    cardOf(this.review.chosenNote)?.scrollIntoView({ block: "nearest" });
  }

  #card(note) {
    const { review } = this, isChosen = note.id === review.chosenNote;
    const frames = buttonOf(framesOf(note), `Go to frame ${note.first}`, () => this.#goTo(note), { className: "note-frames", ariaCurrent: isChosen });
    const earlier = note.history.length ? `; ${note.history.length} earlier versions are kept` : "", title = `Written ${minuteOf(note.created)} UTC${earlier}`;
    const about = make("span", { className: "about note-about", title }, make("bdi", {}, authorOf(note)), ` · ${minuteOf(note.modified)}`);
    const extras = [note.drawings.length ? strokesOf(note) : "", this.#isOutdated(note) ? "the picture has changed since" : ""].filter(Boolean);
    const isEdited = this.form.id === note.id, words = (name, text) => (text ? [make("p", name, text)] : []);
    return make("li", {
      className: `note-card ${note.status}${isChosen ? " chosen" : ""}`, data: { note: note.id },
      onclick: (event) => { if (!event.target.closest("button, textarea, input")) this.#goTo(note); },
    },
      make("div", "note-head", frames, make("span", "note-status", STATUS_NAMES[note.status][0]), make("span", "grow"), about),
      ...words("note-sequence", this.#namesSequences && (review.isAlone ? note.sequence : `${note.shot} · ${note.sequence}`)),
      ...(isEdited ? [this.form.element(note)] : words("note-text", note.text)),
      ...words("note-extras", extras.join(" · ")),
      ...(isChosen && !isEdited ? [this.#actions(note)] : []),
    );
  }

  /** Tell whether the first frame of a note has been rendered anew since it was written. */
  #isOutdated(note) {
    const key = this.#sequenceOf(note)?.fact(note.first, "key");
    return Boolean(note.picture && key && key !== note.picture);
  }

  #sequenceOf({ shot, sequence }) { return this.review.sequences.find((each) => each.shot === shot && each.label === sequence); }

  #actions(note) {
    const statuses = Object.entries(STATUS_NAMES).map(([status, [words, key]]) => [status, words, `${words} (${key})`]);
    return make("div", "note-actions",
      choiceOf("Status", statuses, () => note.status, (status) => this.setStatus(status)), make("span", "grow"),
      buttonOf("Edit", "Edit this note (R)", () => this.edit()), buttonOf("Delete", "Delete this note (Delete)", () => this.remove()));
  }
}

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
    const oninput = () => Object.assign(this, { words: words.value, frames: frames.value });
    const onkeydown = (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey || event.target === frames)) save();
      else if (event.key === "Escape") this.#end();
      else return;
      event.preventDefault();
    };
    return make("div", { className: "note-form", oninput, onkeydown }, words,
      make("div", "note-actions", make("label", "inline", "Frames ", frames), make("span", "grow"),
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
