// Vectors of three numbers, and a camera around a place: turned by pointer and keys about the vertical axis, as on a
// turntable, or freely.

const minus = (a, b) => a.map((x, i) => x - b[i]);
const plus = (a, b, factor = 1) => a.map((x, i) => x + factor * b[i]);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const length = (a) => Math.sqrt(dot(a, a));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unitOf = (vector) => vector.map((x) => x / (length(vector) || 1));

/** A vector turned about an axis, by radians. */
function rotated([x, y, z], axis, angle) {
  const turned = new DOMMatrix().rotateAxisAngle(...axis, (180 / Math.PI) * angle).transformPoint({ x, y, z });
  return [turned.x, turned.y, turned.z];
}

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
    gestures(element, {
      move: (event, begun, dx, dy) => act(() => this.turn(dx, dy)),
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

/**
 * A scene of three.js in a canvas, seen by the shot's camera until somebody turns it. Its classes have `aim()`, which
 * points the orbit as the shot's camera is, and `render()`.
 */
class ShotView {
  constructor(THREE, renderer) {
    Object.assign(this, { THREE, renderer, canvas: renderer.domElement, follows: true, scene: new THREE.Scene() });
    this.camera = new THREE.PerspectiveCamera(26, 1, 0.01, 10000);
    this.orbit = new Orbit(this.canvas, () => this.look(), () => this.follow(false));
  }

  /** Look through the shot's camera, or stay where it is. */
  follow(follows) {
    this.follows = follows;
    refresh();
    if (follows) this.look();
  }

  look() {
    if (this.follows) this.aim();
    this.orbit.point(this.camera);
    this.render();
  }

  /** See so much in height at a distance of 1. */
  widen(slope) {
    this.orbit.slope = slope;
    this.camera.fov = (360 / Math.PI) * Math.atan(slope / 2);
    this.camera.updateProjectionMatrix();
  }

  /** Take the size that CSS gives the canvas. */
  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.look();
  }
}
