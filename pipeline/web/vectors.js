// Vectors of three numbers.

const minus = (a, b) => a.map((x, i) => x - b[i]);
const plus = (a, b, factor = 1) => a.map((x, i) => x + factor * b[i]);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const length = (a) => Math.sqrt(dot(a, a));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unitOf = (vector) => vector.map((x) => x / (length(vector) || 1));

/** A vector turned about a unit axis: Rodrigues' formula. */
function rotated(vector, axis, angle) {
  const along = dot(axis, vector) * (1 - Math.cos(angle));
  return plus(plus(vector.map((x) => x * Math.cos(angle)), cross(axis, vector), Math.sin(angle)), axis, along);
}
