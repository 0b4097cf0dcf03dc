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
    const { review } = this, gap = () => make("span", "grow");
    this.name = make("input", {
      type: "text", maxLength: 200, placeholder: "Your name", autocomplete: "name", ariaLabel: "Your name, which your notes carry",
      onchange: () => { review.notes.author = this.name.value; },
    });
    this.scopes = [["Shown", false, "Notes of the sequence that is shown"], ["All", true, "All notes of this page"]].map(([words, all, title]) => (
      buttonOf(words, `${title} (Shift Q)`, () => this.setScope(all))
    ));
    this.drawButton = buttonOf("Draw", "Draw over the picture (B)", () => review.drawing.toggle());
    this.statuses = STATUSES.map((status) => (
      buttonOf("", "List only these notes, or all (Shift X: the next)", () => this.setListed(this.status === status ? null : status), { className: status })
    ));
    this.counts = make("div", { className: "notes-counts", role: "group", ariaLabel: "Notes by status" }, ...this.statuses);
    this.list = make("ul", "notes-list");
    this.kept = make("span", "notes-kept");
    const forms = [["JSON", "json", "Shift J"], ["Text", "txt", "Shift T"], ["OTIO", "otio", "Shift O"]].map(([words, form, key]) => (
      buttonOf(words, `Download all notes as ${words} (${key})`, () => downloadNotes(review, form))
    ));
    const load = buttonOf("Load…", "Merge a file of notes; or drop it on the page (Shift L)", () => id("notes-file").click());
    const begin = buttonOf("Note on this frame", "Write a note on this frame (A); on the loop: Shift N", () => review.writeNote());
    this.element.append(
      make("div", "notes-bar", this.name, segments("Which notes", this.scopes)), make("div", "notes-begin", begin, this.drawButton),
      this.counts, this.list, make("div", "notes-files", this.kept, ...forms, gap(), load),
    );
  }

  draw() {
    const { review } = this;
    if (this.element.hidden) return;
    if (document.activeElement !== this.name) this.name.value = review.notes.author;
    this.scopes.forEach((button, i) => { button.ariaPressed = this.showsAll === (i === 1); });
    this.drawButton.ariaPressed = review.drawing.isOn;
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
      button.ariaPressed = this.status === status;
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
    if (!notes.length) this.list.append(make("li", "notes-none", this.showsAll ? "No notes on this page yet." : "No notes on this sequence yet."));
    const cardOf = (id) => cards.find((card) => card.dataset.note === id);
    if (focused && document.activeElement === document.body) cardOf(focused)?.querySelector("button").focus();
    cardOf(this.review.chosenNote)?.scrollIntoView({ block: "nearest" });
  }

  #card(note) {
    const { review } = this, isChosen = note.id === review.chosenNote;
    const card = make("li", `note-card ${note.status}`);
    card.dataset.note = note.id;
    card.classList.toggle("chosen", isChosen);
    const frames = buttonOf(framesOf(note), `Go to frame ${note.first}`, () => this.#goTo(note), { className: "note-frames", ariaCurrent: isChosen });
    const about = make("span", "note-about", make("bdi", {}, authorOf(note)), ` · ${timeOf(note)}`);
    about.title = `Written ${note.created.slice(0, 16).replace("T", " ")} UTC${note.history.length ? `; ${note.history.length} earlier versions are kept` : ""}`;
    card.append(make("div", "note-head", frames, make("span", "note-status", STATUS_NAMES[note.status][0]), make("span", "grow"), about));
    if (this.#namesSequences) card.append(make("p", "note-sequence", `${review.isAlone ? "" : `${note.shot} · `}${note.sequence}`));
    if (this.form.id === note.id) card.append(this.form.element(note));
    else if (note.text) card.append(make("p", "note-text", note.text));
    const extras = [note.drawings.length ? strokesOf(note) : "", this.#isOutdated(note) ? "the picture has changed since" : ""].filter(Boolean);
    if (extras.length) card.append(make("p", "note-extras", extras.join(" · ")));
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
    const statuses = segments("Status", Object.entries(STATUS_NAMES).map(([status, [words, key]]) => (
      buttonOf(words, `${words} (${key})`, () => this.setStatus(status), { ariaPressed: note.status === status })
    )));
    const edit = buttonOf("Edit", "Edit this note (R)", () => this.edit());
    const remove = buttonOf("Delete", "Delete this note (Delete)", () => this.remove());
    return make("div", "note-actions", statuses, make("span", "grow"), edit, remove);
  }
}
