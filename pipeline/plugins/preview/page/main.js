// The page: its parts, and what each tells the others.

class LivePage {
  constructor() {
    this.film = new Film(this);
    this.shot = new Shot(this);
    this.follow = new Follow(this);
    this.perform = new Perform(this);
    this.values = new Values(this, id("panel"));
    this.timeline = new Timeline(this, id("curves"));
    this.handles = new Handles(this, id("handles"));
    this.camera = new CameraDrag(this, id("picture"));
    this.strip = new FrameStrip(id("strip"), this.film.transport, { stateOf: (frame) => this.film.stateOf(frame) });
    this.playback = new Playback(this.film.transport, ["play"]);
    id("time").append(this.playback.buttons, make("label", "inline", "Frame", this.playback.field), this.playback.range);
    this.fault = { file: "", edit: "" };
    id("panel").hidden = window.matchMedia("(max-width: 860px)").matches; // there it covers the picture
    this.#liven();
    this.film.transport.listen(() => this.drawFrame());
    whenResized(id("viewer"), () => { this.timeline.draw(); this.drawFrame(); });
    new Keyboard(this.#keys, () => this.film.take);
    this.film.listen();
  }

  /** What the page's elements do, and show of how things are. */
  #liven() {
    const { shot, film, handles } = this, fault = () => this.fault.edit || this.fault.file;
    give(id("shot"), { textContent: () => film.take?.shot ?? "…" });
    give(id("undo"), { onclick: () => shot.undo(), disabled: () => !shot.state?.can_undo });
    give(id("redo"), { onclick: () => shot.redo(), disabled: () => !shot.state?.can_redo });
    give(id("panel-button"), { onclick: () => this.togglePanel(), ariaPressed: () => !id("panel").hidden });
    give(id("handles-button"), { onclick: () => handles.toggle(), ariaPressed: () => handles.isShown });
    give(id("trouble"), { textContent: fault, hidden: () => !fault() });
    refresh();
  }

  get #keys() {
    const { film, shot, playback } = this;
    return [
      ["Playing", [...playback.keys, ["F", "Follow the frames as they come", { f: () => film.follow() }]]],
      ["Editing", [
        ["Ctrl Z", "Undo", { "Ctrl+z": () => shot.undo() }],
        ["Ctrl Shift Z", "Redo; also Ctrl Y", { "Ctrl+Z": () => shot.redo(), "Ctrl+y": () => shot.redo() }],
        ["↑ ↓", "In a number: a step; with Shift ten"],
        ["Esc", "Give up a drag"],
        ["R A", "Record; arm what has the focus", { r: () => this.perform.record(), a: () => this.perform.armFocused() }],
        ["V H", "Show or hide values, handles", { v: () => this.togglePanel(), h: () => this.handles.toggle() }],
      ]],
      ["A key of a curve", [
        ["S", "Set one of the chosen curve at this frame", { s: () => this.addKey() }],
        ["← →", "Move it a frame; with Shift ten"],
        ["↑ ↓", "Change its value; with Shift tenfold"],
        ["Delete", "Remove it"],
      ]],
      ["The picture", [
        ["drag", "Orbit the camera; also arrow keys, once Tab has come here"],
        ["wheel", "Closer, farther; also two fingers, and + −", { "+": () => this.camera.zoom(0.9), "=": () => this.camera.zoom(0.9), "-": () => this.camera.zoom(1.1) }],
        ["handle", "Move a centre, aim an axis, size a radius"],
      ]],
    ];
  }

  /** A new take begins; its text may be another. */
  began(isSame) {
    const { take } = this.film;
    document.title = `${take.shot} – flowsculpt live`;
    this.fault.file = "";
    if (!isSame) this.handles.draw();
    this.shot.refresh();
    this.perform.refresh();
    this.drawFrame();
    this.strip.draw();
  }

  /** What the server says: of its work, or of a mistake in the file. */
  say(words, isTrouble) {
    id("state").textContent = isTrouble ? "" : words;
    this.fault.file = isTrouble ? words : "";
    refresh();
  }

  /** What is wrong with an edit, until the next one. */
  refused(words) {
    this.fault.edit = words;
    refresh();
  }

  /** A passing word about a drag. */
  note(words) { id("tag").textContent = words; }

  /** A new state of the file. */
  draw() {
    const { state } = this.shot;
    if (!state || gestures.active) return;
    this.values.take(state.values);
    this.timeline.take(state.values);
    this.handles.draw();
    refresh();
  }

  /** Another frame or another picture. */
  drawFrame() {
    const { film } = this, { shown, at } = film, picture = id("picture");
    if (!film.take) return;
    refresh();
    if (shown) {
      if (picture.src !== shown.source) picture.src = shown.source;
      give(picture, { alt: `Frame ${at} of ${film.take.shot}`, style: `--aspect: ${film.take.size[0] / film.take.size[1]}` });
      picture.hidden = false;
    }
    this.note(film.trial ? film.trial.words : shown && !film.isCurrent ? "Before the edit" : "");
    this.timeline.drawFrame();
    this.handles.draw();
  }

  /** How the picture that is shown projects points; null while there is none. */
  get projection() {
    const camera = this.film.shown?.camera, { offsetLeft: left, offsetTop: top, offsetWidth: width, offsetHeight: height } = id("picture");
    return camera && width ? new Projection(camera, { left, top, width, height }) : null;
  }

  togglePanel() {
    id("panel").hidden = !id("panel").hidden;
    refresh();
  }

  addKey() {
    const row = this.timeline.rows.find((each) => each.isChosen);
    if (row?.value.curve.formula === null) row.add(this.shot.frameOf(row.value.where, this.film.at));
  }
}

const page = new LivePage();
