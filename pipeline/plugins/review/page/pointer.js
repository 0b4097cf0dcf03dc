"use strict";
// What a mouse, a pen or a finger does to the picture: pan, zoom, draw the wipe, and draw notes.

class StagePointer {
  constructor(stage, drawing, changed) {
    Object.assign(this, { stage, drawing, changed });
    const canvas = stage.canvas;
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => this.#up());
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener("dblclick", () => { stage.fit(); changed(); });
  }

  #at(event) {
    const dots = this.stage.canvas.width / this.stage.canvas.getBoundingClientRect().width;
    return { x: event.offsetX * dots, y: event.offsetY * dots, dots };
  }

  #isAtWipe(at) {
    return this.stage.mode === "wipe" && Math.abs(at.x - this.stage.wipeAt()) < 12 * at.dots;
  }

  #down(event) {
    const at = this.#at(event);
    this.stage.canvas.setPointerCapture(event.pointerId);
    if (this.drawing.isOn && event.button === 0) this.drawing.down(at);
    else this.drag = { wipe: this.#isAtWipe(at), at };
  }

  #up() {
    this.drag = null;
    this.drawing.up();
  }

  #move(event) {
    const at = this.#at(event), { stage, drag } = this;
    if (this.drawing.isOn && !drag) {
      stage.canvas.style.cursor = "crosshair";
      this.drawing.move(at);
      return;
    }
    const hovers = drag ? drag.wipe : this.#isAtWipe(at);
    stage.canvas.style.cursor = hovers ? "ew-resize" : drag ? "grabbing" : "default";
    if (!drag) return;
    if (drag.wipe) {
      const place = stage.places()[0];
      stage.wipe = Math.min(1, Math.max(0, (at.x - place.x) / place.width));
    } else {
      if (stage.zoom === null) stage.zoomTo(stage.fitting);
      stage.pan.x += at.x - drag.at.x;
      stage.pan.y += at.y - drag.at.y;
      drag.at = at;
    }
    this.changed();
  }

  #wheel(event) {
    event.preventDefault();
    this.stage.zoomTo(this.stage.scale * Math.exp(-0.0015 * event.deltaY), this.#at(event));
    this.changed();
  }
}
