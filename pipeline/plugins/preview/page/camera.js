// The camera by the pointer: a drag orbits it, the wheel brings it closer. What it writes are the camera's settings.

const SETTLED = 350; // ms after the last turn of the wheel
const DEGREES = 180 / Math.PI;

class CameraDrag {
  constructor(page, picture) {
    Object.assign(this, { page, wheeled: null });
    editable(page, picture, ["camera"], {
      edits: (event, begun) => this.turned(event.clientX - begun.clientX, event.clientY - begun.clientY),
      keyed: (right, down, many) => this.turned(10 * many * right, 10 * many * down),
      gesture: () => "camera",
      many: 3,
      isOn: () => picture.matches(":focus-visible"), // a click leaves them to time
      zoom: (factor) => this.zoom(factor),
    });
  }

  #value(name, otherwise) {
    const where = ["camera", name];
    return this.page.shot.get(where) ?? { where, form: "number", value: otherwise, curve: null };
  }

  /** The edits that orbit the camera by a drag of so many pixels. */
  turned(dx, dy) {
    const { shot, film, projection } = this.page, position = shot.get(["camera", "position"]);
    if (!shot.state || !projection) return [];
    if (position) {
      const view = { position: shot.at(position, film.at), target: projection.camera.target, up: [0, 1, 0] };
      return shot.change(position, turnedView(view, dx, dy).position.map((part) => rounded(part, 0.01)), film.at);
    }
    const azimuth = this.#value("azimuth", -30), elevation = this.#value("elevation", 14);
    const formula = [azimuth, elevation].find((value) => value.curve && value.curve.formula !== null);
    if (formula) this.page.note(formulaNote(formula));
    const around = shot.at(azimuth, film.at) - TURN * DEGREES * dx, up = clamp(shot.at(elevation, film.at) + TURN * DEGREES * dy, -89, 89);
    return [
      ...(dx ? shot.change(azimuth, rounded(around, 1), film.at) : []),
      ...(dy ? shot.change(elevation, rounded(up, 1), film.at) : []),
    ];
  }

  /** Move closer or farther; it is written a while after the last time. */
  zoom(factor) {
    const { shot, film, follow } = this.page;
    if (!shot.state || shot.get(["camera", "position"])) return;
    const value = shot.get(["camera", "distance"]) ?? this.#value("dolly", 1);
    this.wheeled ??= { factor: 1 };
    this.wheeled.factor *= factor;
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
