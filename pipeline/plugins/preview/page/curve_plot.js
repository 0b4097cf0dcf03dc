// The plot of one curve. Of the chosen curve keys are dragged in time and value, and handles of Bézier segments drawn.

class CurvePlot {
  constructor(row, holder) {
    Object.assign(this, { row, page: row.page, value: row.value, holder });
    this.svg = holder.appendChild(svg("svg", { role: row.isChosen ? "group" : "img", "aria-label": `${row.title} over the frames` }));
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
    const { first, last } = this.page.shot.state, box = this.svg.getBoundingClientRect();
    return first - 0.5 + ((event.clientX - box.left) / box.width) * (last - first + 1);
  }

  #numberAt(event) {
    const [low, high] = this.range, room = 14, box = this.svg.getBoundingClientRect();
    return high - ((event.clientY - box.top - room) / (this.height - 2 * room)) * (high - low);
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
    this.now?.setAttribute("x1", x);
    this.now?.setAttribute("x2", x);
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
    const told = { "aria-label": `Key at frame ${key.frame}${letter}`, "aria-valuenow": key.value[part], "aria-valuetext": `${written(key.value[part])} ${this.value.unit}`.trim() };
    const point = svg("g", { class: "point", tabindex: 0, role: "slider", ...told });
    point.dataset.focus = `${this.row.name} ${index} ${part}`;
    const dot = point.appendChild(svg("circle", { class: `key c${part}${index === this.row.timeline.point ? " chosen" : ""}`, cx: this.x(key.frame), cy: this.y(key.value[part]), r: 5 }));
    point.addEventListener("focus", () => {
      if (this.row.timeline.point === index || this.dragged) return;
      this.row.timeline.point = index;
      this.row.timeline.take(this.page.shot.state.values);
    });
    point.addEventListener("keydown", (event) => {
      if (event.key !== "Delete" && event.key !== "Backspace") return;
      event.preventDefault();
      this.row.remove(key);
    });
    editable(this.page, point, this.value.where, {
      start: () => {
        this.dragged = true;
        this.row.timeline.point = index;
      },
      click: () => { this.dragged = false; this.row.timeline.take(this.page.shot.state.values); },
      edits: (event) => this.#keyEdits(key, this.#moved(event, key, part)),
      draw: (event) => {
        const to = this.#moved(event, key, part);
        dot.setAttribute("cx", this.x(to.frame));
        dot.setAttribute("cy", this.y(to.value[part]));
      },
      keyed: (right, down, many) => this.#keyEdits(key, right ? this.#stepped(point, key, part, right * many) : this.#raised(key, part, -down * many)),
      gesture: (right) => `${this.row.name} ${right ? "key" : index}`,
    });
    this.svg.append(point);
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
      const path = [...where, "keys", moved.time, ...(isDetailed(this.value, key) ? ["value"] : [])];
      edits.push({ kind: "set", where: path, value: this.value.is_vector ? to.value : to.value[0] });
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
      const grip = svg("g", { class: "point", tabindex: 0, role: "slider", "aria-label": `${side} handle at frame ${key.frame}`, "aria-valuenow": number + given[1][part] });
      grip.dataset.focus = `${this.row.name} ${side} ${part}`;
      const dot = grip.appendChild(svg("circle", { class: "grip", cx: at.x, cy: at.y, r: 4.5 }));
      const edits = (frames, value) => this.row.keyEdits(key, side, [rounded(frames, 0.1), this.#parts(given[1].map((old, i) => rounded(i === part ? value : old, this.step / 2)))]);
      const moved = (event) => {
        const frames = side === "right" ? Math.max(0, this.#frameAt(event) - key.frame) : Math.min(0, this.#frameAt(event) - key.frame);
        return [frames, this.#numberAt(event) - number];
      };
      editable(this.page, grip, this.value.where, {
        start: () => { this.dragged = true; },
        edits: (event) => edits(...moved(event)),
        draw: (event) => {
          const [frames, value] = moved(event);
          for (const [element, x, y] of [[dot, "cx", "cy"], [arm, "x2", "y2"]]) {
            element.setAttribute(x, this.x(key.frame + frames));
            element.setAttribute(y, this.y(number + value));
          }
        },
        keyed: (right, down) => edits(given[0] + right, given[1][part] - down * this.step),
        gesture: () => `${this.row.name} ${side}`,
      });
      this.svg.append(grip);
    });
  }

  #parts(numbers) { return this.value.is_vector ? numbers : numbers[0]; }

  /** The handle that a key without one has, from the slope of the curve beside it. */
  #automatic(key, frames) {
    const { shot } = this.page, beside = shot.at(this.value, key.frame + Math.sign(frames) * 0.5), row = Array.isArray(beside) ? beside : [beside];
    return [frames, row.map((number, i) => ((number - key.value[i]) / 0.5) * Math.abs(frames))];
  }
}
