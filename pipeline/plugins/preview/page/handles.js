// Handles in the picture: the centre, the axis and the radius of each flow and region, at the current frame. The name
// beside a centre moves it too, for centres of several flows may lie at one place.

const NAMES = { centre: "centre", translate: "centre", axis: "axis", normal: "axis", radius: "radius" };
const LINE = 16, COLUMN = 84; // pixels that a name takes
const RING = 48;

class Handles {
  constructor(page, layer) { Object.assign(this, { page, layer, isShown: true }); }

  /** The flows and regions that have a place: by the path of each its centre, axis and radius. */
  get places() {
    const found = new Map();
    for (const value of this.page.shot.state?.values ?? []) {
      const { where, title, is_flow: isFlow } = value, name = where.at(-1), key = nameOf(where.slice(0, -1));
      if (isFlow && name in NAMES) found.set(key, { ...found.get(key), where: where.slice(0, -1), title, [NAMES[name]]: value });
    }
    return [...found.values()].filter((place) => place.centre || place.axis);
  }

  toggle() {
    this.isShown = !this.isShown;
    refresh();
    this.draw();
  }

  draw() {
    if (this.layer.contains(gestures.active?.element)) return;
    redrawn(this.layer, () => {
      this.layer.replaceChildren();
      const { projection } = this.page, { places } = this;
      if (!this.isShown || !projection || !this.page.shot.state || this.page.film.isPlaying) return;
      this.words = [];
      for (const place of places) this.#drawPlace(place, this.#nameOf(place, places));
    });
  }

  #now(value) { return this.page.shot.at(value, this.page.shot.frameOf(value.where, this.page.film.at)); }

  /** The name of a flow or region, with its number where others have the same. */
  #nameOf(place, places) {
    if (places.filter(({ title }) => title === place.title).length < 2) return place.title;
    return `${place.title} ${place.where.filter((part) => typeof part === "number").join(".")}`;
  }

  /** Where a pointer is in the viewer. */
  #pixel(event) {
    const box = this.layer.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  /** Draw the handles of a flow or region, where the compositions that it is within put it. */
  #drawPlace(place, title) {
    const { projection } = this.page, placement = placementOf(this.page.shot, place.where, this.page.film.at);
    const centre = placement.point(place.centre ? this.#now(place.centre) : [0, 0, 0]), at = projection.point(centre);
    if (!at) return;
    const axis = place.axis ? unitOf(placement.direction(vectorOf(this.#now(place.axis)))) : null;
    const radius = place.radius ? placement.scale * this.#now(place.radius) : null, size = radius > 0 ? radius : 90 * projection.unit(at.depth);
    const drawn = { title, projection, placement, centre, at, axis, size, around: this.layer.appendChild(svg("g")) };
    if (radius > 0) this.#ring(place.radius, drawn);
    if (axis) this.#axis(place.axis, drawn);
    if (place.centre) this.#centre(place.centre, drawn);
  }

  /**
   * Add the handle of a value. `given(event, begun)` is what the value becomes for a drag, `keyed(right, down)` for arrow
   * keys; `draw` shows it meanwhile.
   */
  #add(holder, words, value, shapes, { given, keyed, draw }) {
    const { page } = this, { shot, film } = page, now = this.#now(value), name = nameOf(value.where);
    const numbers = [now].flat().map((part) => (typeof part === "number" ? written(part) : part)).join(", ");
    const edits = (to) => {
      const change = shot.change(value, to, shot.frameOf(value.where, film.at));
      if (!change.length) page.note(formulaNote(value));
      return change;
    };
    const group = holder.appendChild(handleOf(words, name, 0, numbers));
    group.append(...shapes);
    group.classList.toggle("armed", page.perform.isArmed(value.where));
    editable(page, group, value.where, {
      edits: (...drag) => edits(given(...drag)),
      draw: (...drag) => draw(given(...drag)),
      keyed: (right, down, many) => edits(keyed(right * many, down * many)),
      gesture: () => `handle ${name}`,
      many: 5,
    });
  }

  #centre(value, { title, projection, placement, centre, at, around }) {
    const dot = svg("circle", { class: "spot", cx: at.x, cy: at.y, r: 6 }), words = svg("text", { x: at.x + 10, y: this.#lineFor(at) }, title);
    const step = (10 * projection.unit(at.depth)) / placement.scale;
    const moved = (dx, dy) => placement.pointInside(plus(centre, projection.shift(dx, dy, at.depth))).map((part) => rounded(part, step));
    this.#add(this.layer, `Centre of ${title}`, value, [dot, words], {
      given: (event, begun) => moved(event.clientX - begun.clientX, event.clientY - begun.clientY),
      keyed: (dx, dy) => moved(8 * dx, 8 * dy),
      draw: (to) => {
        const spot = projection.point(placement.point(to));
        for (const part of spot ? [around, dot, words] : []) setAttributes(part, { transform: `translate(${spot.x - at.x} ${spot.y - at.y})` });
      },
    });
  }

  /** Where the name of a centre goes: beside it, below names that are there. */
  #lineFor(at) {
    let y = at.y - 8;
    while (this.words.some((each) => Math.abs(each.x - at.x) < COLUMN && Math.abs(each.y - y) < LINE)) y += LINE;
    this.words.push({ x: at.x, y });
    return y;
  }

  #axis(value, { title, projection, placement, centre, axis, size, around }) {
    const from = projection.point(centre), to = projection.point(plus(centre, axis, size)), [right, up, forward] = projection.camera.axes;
    if (!from || !to) return;
    const [shade, stem] = ["shade", "stem"].map((name) => svg("line", { class: name, x1: from.x, y1: from.y, x2: to.x, y2: to.y }));
    const tip = svg("rect", { class: "tip", x: to.x - 5, y: to.y - 5, width: 10, height: 10, rx: 2 });
    this.#add(around, `Axis of ${title}`, value, [shade, stem, tip], {
      given: (event) => axisInWords(placement, sphereHit(projection, this.#pixel(event), centre, size, dot(axis, forward) < 0)),
      keyed: (dx, dy) => axisInWords(placement, unitOf(plus(plus(axis, right, 0.06 * dx), up, -0.06 * dy))),
      draw: (given) => {
        const end = projection.point(plus(centre, placement.direction(vectorOf(given)), size));
        if (!end) return;
        setAttributes(stem, { x2: end.x, y2: end.y });
        setAttributes(tip, { x: end.x - 5, y: end.y - 5 });
      },
    });
  }

  #ring(value, { title, projection, placement: { scale }, centre, at, axis, size: radius, around }) {
    const normal = axis ?? projection.camera.axes[2], first = unitOf(cross(normal, Math.abs(normal[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0])), second = cross(normal, first);
    const path = (size) => {
      const angles = Array.from({ length: RING }, (_, i) => (2 * Math.PI * i) / RING);
      const points = angles.map((angle) => projection.point(plus(plus(centre, first, size * Math.cos(angle)), second, size * Math.sin(angle))));
      return points.every(Boolean) ? `M${points.map((point) => `${point.x.toFixed(1)} ${point.y.toFixed(1)}`).join("L")}Z` : "";
    };
    const away = (event) => Math.hypot(this.#pixel(event).x - at.x, this.#pixel(event).y - at.y), now = radius / scale;
    const [shade, rim, grip] = ["shade", "rim", "grip"].map((name) => svg("path", { class: name, d: path(radius) }));
    const sized = (number, step) => Math.max(1e-3, rounded(number, step));
    this.#add(around, `Radius of ${title}`, value, [shade, rim, grip], {
      given: (event, begun) => sized((now * away(event)) / Math.max(4, away(begun)), (10 * projection.unit(at.depth)) / scale),
      keyed: (dx, dy) => sized(now * (1 + 0.05 * (dx - dy)), now / 100),
      draw: (size) => setAttributes(rim, { d: path(scale * size) }),
    });
  }
}

/** An axis as the file has it: a letter within three degrees of x, y or z, else a vector. */
function axisInWords(placement, direction) {
  const axis = placement.directionInside(direction), i = axis.findIndex((part) => part > Math.cos((3 * Math.PI) / 180));
  return i < 0 ? axis.map((part) => rounded(part, 0.01)) : "xyz"[i];
}

const vectorOf = (axis) => (typeof axis === "string" ? ["x", "y", "z"].map((name) => +(name === axis)) : unitOf(axis));

/** The direction from a sphere's centre to where a pixel's ray meets it; to where it comes nearest if it misses. */
function sphereHit(projection, pixel, centre, size, isNear) {
  const ray = projection.ray(pixel), away = minus(centre, projection.camera.origin), along = dot(away, ray);
  const miss = minus(ray.map((part) => part * along), away), under = size * size - dot(miss, miss);
  return unitOf(under > 0 ? plus(miss, ray, (isNear ? -1 : 1) * Math.sqrt(under)) : miss);
}
