// A camera around a place, turned by pointer and keys: about the vertical axis, as on a turntable, or freely.

const TURN = (0.35 * Math.PI) / 180; // radians a pixel
const STEEPEST = 0.02; // radians between a turntable's camera and its axis

/** A view {position, target, up} after a drag of so many pixels. */
function turnedView({ position, target, up }, dx, dy, isFree = false) {
  const away = minus(position, target), across = unitOf(cross(up, away));
  const axis = isFree ? unitOf(cross(away, across)) : unitOf(up);
  const height = Math.acos(clamp(dot(away, axis) / length(away), -1, 1)); // the angle to the axis
  const tilt = isFree ? TURN * dy : height - clamp(height - TURN * dy, STEEPEST, Math.PI - STEEPEST);
  const moved = (vector) => rotated(rotated(vector, across, -tilt), axis, -TURN * dx);
  return { position: plus(target, moved(away)), target, up: isFree ? moved(up) : up };
}

class Orbit {
  /**
   * element  takes the pointer and the arrow keys
   * changed  called with the view after each change
   * began    called before the first change of a gesture
   */
  constructor(element, changed, began = () => {}) {
    Object.assign(this, { changed, isFree: false, slope: 0.5, height: () => element.clientHeight || 1 });
    this.view = { position: [0, 0, 1], target: [0, 0, 0], up: [0, 1, 0] };
    const act = (change) => { began(); change(); };
    let last;
    gestures(element, {
      start: (event) => { last = event; },
      move: (event) => {
        act(() => this.turn(event.clientX - last.clientX, event.clientY - last.clientY));
        last = event;
      },
      pan: (dx, dy) => act(() => this.pan(dx, dy)),
      zoom: (factor) => act(() => this.zoom(factor)),
    });
    const turn = (right, down, many) => act(() => this.turn(10 * many * right, 10 * many * down));
    arrowKeys(element, turn, { many: 3, isOn: () => element.matches(":focus-visible") }); // a click leaves them to time
  }

  turn(dx, dy) { this.#set(turnedView(this.view, dx, dy, this.isFree)); }

  zoom(factor) {
    const { position, target } = this.view;
    this.#set({ position: plus(target, minus(position, target), factor) });
  }

  /** Move sideways, so that the place keeps to the pointer. `slope` is the picture's height at a distance of 1. */
  pan(dx, dy) {
    const { position, target, up } = this.view, away = minus(position, target), right = unitOf(cross(up, away));
    const unit = (this.slope * length(away)) / this.height();
    const shift = plus(right.map((x) => -dx * unit * x), unitOf(cross(away, right)), dy * unit);
    this.#set({ position: plus(position, shift), target: plus(target, shift) });
  }

  get distance() { return length(minus(this.view.position, this.view.target)); }

  /** Point a camera of three.js as the view is. */
  point(camera) {
    const { position, target, up } = this.view;
    camera.up.fromArray(up);
    camera.position.fromArray(position);
    camera.lookAt(...target);
    camera.updateMatrixWorld();
  }

  #set(view) {
    Object.assign(this.view, view);
    this.changed(this.view);
  }

  /** The keys of the help. */
  get keys() {
    return [
      ["drag", "Turn; also arrow keys, once Tab has come here"],
      ["wheel", "Closer, farther; also + − and two fingers", { "+": () => this.zoom(0.8), "=": () => this.zoom(0.8), "-": () => this.zoom(1.25) }],
      ["Shift drag", "Move sideways; also the right button, two fingers"],
      ["T", "Turn freely, or about the vertical axis", { t: () => { this.isFree = !this.isFree; } }],
    ];
  }
}
