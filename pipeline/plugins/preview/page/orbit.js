"use strict";
// The camera by the pointer: a drag orbits it, the wheel brings it closer. What it writes are the camera's settings.

const DEGREES_A_PIXEL = 0.35;
const SETTLED = 350; // ms after the last turn of the wheel

class Orbit {
  constructor(page, picture) {
    Object.assign(this, { page, picture, wheeled: null });
    dragOf(picture, {
      start: () => {
        picture.classList.add("turning");
        page.follow.prepare(["camera"]);
      },
      move: (event, begun) => page.follow.show(this.turned(event.clientX - begun.clientX, event.clientY - begun.clientY)),
      end: (event, begun) => page.follow.end(this.turned(event.clientX - begun.clientX, event.clientY - begun.clientY)),
      cancel: () => page.follow.cancel(),
    });
    for (const name of ["pointerup", "pointercancel"]) picture.addEventListener(name, () => picture.classList.remove("turning"));
    picture.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.#wheel(event.deltaY);
    }, { passive: false });
  }

  #value(name, otherwise) {
    const where = ["camera", name];
    return this.page.shot.get(where) ?? { where, form: "number", value: otherwise, curve: null };
  }

  /** The edits that orbit the camera by a drag of so many pixels. */
  turned(dx, dy) {
    const { shot, film } = this.page, position = shot.get(["camera", "position"]);
    if (!shot.state || !this.page.projection) return [];
    if (position) return shot.change(position, this.#around(shot.at(position, film.at), dx, dy), film.at);
    const azimuth = this.#value("azimuth", -30), elevation = this.#value("elevation", 14);
    const formula = [azimuth, elevation].find((value) => value.curve && value.curve.formula !== null);
    if (formula) this.page.note(formulaNote(formula));
    const up = Math.min(89, Math.max(-89, shot.at(elevation, film.at) + DEGREES_A_PIXEL * dy));
    return [
      ...(dx ? shot.change(azimuth, rounded(shot.at(azimuth, film.at) - DEGREES_A_PIXEL * dx, 1), film.at) : []),
      ...(dy ? shot.change(elevation, rounded(up, 1), film.at) : []),
    ];
  }

  /** A position turned about the target of the camera. */
  #around(position, dx, dy) {
    const { target } = this.page.projection.camera, away = minus(position, target), size = length(away);
    const azimuth = Math.atan2(away[0], away[2]) - (DEGREES_A_PIXEL * dx * Math.PI) / 180;
    const elevation = Math.min(1.55, Math.max(-1.55, Math.asin(away[1] / size) + (DEGREES_A_PIXEL * dy * Math.PI) / 180));
    const level = size * Math.cos(elevation);
    return plus(target, [level * Math.sin(azimuth), size * Math.sin(elevation), level * Math.cos(azimuth)]).map((part) => rounded(part, 0.01));
  }

  #wheel(turn) {
    const { shot, film, follow } = this.page;
    if (!shot.state || shot.get(["camera", "position"])) return;
    const value = shot.get(["camera", "distance"]) ?? this.#value("dolly", 1);
    this.wheeled ??= { factor: 1 };
    this.wheeled.factor *= Math.exp(0.001 * turn);
    const now = shot.at(value, film.at) * this.wheeled.factor, edits = shot.change(value, rounded(now, now / 100), film.at);
    follow.show(edits);
    clearTimeout(this.wheeled.timer);
    Object.assign(this.wheeled, { edits, timer: setTimeout(() => this.settle(), SETTLED) });
  }

  /** Write what the wheel has done, if anything. */
  settle() {
    const { wheeled } = this;
    if (!wheeled) return;
    this.wheeled = null;
    clearTimeout(wheeled.timer);
    this.page.follow.end(wheeled.edits);
  }
}
