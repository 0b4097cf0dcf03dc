"use strict";
// The panel of notes: who says what about which frames, and what has been decided.

const STATUS_NAMES = { open: ["Open", "7"], change: ["Change", "8"], approved: ["Approved", "9"] };

class NotesPanel {
  constructor(element, review) {
    Object.assign(this, { element, review, showsAll: false, status: null, form: new NoteForm(review) });
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
    if (!this.review.notes.author) this.review.tell("Write your name above the notes, so that others know whose they are.");
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

  /** List only notes of a status, or with null all; the chosen one and the one being edited stay. */
  setListed(status) {
    this.status = status;
    this.draw();
  }

  /** List notes of the next status; after the last, all. */
  listNext() {
    const statuses = [null, ...STATUSES];
    this.review.showTab("notes");
    this.setListed(statuses[(statuses.indexOf(this.status) + 1) % statuses.length]);
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
    const own = review.sequences.find((each) => each.shot === note.shot && each.label === note.sequence);
    this.#choose(note.id);
    if (own && !review.shownSequences.some((each) => review.notes.of(each).includes(note))) review.choose(review.mode === "b" ? "b" : "a", own);
    review.jump(note.first);
    review.redraw();
  }

  /** The notes of the page, or of the sequences that are shown. */
  #inScope() {
    const { notes, shownSequences } = this.review;
    if (this.showsAll) return notes.all;
    const shown = new Set(shownSequences.flatMap((each) => notes.of(each)));
    return notes.all.filter((note) => shown.has(note));
  }

  /** Those of them that are listed. */
  #notes(notes = this.#inScope()) {
    const kept = [this.review.chosenNote, this.form.id];
    return this.status ? notes.filter((note) => note.status === this.status || kept.includes(note.id)) : notes;
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
      toggle("Note on this frame", "Write a note on this frame (A); on the loop: Shift N", () => review.writeNote()),
      toggle("Draw", "Draw over the picture (B)", () => review.drawing.toggle()));
    this.drawButton = begin.lastChild;
    this.statuses = STATUSES.map((status) => {
      const button = toggle("", `List only these notes, or all (Shift X: the next)`, () => this.setListed(this.status === status ? null : status));
      button.className = status;
      return button;
    });
    this.counts = part("div", "notes-counts", ...this.statuses);
    this.counts.setAttribute("role", "group");
    this.counts.setAttribute("aria-label", "Notes by status");
    this.list = part("ul", "notes-list");
    this.kept = part("span", "notes-kept");
    const files = part("div", "notes-files", this.kept,
      ...[["JSON", "json", "Shift J"], ["Text", "txt", "Shift T"], ["OTIO", "otio", "Shift O"]].map(([words, form, key]) => toggle(words, `Download all notes as ${words} (${key})`, () => downloadNotes(review, form))),
      part("span", "grow"), toggle("Load…", "Merge a file of notes; or drop it on the page (Shift L)", () => id("notes-file").click()));
    this.element.append(bar, begin, this.counts, this.list, files);
  }

  draw() {
    const { review } = this;
    if (this.element.hidden) return;
    if (document.activeElement !== this.name) this.name.value = review.notes.author;
    this.scopes.forEach((button, i) => button.setAttribute("aria-pressed", this.showsAll === (i === 1)));
    this.drawButton.setAttribute("aria-pressed", review.drawing.isOn);
    this.kept.textContent = review.notes.isSaved ? "Download" : "Not kept: download";
    this.kept.classList.toggle("fault", !review.notes.isSaved);
    if (!this.list.contains(document.activeElement) || !document.activeElement.matches("textarea, input")) this.#list();
  }

  /** Draw the cards again where anything on them has changed, and tell those of the frame that is shown. */
  #list() {
    const found = this.#inScope(), notes = this.#notes(found), { frame } = this.review.transport, { chosenNote } = this.review;
    const states = notes.map((note) => [note.id, note.modified, note.id === chosenNote, note.id === this.form.id, this.#namesSequences].join());
    this.#count(found);
    if (states.join("\n") !== this.state) this.#showCards(notes, states);
    this.state = states.join("\n");
    notes.forEach((note, i) => this.list.children[i].classList.toggle("here", note.first <= frame && frame <= note.last));
  }

  #count(notes) {
    this.counts.hidden = !notes.length;
    this.statuses.forEach((button, i) => {
      const status = STATUSES[i], count = notes.filter((note) => note.status === status).length;
      const words = `${STATUS_NAMES[status][0]} ${count}`;
      if (button.textContent !== words) button.textContent = words;
      button.setAttribute("aria-pressed", this.status === status);
    });
  }

  /** Show a card for each note; those whose note is as it was stay, for a list may be long. */
  #showCards(notes, states) {
    const focused = document.activeElement?.closest?.("[data-note]")?.dataset.note;
    const there = new Map([...this.list.children].map((card) => [card.state, card]));
    const cards = notes.map((note, i) => there.get(states[i]) ?? Object.assign(this.#card(note), { state: states[i] }));
    const shown = [...this.list.children];
    if (cards.length === shown.length && cards.every((card, i) => card === shown[i] || !card.isConnected)) {
      cards.forEach((card, i) => { if (card !== shown[i]) shown[i].replaceWith(card); });
    } else {
      this.list.replaceChildren(...cards);
    }
    if (!notes.length) this.list.append(part("li", "notes-none", this.showsAll ? "No notes on this page yet." : "No notes on this sequence yet."));
    const cardOf = (id) => cards.find((card) => card.dataset.note === id);
    if (focused && document.activeElement === document.body) cardOf(focused)?.querySelector("button").focus();
    cardOf(this.review.chosenNote)?.scrollIntoView({ block: "nearest" });
  }

  #card(note) {
    const { review } = this, isChosen = note.id === review.chosenNote;
    const card = part("li", `note-card ${note.status}`);
    card.dataset.note = note.id;
    card.classList.toggle("chosen", isChosen);
    const frames = toggle(framesOf(note), `Go to frame ${note.first}`, () => this.#goTo(note));
    frames.className = "note-frames";
    if (isChosen) frames.setAttribute("aria-current", "true");
    const about = part("span", "note-about", part("bdi", "", authorOf(note)), ` · ${timeOf(note)}`);
    about.title = `Written ${note.created.slice(0, 16).replace("T", " ")} UTC${note.history.length ? `; ${note.history.length} earlier versions are kept` : ""}`;
    card.append(part("div", "note-head", frames, part("span", "note-status", STATUS_NAMES[note.status][0]), part("span", "grow"), about));
    if (this.#namesSequences) card.append(part("p", "note-sequence", `${review.isAlone ? "" : `${note.shot} · `}${note.sequence}`));
    if (this.form.id === note.id) card.append(this.form.element(note));
    else if (note.text) card.append(part("p", "note-text", note.text));
    const extras = [note.drawings.length ? strokesOf(note) : "", this.#isOutdated(note) ? "the picture has changed since" : ""].filter(Boolean);
    if (extras.length) card.append(part("p", "note-extras", extras.join(" · ")));
    if (isChosen && this.form.id !== note.id) card.append(this.#actions(note));
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
}

/** An element of a class with these children. */
function part(kind, className, ...children) {
  const element = document.createElement(kind);
  if (className) element.className = className;
  element.append(...children);
  return element;
}
