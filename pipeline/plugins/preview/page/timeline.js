// Every value that changes over time, as a curve over the frames; the chosen one is large and its keys are edited.

class Timeline {
  constructor(page, holder) {
    Object.assign(this, { page, holder, rows: [], chosen: "", point: 0 });
  }

  /** Show the curves of a new state. */
  take(values) {
    const curves = values.filter((value) => value.curve);
    const inside = this.holder.contains(document.activeElement) ? document.activeElement.dataset.focus : null;
    const scrolled = this.holder.scrollTop;
    if (!curves.some((value) => nameOf(value.where) === this.chosen)) this.chosen = "";
    this.rows = curves.map((value) => new CurveRow(this, value));
    this.holder.replaceChildren(...this.rows.map((row) => row.element));
    if (!curves.length) this.holder.append(make("p", "about", "\u2003Nothing changes over time. ◆ beside a value gives it keys."));
    this.draw();
    this.holder.scrollTop = scrolled;
    if (inside) this.holder.querySelector(`[data-focus="${CSS.escape(inside)}"]`)?.focus();
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
    Object.assign(this, { timeline, value, page: timeline.page });
    this.name = nameOf(value.where);
    this.isChosen = timeline.chosen === this.name;
    const title = `${this.name}${value.unit ? ` (${value.unit})` : ""}`;
    const open = buttonOf(this.title, title, () => timeline.choose(this.name), { className: "open", ariaExpanded: this.isChosen });
    open.dataset.focus = `${this.name} open`;
    this.label = make("div", "label", open);
    const plot = make("div");
    this.element = make("div", `track curve${this.isChosen ? " chosen" : ""}`, this.label, plot);
    this.element.dataset.curve = this.name;
    this.plot = new CurvePlot(this, plot);
    if (this.isChosen && value.curve.formula === null) this.#addSettings();
  }

  get title() {
    const group = groupOf(this.value.where), [words] = titleOf(group), rest = this.value.where.slice(group.length).join(" ");
    const number = flowsAt(group) >= 0 ? ` ${group.filter((part) => typeof part === "number").join(".")}` : "";
    return `${words}${number} ${rest}`.trim().replaceAll("_", " ");
  }

  get keys() { return this.value.curve.keys; }
  get key() { return this.keys[Math.min(this.timeline.point, this.keys.length - 1)]; }

  /** The easing from a key to the next. */
  easeOf(key) { return key.ease ?? (key.right ? "bezier" : this.value.curve.ease); }

  /** The edits that set part of a key: `value`, `ease`, `left` or `right`. */
  keyEdits(key, part, given) {
    const where = [...this.value.where, "keys", key.time];
    if (isDetailed(this.value, key)) return [{ kind: given === null ? "remove" : "set", where: [...where, part], value: given }];
    if (part === "value") return [{ kind: "set", where, value: given }];
    return [{ kind: "set", where, value: { value: this.value.is_vector ? key.value : key.value[0], [part]: given } }];
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
    const { shot } = this.page, value = shot.at(this.value, frame), row = Array.isArray(value) ? value : [value];
    if (this.keys.some((key) => key.frame === frame)) return;
    const given = row.map((number) => rounded(number, this.plot.step / 10));
    this.timeline.point = this.keys.filter((key) => key.frame < frame).length;
    shot.edit([{ kind: "set", where: [...this.value.where, "keys", frame], value: this.value.is_vector ? given : given[0] }]);
  }

  #addSettings() {
    const { key } = this, { where, curve } = this.value, { shot } = this.page;
    const part = this.label.appendChild(make("div", "settings"));
    const list = (words, names, value, set) => {
      const select = listOf(`${this.title}: ${words}`, names.map((name) => [name, name.replaceAll("_", " ")]), set);
      select.value = value;
      select.dataset.focus = `${this.name} ${words}`;
      part.append(make("span", {}, words), select);
    };
    const isLast = this.keys.indexOf(key) === this.keys.length - 1;
    if (!isLast) list(`from ${key.frame}`, EASES, this.easeOf(key), (ease) => shot.edit(this.keyEdits(key, "ease", ease)));
    else list("easing", EASES, curve.ease, (ease) => shot.edit([{ kind: "set", where: [...where, "ease"], value: ease }]));
    list("before", BEYOND, curve.before, (way) => shot.edit([{ kind: "set", where: [...where, "before"], value: way }]));
    list("after", BEYOND, curve.after, (way) => shot.edit([{ kind: "set", where: [...where, "after"], value: way }]));
    part.append(buttonOf(`Remove key ${key.frame}`, "Remove the key (Delete)", () => this.remove(key)));
  }
}

const EASES = ["constant", "linear", "bezier", ...["sine", "quad", "cubic", "quart", "quint", "expo", "circ", "back", "bounce", "elastic"].flatMap((name) => [`${name}_in`, `${name}_out`, `${name}_in_out`])];
const BEYOND = ["hold", "loop", "ping_pong", "offset", "continue"];
