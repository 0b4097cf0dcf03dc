// The frames of reference that flows are in: `placed` scales, turns and moves its flows, `mirrored` mirrors them. And
// from places in the scene to places in the viewer and back, by the camera of the picture that is shown.

const vectorFrom = ({ x, y, z }) => [x, y, z];
const transformed = (matrix, [x, y, z], w = 1) => vectorFrom(matrix.transformPoint({ x, y, z, w }));

/** A frame of reference as a matrix that scales alike in all directions. Directions are unit vectors. */
class Placement {
  constructor(matrix) { this.matrix = matrix; }

  get scale() { return length(transformed(this.matrix, [1, 0, 0], 0)); }
  point(place) { return transformed(this.matrix, place); }
  pointInside(place) { return transformed(this.matrix.inverse(), place); }
  direction(axis) { return unitOf(transformed(this.matrix, axis, 0)); }
  directionInside(axis) { return unitOf(transformed(this.matrix.inverse(), axis, 0)); }
}

/** The matrix of one `placed` or `mirrored`, by its path, at a frame of the film. */
function matrixOf(shot, where, frame) {
  const at = (name, otherwise) => {
    const value = shot.get([...where, name]);
    return value ? shot.at(value, shot.frameOf(where, frame)) : otherwise;
  };
  const matrix = new DOMMatrix(), scale = at("scale", 1);
  if (where.at(-1) === "placed") { // turned about x, then y, then z, degrees
    return matrix.translate(...at("translate", [0, 0, 0])).rotate(...at("rotate", [0, 0, 0])).scale(scale, scale, scale);
  }
  const normal = unitOf(at("normal", [1, 0, 0])), centre = at("centre", [0, 0, 0]);
  const columns = normal.flatMap((x, i) => [...normal.map((y, k) => (i === k) - 2 * x * y), 0]);
  return matrix.translate(...centre).multiply(new DOMMatrix([...columns, 0, 0, 0, 1])).translate(...centre.map((x) => -x));
}

/** The placement of a flow or region by its path: that of all `placed` and `mirrored` it is within. */
function placementOf(shot, where, frame) {
  const around = where.flatMap((part, i) => (["placed", "mirrored"].includes(part) && where[i + 1] === "flows" ? [where.slice(0, i + 1)] : []));
  return new Placement(around.reduce((outer, each) => outer.multiply(matrixOf(shot, each, frame)), new DOMMatrix()));
}

class Projection {
  /**
   * camera  {origin, axes: right, up and forward, half: half the width seen at depth 1, aspect}
   * box     {left, top, width, height} of the picture in the viewer, CSS pixels
   */
  constructor(camera, box) { Object.assign(this, { camera, box }); }

  /** The place in the viewer of a point, with its depth; null behind the camera. */
  point(place) {
    const { origin, axes, half, aspect } = this.camera, away = minus(place, origin), depth = dot(away, axes[2]);
    if (depth <= 1e-9) return null;
    const x = dot(away, axes[0]) / (depth * half), y = (dot(away, axes[1]) / (depth * half)) * aspect;
    return { x: this.box.left + ((x + 1) / 2) * this.box.width, y: this.box.top + ((1 - y) / 2) * this.box.height, depth };
  }

  /** Scene units to a pixel at a depth. */
  unit(depth) { return (2 * this.camera.half * depth) / this.box.width; }

  /** The shift in the scene, along the plane of the picture, of so many pixels at a depth. */
  shift(dx, dy, depth) {
    const unit = this.unit(depth), [right, up] = this.camera.axes;
    return plus(right.map((x) => x * dx * unit), up, -dy * unit);
  }

  /** The unit vector through a pixel, from the camera. */
  ray({ x, y }) {
    const { axes, half, aspect } = this.camera;
    const across = ((x - this.box.left) / this.box.width) * 2 - 1, along = 1 - ((y - this.box.top) / this.box.height) * 2;
    return unitOf(plus(plus(axes[2], axes[0], across * half), axes[1], (along * half) / aspect));
  }
}
