// The controls of one value each. What they set goes through the shot's edits, at the current frame where it has keys.

/** A step of 1, 2 or 5 times a power of ten for about so many steps over a span. */
function stepOf(span, many = 200) {
  const rough = span / many || 0.01, power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((each) => each * power >= rough * 0.999) ?? 10);
}

/** The range of a slider: between the bounds of a value if it has both, else wide enough around it. */
function rangeOf(value, number) {
  const { low, high } = value, reach = Math.max(2 * Math.abs(number), value.unit === "degrees" ? 90 : 1);
  if (low !== null && high !== null && high - low <= 3600) return [low, high];
  return [low ?? -reach, Math.min(high ?? reach, reach)];
}

/** Show a text in a field whatever was typed there. */
function replaceIn(input, text) { input.value = input.shownText = text; }

class Field {
  constructor(page, value, name) {
    Object.assign(this, { page, value });
    this.row = make("div", "field", make("span", "name", name));
    this.row.dataset.path = nameOf(value.where);
    this.name = name;
    this.words = `${name}${value.unit ? `, ${value.unit}` : ""}`;
    this.gestures = 0;
  }

  /** Take the value of a new state of the file. */
  take(value) {
    this.value = value;
    this.row.classList.toggle("given", value.is_given);
    const from = value.file ? ` From ${value.file.split("/").at(-1)}; an edit is written into this shot.` : "";
    this.row.title = `${nameOf(value.where)}: ${value.description}${value.unit ? ` (${value.unit})` : ""}.${from}`;
    this.draw();
  }

  get frame() { return this.page.shot.frameOf(this.value.where, this.page.film.at); }
  get now() { return this.page.shot.at(this.value, this.frame); }

  changes(given) { return this.page.shot.change(this.value, given, this.frame); }

  show(given) { this.page.follow.show(this.changes(given)); }
  set(given, gesture = "") { return this.page.follow.end(this.changes(given), gesture); }

  draw() {}

  /** The button that turns a constant into keys, and sets or removes the key of the current frame. */
  addKeyButton() {
    this.key = buttonOf("◆", "", () => this.toggleKey(), { className: "key" });
    this.row.append(this.key);
  }

  get keyHere() { return this.value.curve?.keys.find((key) => Math.abs(key.frame - this.frame) < 1e-6); }

  toggleKey() {
    const { value } = this, { where } = value;
    if (!value.curve) this.page.shot.edit([{ kind: "set", where, value: { keys: { [this.frame]: this.now } } }]);
    else if (!this.keyHere) this.page.shot.edit(this.changes(this.#roundedNow()));
    else if (value.curve.keys.length > 1) this.page.shot.edit([{ kind: "remove", where: [...where, "keys", this.keyHere.time] }]);
    else this.page.shot.edit([{ kind: "set", where, value: this.now }]);
  }

  #roundedNow() {
    const { now } = this, round = (number) => rounded(number, stepOf(Math.max(1, Math.abs(number)), 1000));
    return Array.isArray(now) ? now.map(round) : round(now);
  }

  drawKey() {
    if (!this.key) return;
    const { curve } = this.value, isKeyed = Boolean(curve?.keys.length);
    this.key.hidden = Boolean(curve && curve.formula !== null);
    this.key.classList.toggle("keyed", isKeyed);
    this.key.textContent = isKeyed && !this.keyHere ? "◇" : "◆";
    const words = !curve ? "Give it keys, the first at this frame" : this.keyHere ? "Remove the key of this frame" : "Set a key at this frame";
    Object.assign(this.key, { title: words, ariaLabel: `${this.name}: ${words}`, ariaPressed: Boolean(this.keyHere) });
  }

  /** A field for a number: Enter sets, arrows step, Escape gives up. */
  numberInput(label, get, set, step) {
    const input = make("input", { type: "text", inputMode: "decimal", autocomplete: "off", ariaLabel: label });
    const typed = () => (input.value.trim() === "" ? NaN : Number(input.value.trim().replace(",", ".").replace("−", "-")));
    input.addEventListener("focus", () => { this.gestures += 1; input.select(); });
    input.addEventListener("change", () => {
      if (Number.isFinite(typed())) set(typed(), "");
      else if (input.value.trim()) this.page.refused(`${this.name}: ${input.value.trim().slice(0, 40)} is no number. Write one, such as 0.5.`);
      replaceIn(input, written(get()));
    });
    input.addEventListener("keydown", (event) => {
      if (event.key === "Escape") replaceIn(input, written(get()));
      const way = { ArrowUp: 1, ArrowDown: -1 }[event.key];
      if (event.key === "Escape" || event.key === "Enter") input.blur();
      if (!way) return;
      event.preventDefault();
      const each = step() * (event.shiftKey ? 10 : 1), next = rounded(get() + way * each, each);
      replaceIn(input, written(next));
      set(next, `${nameOf(this.value.where)} ${this.gestures}`);
    });
    return input;
  }
}

/** A number as a field shows it. */
function written(number) { return String(+Number(number).toPrecision(6)); }

class NumberValue extends Field {
  constructor(page, value, name) {
    super(page, value, name);
    const number = Number(this.now);
    [this.low, this.high] = rangeOf(value, number);
    this.slider = sliderOf(this.words, this.low, this.high, this.step, () => { replaceIn(this.input, written(this.#slid)); this.show(this.#slid); });
    this.input = this.numberInput(`${this.words}, number`, () => this.now, (to, gesture) => this.set(this.#fit(to), gesture), () => this.step);
    this.row.append(this.slider, this.input);
    if (value.can_change || value.curve) this.addKeyButton();
    this.slider.addEventListener("pointerdown", () => page.follow.prepare(value.where));
    this.slider.addEventListener("change", () => this.set(this.#slid));
    this.take(value);
  }

  get step() { return this.value.form === "whole" ? 1 : stepOf(this.high - this.low); }
  get #slid() { return this.#fit(rounded(Number(this.slider.value), this.step)); }
  #fit(number) { return this.value.form === "whole" ? Math.round(number) : number; }

  draw() {
    const number = Number(this.now);
    if (number > this.high) this.high = number;
    if (number < this.low) this.low = number;
    const isFormula = this.value.curve && this.value.curve.formula !== null;
    Object.assign(this.slider, { min: this.low, max: this.high, step: this.step, value: number, disabled: isFormula });
    if (this.value.low === 0 && this.low === 0 && this.step < number) this.slider.min = this.value.form === "whole" ? 0 : this.step;
    this.input.disabled = isFormula;
    const isBetween = this.value.curve && !this.keyHere; // keys: as many digits as one can tell apart
    showValue(this.input, isBetween ? String(+number.toPrecision(4)) : written(number));
    this.drawKey();
  }
}

class VectorValue extends Field {
  constructor(page, value, name) {
    super(page, value, name);
    this.inputs = ["x", "y", "z"].map((axis, i) => {
      const set = (to, gesture) => this.set(this.now.map((old, k) => (k === i ? to : rounded(old, 1e-4))), gesture);
      return this.numberInput(`${this.words}, ${axis}`, () => this.now[i], set, () => 0.05);
    });
    this.row.append(make("span", "wide", ...this.inputs));
    if (value.can_change || value.curve) this.addKeyButton();
    this.take(value);
  }

  draw() {
    const isFormula = this.value.curve && this.value.curve.formula !== null;
    this.inputs.forEach((input, i) => {
      input.disabled = isFormula;
      showValue(input, written(this.now[i]));
    });
    this.drawKey();
  }
}

class NameValue extends Field {
  constructor(page, value, name) {
    super(page, value, name);
    this.list = listOf(this.words, value.names.map((each) => [each, each.replaceAll("_", " ")]), (given) => this.set(given));
    this.row.append(this.list);
    this.take(value);
  }

  draw() { this.list.value = this.value.value; }
}

class SwitchValue extends Field {
  constructor(page, value, name) {
    super(page, value, name);
    this.box = make("input", { type: "checkbox", ariaLabel: this.words, onchange: () => this.set(this.box.checked) });
    this.row.append(this.box);
    this.take(value);
  }

  draw() { this.box.checked = this.value.value; }
}

class FormulaValue extends Field {
  constructor(page, value, name) {
    super(page, value, name);
    const texts = Array.isArray(value.curve.formula) ? value.curve.formula : [value.curve.formula];
    this.inputs = texts.map((_, i) => {
      const label = `${this.words}, formula${texts.length > 1 ? ` ${"xyz"[i]}` : ""}`;
      const input = make("input", { type: "text", className: "formula", spellcheck: false, autocomplete: "off", ariaLabel: label });
      input.addEventListener("change", () => {
        const where = [...this.value.where, "formula", ...(texts.length > 1 ? [i] : [])];
        this.page.shot.edit([{ kind: "set", where, value: input.value }]);
      });
      return input;
    });
    this.row.append(make("span", "wide", ...this.inputs));
    this.take(value);
  }

  draw() {
    const { formula } = this.value.curve;
    this.inputs.forEach((input, i) => showValue(input, Array.isArray(formula) ? formula[i] : formula));
  }
}

/** The field of a value. */
function fieldOf(page, value, name) {
  if (value.curve && value.curve.formula !== null) return new FormulaValue(page, value, name);
  if (value.form === "axis") return typeof value.value === "string" ? new NameValue(page, value, name) : new VectorValue(page, value, name);
  if (value.form === "name") return new NameValue(page, value, name);
  if (value.form === "switch") return new SwitchValue(page, value, name);
  return value.is_vector ? new VectorValue(page, value, name) : new NumberValue(page, value, name);
}
