// Every value that changes over time, as a curve over the frames. The chosen one is large: its keys are dragged in time and
// value, and handles of Bézier segments drawn.

class Timeline {
  constructor(page, holder) { Object.assign(this, { page, holder, rows: [], chosen: "", point: 0 }); }

  /** Show the curves of a new state. */
  take(values) {
    const curves = values.filter((value) => value.curve);
    const scrolled = this.holder.scrollTop;
    if (!curves.some((value) => nameOf(value.where) === this.chosen)) this.chosen = "";
    this.rows = curves.map((value) => new CurveRow(this, value));
    redrawn(this.holder, () => {
      this.holder.replaceChildren(...this.rows.map((row) => row.element));
      if (!curves.length) this.holder.append(make("p", "about", "\u2003Nothing changes over time. ◆ beside a value gives it keys."));
      this.draw();
      this.holder.scrollTop = scrolled;
    });
  }

  choose(name) {
    this.chosen = this.chosen === name ? "" : name;
    this.point = 0;
    this.take(this.page.shot.state.values);
    this.rows.find((row) => row.isChosen)?.element.scrollIntoView({ block: "nearest" });
  }

  draw() { for (const row of this.rows) row.plot.draw(); }
  drawFrame() { for (const row of this.rows) row.plot.drawNow(); }
}

/** One curve: its name, the settings of the chosen key, and its plot. */
class CurveRow {
  constructor(timeline, value) {
    Object.assign(this, { timeline, value, page: timeline.page, name: nameOf(value.where), title: value.words });
    this.isChosen = timeline.chosen === this.name;
    const title = `${this.name}${value.unit ? ` (${value.unit})` : ""}`;
    const choose = () => timeline.choose(this.name), data = { focus: `${this.name} open` };
    this.label = make("div", "label", buttonOf(this.title, title, choose, { className: "open plain", ariaExpanded: this.isChosen, data }));
    this.plot = new CurvePlot(this);
    const className = `track curve${this.isChosen ? " chosen" : ""}`;
    this.element = make("div", { className, data: { curve: this.name } }, this.label, make("div", {}, this.plot.svg));
    if (this.isChosen && value.curve.formula === null) this.#addSettings();
  }

  get keys() { return this.value.curve.keys; }
  get key() { return this.keys[Math.min(this.timeline.point, this.keys.length - 1)]; }

  /** The easing from a key to the next. */
  easeOf(key) { return key.ease ?? (key.right ? "bezier" : this.value.curve.ease); }

  /** Numbers as the file has them. */
  inFile(numbers) { return this.value.is_vector ? numbers : numbers[0]; }

  /** The edits that set part of a key: `ease`, `left` or `right`. */
  keyEdits(key, part, given) {
    const where = [...this.value.where, "keys", key.time];
    if (key.is_detailed) return [{ kind: "set", where: [...where, part], value: given }];
    return [{ kind: "set", where, value: { value: this.inFile(key.value), [part]: given } }];
  }

  /** The time of a frame as the file has times: seconds where the key had them. */
  timeOf(frame, key) {
    const { first, fps } = this.page.shot.state;
    return typeof key.time === "string" ? `${+((frame - first) / fps).toFixed(4)}s` : frame;
  }

  remove(key) {
    if (this.keys.length === 1) this.page.refused(`${this.title}: its last key stays. ◆ beside its value makes it constant.`);
    else this.page.shot.edit([{ kind: "remove", where: [...this.value.where, "keys", key.time] }]);
  }

  add(frame) {
    const { shot } = this.page, row = [shot.at(this.value, frame)].flat();
    if (this.keys.some((key) => key.frame === frame)) return;
    const given = row.map((number) => rounded(number, this.plot.step / 10));
    this.timeline.point = this.keys.filter((key) => key.frame < frame).length;
    shot.edit([{ kind: "set", where: [...this.value.where, "keys", frame], value: this.inFile(given) }]);
  }

  #addSettings() {
    const { key } = this, { where, curve } = this.value, { shot } = this.page;
    const part = this.label.appendChild(make("div", "settings"));
    const list = (words, names, value, set) => {
      const shown = names.includes(value) ? names : [value, ...names]; // an easing with a number, such as settle 0.3
      const options = shown.map((name) => [name, name.replaceAll("_", " ")]);
      const select = listOf(`${this.title}: ${words}`, options, set, { value, data: { focus: `${this.name} ${words}` } });
      part.append(make("span", {}, words), select);
    };
    const setter = (name) => (value) => shot.edit([{ kind: "set", where: [...where, name], value }]);
    const isLast = this.keys.indexOf(key) === this.keys.length - 1;
    if (!isLast) list(`from ${key.frame}`, EASES, this.easeOf(key), (ease) => shot.edit(this.keyEdits(key, "ease", ease)));
    else list("easing", EASES, curve.ease, setter("ease"));
    list("before", BEYOND, curve.before, setter("before"));
    list("after", BEYOND, curve.after, setter("after"));
    part.append(buttonOf(`Remove key ${key.frame}`, "Remove the key (Delete)", () => this.remove(key)));
  }
}

const EASES = ["constant", "linear", "bezier", "settle", "drop", "drag", ...["sine", "quad", "cubic", "quart", "quint", "expo", "circ", "back", "bounce", "elastic"].flatMap((name) => [`${name}_in`, `${name}_out`, `${name}_in_out`])];
const BEYOND = ["hold", "loop", "ping_pong", "offset", "continue"];

class CurvePlot {
  constructor(row) {
    Object.assign(this, { row, page: row.page, value: row.value });
    this.svg = svg("svg", { role: row.isChosen ? "group" : "img", "aria-label": `${row.title} over the frames` });
    if (!row.isChosen) this.svg.addEventListener("pointerdown", () => row.timeline.choose(row.name));
    else this.svg.addEventListener("dblclick", (event) => event.target === this.svg && this.#keyed && row.add(Math.round(this.#frameAt(event))));
  }

  get #keyed() { return this.value.curve.formula === null; }
  get width() { return this.svg.clientWidth || 600; }
  get height() { return this.row.isChosen ? 148 : 38; }
  get step() { return stepOf(this.range[1] - this.range[0]); }

  x(frame) {
    const { first, last } = this.page.shot.state;
    return ((frame - first + 0.5) / (last - first + 1)) * this.width;
  }

  y(number) {
    const [low, high] = this.range, room = this.row.isChosen ? 14 : 6;
    return room + ((high - number) / (high - low)) * (this.height - 2 * room);
  }

  #frameAt(event) {
    const { first, last } = this.page.shot.state;
    return first - 0.5 + shareOf(this.svg, event).x * (last - first + 1);
  }

  #numberAt(event) {
    const [low, high] = this.range, room = 14;
    return high - ((shareOf(this.svg, event).y * this.height - room) / (this.height - 2 * room)) * (high - low);
  }

  draw() {
    const { curve } = this.value, all = [...curve.values.flat(), ...curve.keys.flatMap((key) => key.value)].filter(Number.isFinite);
    const low = Math.min(...all), high = Math.max(...all), air = high > low ? 0.08 * (high - low) : Math.max(0.5, Math.abs(high) * 0.2);
    this.range ??= [low - air, high + air];
    this.svg.replaceChildren();
    if (this.range[0] < 0 && this.range[1] > 0) this.svg.append(svg("line", { class: "zero", x1: 0, x2: this.width, y1: this.y(0), y2: this.y(0) }));
    curve.values[0].forEach((_, part) => {
      const points = curve.frames.map((frame, i) => `${this.x(frame).toFixed(1)} ${this.y(curve.values[i][part]).toFixed(1)}`);
      this.svg.append(svg("path", { class: `c${part}`, d: `M${points.join("L")}` }));
    });
    this.now = this.svg.appendChild(svg("line", { class: "now", y1: 0, y2: this.height }));
    if (this.row.isChosen) this.#drawChosen();
    else for (const key of curve.keys) key.value.forEach((number, part) => this.svg.append(svg("circle", { class: `key c${part}`, cx: this.x(key.frame), cy: this.y(number), r: 2.6 })));
    this.drawNow();
  }

  drawNow() {
    const x = this.x(this.page.shot.frameOf(this.value.where, this.page.film.at));
    if (this.now) setAttributes(this.now, { x1: x, x2: x });
  }

  #drawChosen() {
    const unit = this.value.unit ? ` ${this.value.unit}` : "";
    for (const [number, y] of [[this.range[1], 11], [this.range[0], this.height - 3]]) {
      this.svg.append(svg("text", { x: 4, y }, `${+number.toPrecision(3)}${unit}`));
    }
    this.value.curve.keys.forEach((key, index) => {
      if (index === this.row.timeline.point) this.#drawHandles(key, index);
      key.value.forEach((_, part) => this.#drawKey(key, index, part));
    });
  }

  #drawKey(key, index, part) {
    const letter = key.value.length > 1 ? ` ${"xyz"[part]}` : "";
    const text = `${written(key.value[part])} ${this.value.unit}`.trim();
    const point = this.svg.appendChild(handleOf(`Key at frame ${key.frame}${letter}`, `${this.row.name} ${index} ${part}`, key.value[part], text));
    const dot = point.appendChild(svg("circle", { class: `key c${part}${index === this.row.timeline.point ? " chosen" : ""}`, cx: this.x(key.frame), cy: this.y(key.value[part]), r: 5 }));
    point.addEventListener("focus", () => {
      if (this.row.timeline.point === index || gestures.active) return; // what is dragged stays until it is released
      this.row.timeline.point = index;
      this.row.timeline.take(this.page.shot.state.values);
    });
    point.addEventListener("keydown", (event) => {
      if (event.key !== "Delete" && event.key !== "Backspace") return;
      event.preventDefault();
      this.row.remove(key);
    });
    editable(this.page, point, this.value.where, {
      start: () => { this.row.timeline.point = index; },
      click: () => this.row.timeline.take(this.page.shot.state.values),
      edits: (event) => this.#keyEdits(key, this.#moved(event, key, part)),
      draw: (event) => {
        const to = this.#moved(event, key, part);
        setAttributes(dot, { cx: this.x(to.frame), cy: this.y(to.value[part]) });
      },
      keyed: (right, down, many) => this.#keyEdits(key, right ? this.#stepped(point, key, part, right * many) : this.#raised(key, part, -down * many)),
      gesture: (right) => `${this.row.name} ${right ? "key" : index}`,
    });
  }

  /** Where a drag has a key: at whole frames beside no other; Shift keeps its time, Ctrl its value. */
  #moved(event, key, part) {
    const { first, last } = this.page.shot.state;
    let frame = event.shiftKey ? key.frame : clamp(Math.round(this.#frameAt(event)), first, last);
    if (this.row.keys.some((other) => other !== key && other.frame === frame)) frame = key.frame;
    const number = event.ctrlKey ? key.value[part] : rounded(this.#numberAt(event), this.step / 2);
    return { frame, value: key.value.map((old, i) => (i === part ? number : old)) };
  }

  #keyEdits(key, to) {
    const { where } = this.value, edits = [];
    let moved = key;
    if (to.frame !== key.frame) {
      const time = this.row.timeOf(to.frame, key);
      edits.push({ kind: "rename", where: [...where, "keys", key.time], value: time });
      moved = { ...key, time };
    }
    if (to.value.some((number, i) => number !== key.value[i])) {
      const path = [...where, "keys", moved.time, ...(key.is_detailed ? ["value"] : [])];
      edits.push({ kind: "set", where: path, value: this.row.inFile(to.value) });
    }
    return edits;
  }

  /** A key some frames on, unless there is one; the focus goes with it. */
  #stepped(point, key, part, many) {
    const { first, last } = this.page.shot.state, { timeline, keys, name } = this.row, frame = clamp(key.frame + many, first, last);
    if (keys.some((other) => other.frame === frame)) return key;
    timeline.point = keys.filter((other) => other !== key && other.frame < frame).length;
    point.dataset.focus = `${name} ${timeline.point} ${part}`;
    return { frame, value: key.value };
  }

  #raised(key, part, many) {
    return { frame: key.frame, value: key.value.map((old, i) => (i === part ? rounded(old + many * this.step, this.step) : old)) };
  }

  /** The handles of the chosen key where its segments are Bézier curves. */
  #drawHandles(key, index) {
    const before = this.row.keys[index - 1], after = this.row.keys[index + 1];
    if (after && this.row.easeOf(key) === "bezier") this.#drawHandle(key, "right", after.frame - key.frame);
    if (before && this.row.easeOf(before) === "bezier") this.#drawHandle(key, "left", before.frame - key.frame);
  }

  #drawHandle(key, side, span) {
    const given = key[side] ?? this.#automatic(key, span / 3);
    key.value.forEach((number, part) => {
      const at = { x: this.x(key.frame + given[0]), y: this.y(number + given[1][part]) };
      const arm = this.svg.appendChild(svg("line", { class: "arm", x1: this.x(key.frame), y1: this.y(number), x2: at.x, y2: at.y }));
      const grip = this.svg.appendChild(handleOf(`${side} handle at frame ${key.frame}`, `${this.row.name} ${side} ${part}`, number + given[1][part]));
      const dot = grip.appendChild(svg("circle", { class: "grip", cx: at.x, cy: at.y, r: 4.5 }));
      const edits = (frames, value) => this.row.keyEdits(key, side, [rounded(frames, 0.1), this.row.inFile(given[1].map((old, i) => rounded(i === part ? value : old, this.step / 2)))]);
      const moved = (event) => {
        const frames = side === "right" ? Math.max(0, this.#frameAt(event) - key.frame) : Math.min(0, this.#frameAt(event) - key.frame);
        return [frames, this.#numberAt(event) - number];
      };
      editable(this.page, grip, this.value.where, {
        edits: (event) => edits(...moved(event)),
        draw: (event) => {
          const [frames, value] = moved(event);
          const x = this.x(key.frame + frames), y = this.y(number + value);
          setAttributes(dot, { cx: x, cy: y });
          setAttributes(arm, { x2: x, y2: y });
        },
        keyed: (right, down) => edits(given[0] + right, given[1][part] - down * this.step),
        gesture: () => `${this.row.name} ${side}`,
      });
    });
  }

  /** The handle that a key without one has, from the slope of the curve beside it. */
  #automatic(key, frames) {
    const row = [this.page.shot.at(this.value, key.frame + Math.sign(frames) * 0.5)].flat();
    return [frames, row.map((number, i) => ((number - key.value[i]) / 0.5) * Math.abs(frames))];
  }
}
