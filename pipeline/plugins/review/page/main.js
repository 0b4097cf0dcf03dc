// The page as a whole: what is shown, and who must be told when that changes.

const AHEAD = 96, BEHIND = 8;  // pictures decoded before they are needed

class Review {
  constructor(data) {
    document.title = `${data.title} – review`;
    id("title").textContent = data.title;
    Object.assign(this, { title: data.title, shots: data.shots, isAlone: Object.keys(data.shots).length === 1, chosenNote: null, mode: "a" });
    this.sequences = data.sequences.map((each, i) => new Sequence(each, i, data.shots[each.shot]));
    this.cache = new PictureCache((url) => this.#arrived(url));
    this.transport = new Transport({ isReady: (frame) => this.#isReady(frame) });
    this.playback = new Playback(this.transport);
    this.stage = new Stage(id("stage"), this);
    this.notes = new NoteBook(data.page, data.notes, () => this.redraw());
    this.ink = new InkLayer(id("ink"), this);
    this.drawing = new Drawing(id("drawing"), this);
    this.tab = this.notes.all.length ? "notes" : "measures";
    this.grid = new Grid(id("grid"), this, data.wedges);
    buildControls(this);
    this.panels = {
      notes: new NotesPanel(id("panel-notes"), this),
      measures: new MeasuresPanel(id("panel-measures"), this),
      levels: new LevelsPanel(id("panel-levels"), this),
      facts: new FactsPanel(id("panel-facts"), this),
      shot: new ShotPanel(id("panel-shot"), this, data.sources),
      mesh: new MeshPanel(id("panel-mesh"), this, data.three, data.hint),
    };
    this.viewing = new Viewing(id("viewing"), this);
    this.strip = new ReviewStrip(id("strip"), this);
    splitterOf(id("splitter"), id("panel"));
    this.#restore(new URLSearchParams(location.hash.slice(1)));
    this.isBuilt = true;
    this.redraw();
    this.transport.listen((what) => this.redraw(what === "frame"));
    stagePointer(this.stage, this.drawing, () => this.redraw());
    acceptNotes(this, id("notes-file"));
    new Keyboard(keysOf(this));
    whenResized(id("viewer"), () => this.redraw());
  }

  // The address tells what is shown, so that it can be sent to somebody.

  #rememberSoon() {
    const { transport: { frame }, a, b, mode } = this, said = new URLSearchParams({ frame, a: a.name(false), b: b.name(false), mode });
    clearTimeout(this.remembering);
    this.remembering = setTimeout(() => history.replaceState(null, "", `#${said}`), 200);
  }

  /** Show what an address tells; of what it does not: the largest and longest render, and another beside it. */
  #restore(said) {
    const { sequences } = this, named = (side) => sequences.find((each) => each.name(false) === said.get(side));
    const worth = (each) => (each.kind === "render" ? 1e9 : 1) * each.size[0] * each.there.length;
    const a = named("a") ?? sequences.reduce((best, each) => (worth(each) > worth(best) ? each : best));
    const others = sequences.filter((each) => each !== a), frame = Number.parseInt(said.get("frame"), 10);
    this.b = named("b") ?? others.find((each) => each.shot === a.shot) ?? others[0] ?? a;
    this.choose("a", a);
    this.transport.go(Number.isFinite(frame) ? frame : this.transport.first);
    if (MODE_NAMES[said.get("mode")]) this.setMode(said.get("mode"));
  }

  /** The sequence that notes are written on. */
  get shownSequence() { return this.mode === "b" ? this.b : this.a; }

  /** The sequences that are seen: one, or both. */
  get shownSequences() { return ["wipe", "difference", "side"].includes(this.mode) ? [...new Set([this.a, this.b])] : [this.shownSequence]; }

  // What people ask for

  choose(side, sequence) {
    this[side] = sequence;
    if (side === "a") {
      const numbers = this.#numbersOf(sequence), { about } = sequence;
      this.transport.setNumbers(numbers, about.fps, String(numbers) === String(about.numbers) ? about.dissolve : 0);
    }
    this.redraw();
  }

  /** All frames of a sequence, or those that are there: by default where most are not. */
  #numbersOf(sequence) {
    const { there, numbers } = sequence;
    this.skips = this.wantsSkipped ?? there.length < numbers.length / 2;
    return this.skips && there.length ? there : numbers;
  }

  /** Leave out frames that are not there, or show their slates. */
  toggleSkipped() {
    this.wantsSkipped = !this.skips;
    this.choose("a", this.a);
  }

  chooseNext(side, count) { this.choose(side, nextOf(this.sequences, this[side], count)); }

  swap() {
    const { a, b } = this;
    this.b = a;
    this.choose("a", b);
  }

  setMode(mode) {
    if (mode !== "grid" || this.grid.isUseful) this.change(this, { mode });
  }

  /** D: the difference or, where it is shown, a larger one. */
  difference() {
    if (this.mode === "difference") this.stage.gain = nextOf(GAINS, this.stage.gain);
    this.setMode("difference");
  }

  /** Change fields of a part of the page, and show it. */
  change(part, fields) {
    Object.assign(part, fields);
    this.redraw();
  }

  /** Turn a field of a part of the page on or off, and show it. */
  toggle(part, name) { this.change(part, { [name]: !part[name] }); }

  zoomBy(factor) { this.setSize(this.stage.scale * factor); }

  /** Show so many pixels of the display to a pixel of the picture; null: as many as fit. */
  setSize(zoom) {
    if (zoom === null) this.stage.fit();
    else this.stage.zoomTo(zoom);
    this.redraw();
  }

  showTab(name) {
    id("panel").hidden = false;
    this.change(this, { tab: name });
  }

  togglePanel() { this.toggle(id("panel"), "hidden"); }

  /** Begin a note on the frame that is shown, or on all frames of the loop. */
  writeNote(onLoop = false) {
    const { frame, inPoint, outPoint } = this.transport;
    this.panels.notes.write(...(onLoop ? [inPoint, outPoint] : [frame, frame]));
  }

  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else document.documentElement.requestFullscreen();
  }

  // What follows from it

  #shown(frame) {
    if (this.mode === "grid") return this.grid.urls(frame);
    const frames = [frame, this.transport.beginningWith(frame)?.[0] ?? frame];
    return [...new Set(this.shownSequences.flatMap((each) => frames.map((one) => each.url(one))))];
  }

  get #sheets() { return this.shownSequences.map((each) => each.sheetUrl); }

  #isReady(frame) { return this.#shown(frame).every((url) => this.cache.isSettled(url)); }

  #preload() {
    const { transport } = this, shown = this.#shown(transport.frame), [width, height] = this.a.size;
    const room = PictureCache.room(width, height) / Math.max(1, shown.length);
    const before = [];
    for (let frame = transport.frame; before.length < BEHIND;) before.push((frame = transport.following(frame, -transport.direction)));
    const frames = [...transport.ahead(Math.min(AHEAD, Math.max(4, room - BEHIND))), ...before];
    const urls = frames.flatMap((frame) => this.#shown(frame));
    if (!this.stage.needsB && this.b !== this.a) urls.push(this.b.url(transport.frame));  // so that T is at once
    this.cache.want([...new Set([...this.#sheets, ...urls])].filter((url) => url !== null));
  }

  #arrived(url) {
    if ([...this.#sheets, ...this.#shown(this.transport.frame)].includes(url)) this.#drawPicture();
    this.#drawStripSoon();
  }

  #drawStripSoon() {
    if (this.stripDue) return;
    this.stripDue = true;
    setTimeout(() => { this.stripDue = false; this.strip.draw(); }, 100);
  }

  #drawPicture() {
    this.ink.draw();
    if (this.mode === "grid") this.grid.draw();
    else this.stage.draw();
    if (this.cache.get(this.a.url(this.transport.frame))) this.drawn ??= performance.now(); // ms until it was first seen
  }

  /** Draw the panel that is shown; the others are drawn when they are. */
  drawPanel() { this.panels[this.tab].draw(); }

  /** Draw everything as it is now; where only the frame is another, the strip draws itself. */
  redraw(isOtherFrame = false) {
    if (!this.isBuilt) return;
    this.#preload();
    refresh();
    if (!isOtherFrame) {
      this.stage.resize();
      this.strip.draw();
    }
    this.#drawPicture();
    this.drawPanel();
    this.viewing.draw();
    if (!this.transport.playing) this.#rememberSoon();
  }
}

window.review = new Review(window.reviewData);
