// From places in the scene to places in the viewer and back, by the camera of the picture that is shown.

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
  ray(x, y) {
    const { axes, half, aspect } = this.camera;
    const across = ((x - this.box.left) / this.box.width) * 2 - 1, along = 1 - ((y - this.box.top) / this.box.height) * 2;
    return unitOf(plus(plus(axes[2], axes[0], across * half), axes[1], (along * half) / aspect));
  }
}
