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
      const { where } = value, name = where.at(-1);
      if (flowsAt(where) < 0 || !(name in NAMES)) continue;
      const key = nameOf(where.slice(0, -1));
      found.set(key, { ...found.get(key), where: where.slice(0, -1), [NAMES[name]]: value });
    }
    return [...found.values()].filter((place) => place.centre || place.axis);
  }

  toggle() {
    this.isShown = !this.isShown;
    this.draw();
  }

  draw() {
    if (this.layer.contains(gestures.active?.element)) return;
    const focused = this.layer.contains(document.activeElement) ? document.activeElement.dataset.handle : null;
    this.layer.replaceChildren();
    const projection = this.page.projection;
    if (!this.isShown || !projection || !this.page.shot.state || this.page.film.isPlaying) return;
    const { places } = this;
    this.words = [];
    for (const place of places) this.#drawPlace(place, projection, this.#nameOf(place, places));
    if (focused) this.layer.querySelector(`[data-handle="${CSS.escape(focused)}"]`)?.focus();
  }

  #now(value) { return this.page.shot.at(value, this.page.shot.frameOf(value.where, this.page.film.at)); }

  /** The name of a flow or region, with its number where others have the same. */
  #nameOf(place, places) {
    const titleAt = (each) => titleOf(groupOf([...each.where, ""]))[0], title = titleAt(place);
    if (places.filter((each) => titleAt(each) === title).length < 2) return title;
    return `${title} ${place.where.filter((part) => typeof part === "number").join(".")}`;
  }

  /** Draw the handles of a flow or region, where the compositions that it is within put it. */
  #drawPlace(place, projection, title) {
    const placement = place.placement = placementOf(this.page.shot, place.where, this.page.film.at);
    const centre = placement.point(place.centre ? this.#now(place.centre) : [0, 0, 0]), at = projection.point(centre);
    if (!at) return;
    const axis = place.axis ? unitOf(placement.direction(this.#now(place.axis))) : null;
    const radius = place.radius ? placement.scale * this.#now(place.radius) : null;
    const around = this.layer.appendChild(svg("g"));
    if (radius > 0) this.#ring(place, centre, axis, radius, projection, title, around);
    if (axis) this.#axis(place, centre, axis, radius > 0 ? radius : 90 * projection.unit(at.depth), projection, title, around);
    if (place.centre) this.#centre(place, centre, at, projection, title, around);
  }

  #group(holder, name, label, value) {
    const group = holder.appendChild(svg("g", { tabindex: 0, role: "slider", "aria-label": label, "aria-valuenow": 0, "aria-valuetext": value }));
    group.dataset.handle = name;
    return group;
  }

  /** Wire a handle: `given(event, begun)` is what its value becomes for a drag, and `keyed(right, down)` for arrow keys. */
  #wire(group, value, given, keyed, draw) {
    const { page } = this, { shot, film } = page;
    const edits = (to) => {
      const change = shot.change(value, to, shot.frameOf(value.where, film.at));
      if (!change.length) page.note(formulaNote(value));
      return change;
    };
    editable(page, group, value.where, {
      edits: (...drag) => edits(given(...drag)),
      draw: (...drag) => draw(given(...drag)),
      keyed: (right, down, many) => edits(keyed(right * many, down * many)),
      gesture: () => `handle ${group.dataset.handle}`,
      many: 5,
    });
  }

  #centre(place, centre, at, projection, title, around) {
    const { placement, centre: value } = place;
    const group = this.#group(this.layer, nameOf(value.where), `Centre of ${title}`, this.#now(value).map(written).join(", "));
    const dot = group.appendChild(svg("circle", { class: "spot", cx: at.x, cy: at.y, r: 6 }));
    const words = group.appendChild(svg("text", { x: at.x + 10, y: this.#lineFor(at) }, title));
    const step = projection.unit(at.depth);
    const moved = (dx, dy) => placement.pointInside(plus(centre, projection.shift(dx, dy, at.depth))).map((part) => rounded(part, (10 * step) / placement.scale));
    const draw = (to) => {
      const spot = projection.point(placement.point(to));
      if (!spot) return;
      dot.setAttribute("cx", spot.x);
      dot.setAttribute("cy", spot.y);
      for (const part of [around, words]) part.setAttribute("transform", `translate(${spot.x - at.x} ${spot.y - at.y})`);
    };
    this.#wire(group, value, (event, begun) => moved(event.clientX - begun.clientX, event.clientY - begun.clientY), (dx, dy) => moved(8 * dx, 8 * dy), draw);
  }

  /** Where the name of a centre goes: beside it, below names that are there. */
  #lineFor(at) {
    let y = at.y - 8;
    while (this.words.some((each) => Math.abs(each.x - at.x) < COLUMN && Math.abs(each.y - y) < LINE)) y += LINE;
    this.words.push({ x: at.x, y });
    return y;
  }

  #axis(place, centre, axis, size, projection, title, around) {
    const from = projection.point(centre), to = projection.point(plus(centre, axis, size));
    if (!from || !to) return;
    const group = this.#group(around, nameOf(place.axis.where), `Axis of ${title}`, this.#now(place.axis).map(written).join(", "));
    group.append(svg("line", { class: "shade", x1: from.x, y1: from.y, x2: to.x, y2: to.y }));
    const stem = group.appendChild(svg("line", { class: "stem", x1: from.x, y1: from.y, x2: to.x, y2: to.y }));
    const tip = group.appendChild(svg("rect", { class: "tip", x: to.x - 5, y: to.y - 5, width: 10, height: 10, rx: 2 }));
    const { placement } = place, isNear = dot(axis, projection.camera.axes[2]) < 0;
    const aimed = (event) => {
      const box = this.layer.getBoundingClientRect();
      return this.#written(placement, sphereHit(projection, event.clientX - box.left, event.clientY - box.top, centre, size, isNear));
    };
    const draw = (given) => {
      const end = projection.point(plus(centre, placement.direction(vectorOf(given)), size));
      if (!end) return;
      stem.setAttribute("x2", end.x); stem.setAttribute("y2", end.y);
      tip.setAttribute("x", end.x - 5); tip.setAttribute("y", end.y - 5);
    };
    const tilted = (dx, dy) => this.#written(placement, unitOf(plus(plus(axis, projection.camera.axes[0], 0.06 * dx), projection.camera.axes[1], -0.06 * dy)));
    this.#wire(group, place.axis, aimed, tilted, draw);
  }

  /** An axis as the file has it: a letter within three degrees of x, y or z, else a vector. */
  #written(placement, direction) {
    const axis = placement.directionInside(direction), i = axis.findIndex((part) => part > Math.cos((3 * Math.PI) / 180));
    return i < 0 ? axis.map((part) => rounded(part, 0.01)) : "xyz"[i];
  }

  #ring(place, centre, axis, radius, projection, title, around) {
    const normal = axis ?? projection.camera.axes[2], first = unitOf(cross(normal, Math.abs(normal[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0])), second = cross(normal, first);
    const path = (size) => {
      const points = Array.from({ length: RING }, (_, i) => projection.point(plus(plus(centre, first, size * Math.cos((2 * Math.PI * i) / RING)), second, size * Math.sin((2 * Math.PI * i) / RING))));
      return points.every(Boolean) ? `M${points.map((point) => `${point.x.toFixed(1)} ${point.y.toFixed(1)}`).join("L")}Z` : "";
    };
    const group = this.#group(around, nameOf(place.radius.where), `Radius of ${title}`, written(radius / place.placement.scale)), d = path(radius);
    group.append(svg("path", { class: "shade", d }));
    const rim = group.appendChild(svg("path", { class: "rim", d }));
    group.append(svg("path", { class: "grip", d }));
    const at = projection.point(centre), { layer } = this, { scale } = place.placement;
    const sized = (event, begun) => {
      const box = layer.getBoundingClientRect(), away = (each) => Math.hypot(each.clientX - box.left - at.x, each.clientY - box.top - at.y);
      return Math.max(1e-3, rounded((radius * away(event)) / Math.max(4, away(begun)) / scale, (10 * projection.unit(at.depth)) / scale));
    };
    this.#wire(group, place.radius, sized, (dx, dy) => Math.max(1e-3, rounded((radius / scale) * (1 + 0.05 * (dx - dy)), radius / scale / 100)), (size) => rim.setAttribute("d", path(scale * size)));
  }
}

const vectorOf = (axis) => (typeof axis === "string" ? ["x", "y", "z"].map((name) => +(name === axis)) : unitOf(axis));

/** The direction from a sphere's centre to where a pixel's ray meets it; to where it comes nearest if it misses. */
function sphereHit(projection, x, y, centre, size, isNear) {
  const ray = projection.ray(x, y), away = minus(centre, projection.camera.origin), along = dot(away, ray);
  const miss = minus(ray.map((part) => part * along), away), under = size * size - dot(miss, miss);
  return unitOf(under > 0 ? plus(miss, ray, (isNear ? -1 : 1) * Math.sqrt(under)) : miss);
}
