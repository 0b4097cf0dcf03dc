// What the pointer does to the picture: pan, zoom, draw the wipe, and draw notes.

const WIPE_REACH = 12; // CSS pixels around the edge where it is taken hold of

class StagePointer {
  constructor(stage, drawing, changed) {
    Object.assign(this, { stage, drawing, changed });
    const { canvas } = stage;
    let last, drawsWipe;
    const pan = (dx, dy) => this.#pan(dx, dy);
    gestures(canvas, {
      start: (event) => {
        last = event;
        drawsWipe = this.#isAtWipe(event);
        if (drawing.isOn) drawing.down(this.#at(event));
      },
      move: (event) => {
        if (drawing.isOn) drawing.move(this.#at(event));
        else if (drawsWipe) this.#setWipe(event);
        else pan(event.clientX - last.clientX, event.clientY - last.clientY);
        last = event;
      },
      over: () => drawing.up(),
      pan,
      zoom: (factor, event) => {
        stage.zoomTo(stage.scale / factor, this.#at(event));
        changed();
      },
      hover: (event) => { canvas.style.cursor = drawing.isOn ? "crosshair" : this.#isAtWipe(event) ? "ew-resize" : "grab"; },
    });
    canvas.addEventListener("dblclick", () => { stage.fit(); changed(); });
  }

  /** A place in pixels of the display. */
  #at(event) { return { x: event.offsetX * dotsOf(), y: event.offsetY * dotsOf() }; }

  #isAtWipe(event) { return this.stage.mode === "wipe" && Math.abs(event.offsetX - this.stage.wipeAt() / dotsOf()) < WIPE_REACH; }

  #setWipe(event) {
    const [place] = this.stage.places();
    this.stage.wipe = clamp((this.#at(event).x - place.x) / place.width, 0, 1);
    this.changed();
  }

  #pan(dx, dy) {
    const { stage } = this;
    if (stage.zoom === null) stage.zoomTo(stage.fitting);
    stage.pan.x += dx * dotsOf();
    stage.pan.y += dy * dotsOf();
    this.changed();
  }
}

const NARROWEST = 300, PANEL = 372, KEY_STEP = 24;

/** The edge between the picture and the panel is dragged, or moved by arrow keys; a double click resets it. */
function splitterOf(element, panel) {
  const most = () => Math.max(NARROWEST, document.documentElement.clientWidth - 320);
  const set = (width) => {
    const chosen = Math.round(clamp(width, NARROWEST, most()));
    panel.style.width = `${chosen}px`;
    Object.assign(element, { ariaValueNow: chosen, ariaValueMin: NARROWEST, ariaValueMax: most() });
  };
  gestures(element, { move: (event) => set(document.documentElement.clientWidth - event.clientX) });
  element.addEventListener("dblclick", () => set(PANEL));
  arrowKeys(element, (right) => set(panel.offsetWidth - right * KEY_STEP));
  set(PANEL);
}
