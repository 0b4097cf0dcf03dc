"use strict";
// The page: its parts, and what each tells the others.

const id = (name) => document.getElementById(name);

class LivePage {
  constructor() {
    this.film = new Film(this);
    this.shot = new Shot(this);
    this.follow = new Follow(this);
    this.values = new Values(this, id("panel"));
    this.timeline = new Timeline(this, id("curves"));
    this.handles = new Handles(this, id("handles"));
    this.orbit = new Orbit(this, id("picture"));
    this.fault = { file: "", edit: "" };
    id("undo").addEventListener("click", () => this.shot.undo());
    id("redo").addEventListener("click", () => this.shot.redo());
    id("play").addEventListener("click", () => this.film.play(!this.film.playing));
    id("panel-button").addEventListener("click", () => this.togglePanel());
    id("handles-button").addEventListener("click", () => this.toggleHandles());
    id("help-button").addEventListener("click", () => this.help());
    id("frame").addEventListener("change", (event) => this.#typeFrame(event.target));
    document.addEventListener("click", (event) => { // so that the next Space plays
      if (event.detail > 0) event.target.closest("button:not(.open)")?.blur();
    });
    if (window.matchMedia("(max-width: 860px)").matches) this.togglePanel(); // there it covers the picture
    this.#listenToStrip(id("strip"));
    new ResizeObserver(() => this.#resized()).observe(id("viewer"));
    listenForKeys(this);
    this.film.listen();
  }

  /** A new take begins; its text may be another. */
  began(isSame) {
    const { take } = this.film;
    id("shot").textContent = take.shot;
    document.title = `${take.shot} – flowsculpt live`;
    id("range").textContent = `${take.first}–${take.last}`;
    id("strip").setAttribute("aria-valuemin", take.first);
    id("strip").setAttribute("aria-valuemax", take.last);
    this.fault.file = "";
    this.#drawFault();
    if (!isSame) this.handles.draw();
    this.shot.refresh();
    this.drawFrame();
  }

  /** What the server says: of its work, or of a mistake in the file. */
  say(words, isTrouble) {
    id("state").textContent = isTrouble ? "" : words;
    this.fault.file = isTrouble ? words : "";
    this.#drawFault();
  }

  /** What is wrong with an edit, until the next one. */
  refused(words) {
    this.fault.edit = words;
    this.#drawFault();
  }

  /** A passing word about a drag. */
  note(words) { id("tag").textContent = words; }

  #drawFault() {
    const words = this.fault.edit || this.fault.file;
    if (id("trouble").textContent !== words) id("trouble").textContent = words;
    id("trouble").hidden = !words;
  }

  /** A new state of the file. */
  draw() {
    const { state } = this.shot;
    if (!state || dragOf.active) return;
    this.drawSteps();
    this.values.take(state.values);
    this.timeline.take(state.values);
    this.handles.draw();
  }

  /** Whether there is something to undo and to redo. */
  drawSteps() {
    id("undo").disabled = !this.shot.state.can_undo;
    id("redo").disabled = !this.shot.state.can_redo;
  }

  /** Another frame or another picture. */
  drawFrame() {
    const { film } = this, { shown, at } = film, picture = id("picture");
    if (document.activeElement !== id("frame")) id("frame").value = at;
    id("strip").setAttribute("aria-valuenow", at);
    film.drawStrip(id("strip"));
    const isPlaying = film.playing;
    id("play").replaceChildren(icon(isPlaying ? "pause" : "play"));
    id("play").setAttribute("aria-label", isPlaying ? "Pause" : "Play");
    if (shown) {
      if (picture.src !== shown.source) picture.src = shown.source;
      picture.alt = `Frame ${at} of ${film.take.shot}`;
      picture.hidden = false;
      id("wait").hidden = true;
    }
    this.note(film.trial ? film.trial.words : shown && !film.isCurrent ? "Before the edit" : "");
    if (this.shot.state && this.frameDrawn !== at) {
      this.values.drawFrame();
      this.timeline.drawFrame();
    }
    this.frameDrawn = at;
    this.handles.draw();
  }

  /** How the picture that is shown projects points; null while there is none. */
  get projection() {
    const camera = this.film.shown?.camera, box = this.#pictureBox();
    return camera && box ? new Projection(camera, box) : null;
  }

  /** Where the picture is in the viewer, in CSS pixels. */
  #pictureBox() {
    const { take } = this.film, picture = id("picture");
    if (!take || picture.hidden) return null;
    const [wide, high] = take.size, room = { width: picture.clientWidth, height: picture.clientHeight };
    const scale = Math.min(room.width / wide, room.height / high), width = wide * scale, height = high * scale;
    return { left: picture.offsetLeft + (room.width - width) / 2, top: picture.offsetTop + (room.height - height) / 2, width, height };
  }

  togglePanel() { this.#toggle("panel-button", (id("panel").hidden = !id("panel").hidden)); }

  toggleHandles() {
    this.handles.toggle();
    this.#toggle("handles-button", !this.handles.isShown);
  }

  #toggle(button, isHidden) { id(button).setAttribute("aria-pressed", !isHidden); }

  addKey() {
    const row = this.timeline.rows.find((each) => each.isChosen);
    if (row?.value.curve.formula === null) row.add(this.shot.frameOf(row.value.where, this.film.at));
  }

  help() { showHelp(id("help")); }

  #typeFrame(field) {
    const frame = Number.parseInt(field.value, 10);
    if (Number.isFinite(frame)) this.film.seek(frame);
    field.value = this.film.at;
    field.blur();
  }

  #listenToStrip(strip) {
    const seek = (event) => {
      const box = strip.getBoundingClientRect(), { take } = this.film;
      if (take) this.film.seek(take.first + Math.floor(((event.clientX - box.left) / box.width) * (take.last - take.first + 1)));
    };
    strip.addEventListener("pointerdown", (event) => {
      strip.setPointerCapture(event.pointerId);
      seek(event);
    });
    strip.addEventListener("pointermove", (event) => strip.hasPointerCapture(event.pointerId) && seek(event));
  }

  #resized() {
    this.timeline.draw();
    this.drawFrame();
  }
}

const page = new LivePage();
