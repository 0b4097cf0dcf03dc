// The frames of reference that flows are in: `placed` scales, turns and moves its flows, `mirrored` mirrors them.

const transposed = (rows) => rows[0].map((_, i) => rows.map((row) => row[i]));
const turned = (rows, vector) => rows.map((row) => dot(row, vector));
const multiplied = (a, b) => transposed(transposed(b).map((column) => turned(a, column)));

class Placement {
  /** A point is at `origin` + `scale` `turn` · point, with an orthogonal matrix by rows. */
  constructor(origin, turn, scale) { Object.assign(this, { origin, turn, scale }); }

  point(place) { return plus(this.origin, turned(this.turn, place), this.scale); }
  pointInside(place) { return turned(transposed(this.turn), minus(place, this.origin)).map((x) => x / this.scale); }
  direction(axis) { return turned(this.turn, axis); }
  directionInside(axis) { return turned(transposed(this.turn), axis); }

  /** The placement of what is placed within this one. */
  around(inner) { return new Placement(this.point(inner.origin), multiplied(this.turn, inner.turn), this.scale * inner.scale); }
}

const UNMOVED = new Placement([0, 0, 0], [[1, 0, 0], [0, 1, 0], [0, 0, 1]], 1);

/** Turns about x, then y, then z, degrees, as rows of a matrix. */
function rotationBy(degrees) {
  const [[cx, sx], [cy, sy], [cz, sz]] = degrees.map((each) => [Math.cos((each * Math.PI) / 180), Math.sin((each * Math.PI) / 180)]);
  const x = [[1, 0, 0], [0, cx, -sx], [0, sx, cx]], y = [[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]], z = [[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]];
  return multiplied(z, multiplied(y, x));
}

/** The placement that the flows of one `placed` or `mirrored` have, by its path, at a frame of the film. */
function placementBy(shot, where, frame) {
  const at = (name, otherwise) => {
    const value = shot.get([...where, name]);
    return value ? shot.at(value, shot.frameOf(where, frame)) : otherwise;
  };
  if (where.at(-1) === "placed") return new Placement(at("translate", [0, 0, 0]), rotationBy(at("rotate", [0, 0, 0])), at("scale", 1));
  const normal = unitOf(at("normal", [1, 0, 0])), centre = at("centre", [0, 0, 0]);
  const mirror = UNMOVED.turn.map((row, i) => row.map((x, k) => x - 2 * normal[i] * normal[k]));
  return new Placement(minus(centre, turned(mirror, centre)), mirror, 1);
}

/** The placement of a flow or region by its path: that of all `placed` and `mirrored` it is within. */
function placementOf(shot, where, frame) {
  const around = where.flatMap((part, i) => (["placed", "mirrored"].includes(part) && where[i + 1] === "flows" ? [where.slice(0, i + 1)] : []));
  return around.reduce((outer, each) => outer.around(placementBy(shot, each, frame)), UNMOVED);
}
