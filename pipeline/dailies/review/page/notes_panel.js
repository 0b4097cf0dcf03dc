"use strict";
// The panel of notes: who says what about which frames, and what has been decided.

const STATUS_NAMES = { open: ["Open", "7"], change: ["Change", "8"], approved: ["Approved", "9"] };

class NotesPanel {
  constructor(element, review) {
    Object.assign(this, { element, review, showsAll: false, edited: null });
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
    const note = this.#chosen();
    this.edited = note.id;
    this.draft = { words: note.text, frames: framesOf(note) };
    this.#list();
    this.element.querySelector("textarea")?.focus();
  }

  setStatus(status) {
    const note = this.#chosen();
    if (note && note.status !== status) this.review.notes.editUndoably(note.id, { status });
  }

  remove() {
    const note = this.#chosen();
    if (!note) return;
    this.review.notes.editUndoably(note.id, { deleted: true });
    this.review.tell("The note is deleted; U brings it back.");
  }

  /** Choose the note before or after, and go to its frame. */
  step(way) {
    const notes = this.#notes(), frame = this.review.transport.frame;
    const place = notes.findIndex((note) => note.id === this.review.chosenNote);
    let next = notes[place + way];
    if (place < 0) next = way > 0 ? notes.find((note) => note.first >= frame) : notes.findLast((note) => note.first <= frame);
    if (next) this.#goTo(next);
  }

  setScope(showsAll) {
    this.showsAll = showsAll;
    this.draw();
  }

  #chosen() {
    const note = this.review.notes.get(this.review.chosenNote);
    return note && !note.deleted ? note : null;
  }

  /** Choose a note; the words of another one that is being edited are saved. */
  #choose(id) {
    const { edited } = this;
    this.review.chosenNote = id;
    if (edited && edited !== id) this.#save(edited);
  }

  /** Show what a note is about: its first frame, of its sequence. */
  #goTo(note) {
    const { review } = this;
    const own = review.sequences.find((each) => each.shot === note.shot && each.label === note.sequence);
    this.#choose(note.id);
    if (own && !review.shownSequences.some((each) => review.notes.of(each).includes(note))) review.choose(review.mode === "b" ? "b" : "a", own);
    review.jump(note.first);
    review.redraw();
  }

  #notes() {
    const { notes, shownSequences } = this.review;
    if (this.showsAll) return notes.all;
    const shown = new Set(shownSequences.flatMap((each) => notes.of(each)));
    return notes.all.filter((note) => shown.has(note));
  }

  /** Tell whether cards name their sequence. */
  get #namesSequences() { return this.showsAll || this.review.shownSequences.length > 1; }

  // How it looks

  #build() {
    const { review } = this, bar = part("div", "notes-bar");
    const name = Object.assign(document.createElement("input"), { type: "text", maxLength: 200, placeholder: "Your name", autocomplete: "name" });
    name.setAttribute("aria-label", "Your name, which your notes carry");
    name.addEventListener("change", () => { review.notes.author = name.value; });
    this.name = name;
    this.scopes = [["Shown", false, "Notes of the sequence that is shown"], ["All", true, "All notes of this page"]].map(([words, all, title]) => (
      toggle(words, `${title} (Shift Q)`, () => this.setScope(all))
    ));
    const scopes = part("div", "segments", ...this.scopes);
    scopes.setAttribute("role", "group");
    scopes.setAttribute("aria-label", "Which notes");
    bar.append(name, scopes);
    const begin = part("div", "notes-begin",
      toggle("Note on this frame", "Write a note on this frame (A); on the loop: Shift A", () => review.writeNote()),
      toggle("Draw", "Draw over the picture (B)", () => review.drawing.toggle()));
    this.drawButton = begin.lastChild;
    this.list = part("ul", "notes-list");
    const files = part("div", "notes-files", part("span", "", "Download"),
      ...[["JSON", "json", "Shift J"], ["Text", "txt", "Shift T"], ["OTIO", "otio", "Shift O"]].map(([words, form, key]) => toggle(words, `Download all notes as ${words} (${key})`, () => downloadNotes(review, form))),
      part("span", "grow"), toggle("Load…", "Merge a file of notes; or drop it on the page (Shift L)", () => id("notes-file").click()));
    this.element.append(bar, begin, this.list, files);
  }

  draw() {
    const { review } = this;
    if (this.element.hidden) return;
    if (document.activeElement !== this.name) this.name.value = review.notes.author;
    this.scopes.forEach((button, i) => button.setAttribute("aria-pressed", this.showsAll === (i === 1)));
    this.drawButton.setAttribute("aria-pressed", review.drawing.isOn);
    if (!this.list.contains(document.activeElement) || !document.activeElement.matches("textarea, input")) this.#list();
  }

  /** Draw the cards again where anything on them has changed, and tell those of the frame that is shown. */
  #list() {
    const notes = this.#notes(), { frame } = this.review.transport;
    const state = JSON.stringify([notes.map((note) => [note.id, note.modified]), this.review.chosenNote, this.edited, this.#namesSequences, this.showsAll]);
    if (state !== this.state) this.#buildCards(notes);
    this.state = state;
    notes.forEach((note, i) => this.list.children[i].classList.toggle("here", note.first <= frame && frame <= note.last));
  }

  #buildCards(notes) {
    const focused = document.activeElement?.closest?.("[data-note]")?.dataset.note;
    this.list.replaceChildren(...notes.map((note) => this.#card(note)));
    if (!notes.length) this.list.append(part("li", "notes-none", this.showsAll ? "No notes on this page yet." : "No notes on this sequence yet."));
    if (focused) [...this.list.children].find((card) => card.dataset.note === focused)?.querySelector("button").focus();
  }

  #card(note) {
    const { review } = this, isChosen = note.id === review.chosenNote;
    const card = part("li", `note-card ${note.status}`);
    card.dataset.note = note.id;
    card.classList.toggle("chosen", isChosen);
    const frames = toggle(framesOf(note), `Go to frame ${note.first}`, () => this.#goTo(note));
    frames.className = "note-frames";
    if (isChosen) frames.setAttribute("aria-current", "true");
    const about = part("span", "note-about", `${authorOf(note)} · ${timeOf(note)}`);
    about.title = `Written ${note.created.slice(0, 16).replace("T", " ")} UTC${note.history.length ? `; ${note.history.length} earlier versions are kept` : ""}`;
    card.append(part("div", "note-head", frames, part("span", "note-status", STATUS_NAMES[note.status][0]), part("span", "grow"), about));
    if (this.#namesSequences) card.append(part("p", "note-sequence", `${review.isAlone ? "" : `${note.shot} · `}${note.sequence}`));
    if (this.edited === note.id) card.append(this.#form(note));
    else if (note.text) card.append(part("p", "note-text", note.text));
    const extras = [note.drawings.length ? strokesOf(note) : "", this.#isOutdated(note) ? "the picture has changed since" : ""].filter(Boolean);
    if (extras.length) card.append(part("p", "note-extras", extras.join(" · ")));
    if (isChosen && this.edited !== note.id) card.append(this.#actions(note));
    card.addEventListener("click", (event) => { if (!event.target.closest("button, textarea, input")) this.#goTo(note); });
    return card;
  }

  /** Tell whether the first frame of a note has been rendered anew since it was written. */
  #isOutdated(note) {
    const own = this.review.sequences.find((each) => each.shot === note.shot && each.label === note.sequence);
    return Boolean(note.picture && own?.fact(note.first, "key") && own.fact(note.first, "key") !== note.picture);
  }

  #actions(note) {
    const statuses = part("div", "segments", ...Object.entries(STATUS_NAMES).map(([status, [words, key]]) => {
      const button = toggle(words, `${words} (${key})`, () => this.setStatus(status));
      button.setAttribute("aria-pressed", note.status === status);
      return button;
    }));
    statuses.setAttribute("role", "group");
    statuses.setAttribute("aria-label", "Status");
    const edit = toggle("Edit", "Edit this note (R)", () => this.edit());
    const remove = toggle("Delete", "Delete this note (Delete)", () => this.remove());
    return part("div", "note-actions", statuses, part("span", "grow"), edit, remove);
  }

  #form(note) {
    const words = Object.assign(document.createElement("textarea"), { value: this.draft.words, rows: 4, placeholder: "What should change, or what is right" });
    words.setAttribute("aria-label", "Words of the note");
    const frames = Object.assign(document.createElement("input"), { type: "text", value: this.draft.frames, autocomplete: "off" });
    frames.setAttribute("aria-label", "Frames of the note, as 12 or 12-20");
    const save = () => this.#save(note.id);
    const cancel = () => this.#end(note.id);
    for (const field of [words, frames]) {
      field.addEventListener("input", () => { this.draft = { words: words.value, frames: frames.value }; });
      field.addEventListener("keydown", (event) => {
        if (event.key === "Enter" && (event.ctrlKey || event.metaKey || field === frames)) save();
        else if (event.key === "Escape") cancel();
        else return;
        event.preventDefault();
      });
    }
    const label = part("label", "inline", "Frames ", frames);
    return part("div", "note-form", words, part("div", "note-actions", label, part("span", "grow"),
      toggle("Cancel", "Leave the note as it was (Esc)", cancel), toggle("Save", "Save (Ctrl Enter)", save)));
  }

  #save(id) {
    const note = this.review.notes.get(id), text = printed(this.draft.words);
    const [first = note.first, last = first] = (this.draft.frames.match(/\d+/g) ?? []).map(Number).map((each) => Math.min(each, 1e6));
    const fields = { text, first: Math.min(first, last), last: Math.max(first, last) };
    if (Object.entries(fields).some(([name, value]) => note[name] !== value)) this.review.notes.edit(id, fields);
    this.#end(id);
  }

  #end(id) {
    const { notes } = this.review, note = notes.get(id);
    this.edited = null;
    document.activeElement.blur();
    if (!note.text && !note.drawings.length && !note.history.length) notes.forget(id);
    this.review.redraw();
  }
}

/** An element of a class with these children. */
function part(kind, className, ...children) {
  const element = document.createElement(kind);
  if (className) element.className = className;
  element.append(...children);
  return element;
}
