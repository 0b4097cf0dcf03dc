"use strict";
// The edge between the picture and the panel, to be dragged, or moved by arrow keys.

const NARROWEST = 300, KEY_STEP = 24;

class Splitter {
  constructor(element, panel) {
    Object.assign(this, { element, panel });
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      this.drags = true;
    });
    element.addEventListener("pointermove", (event) => {
      if (this.drags) this.#set(document.documentElement.clientWidth - event.clientX);
    });
    element.addEventListener("pointerup", () => { this.drags = false; });
    element.addEventListener("dblclick", () => this.#set(372));
    element.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: 1, ArrowRight: -1 }[event.key];
      if (!way) return;
      event.preventDefault();
      this.#set(panel.offsetWidth + way * KEY_STEP);
    });
    this.#tell(372);
  }

  #set(width) {
    const most = Math.max(NARROWEST, document.documentElement.clientWidth - 320);
    const chosen = Math.round(Math.min(most, Math.max(NARROWEST, width)));
    this.panel.style.width = `${chosen}px`;
    this.#tell(chosen);
  }

  #tell(width) {
    this.element.setAttribute("aria-valuenow", width);
    this.element.setAttribute("aria-valuemin", NARROWEST);
    this.element.setAttribute("aria-valuemax", document.documentElement.clientWidth - 320);
  }
}
