// The panel: a group for each flow and each entry of the shot, a row for each value. What a row sets goes through the
// shot's edits, at the current frame where the value has keys.

class Values {
  constructor(page, panel) { Object.assign(this, { page, panel, fields: [], shape: "" }); }

  /** Show a new state: fields stay where their values do, and with them the focus. */
  take(values) {
    const shape = JSON.stringify(values.map((value) => [value.where, value.form, value.names.length, value.is_vector, Boolean(value.curve), typeof value.value === "string", value.curve?.formula == null]));
    if (shape === this.shape) {
      this.fields.forEach((field, i) => { field.value = values[i]; });
      return;
    }
    const focused = document.activeElement?.closest?.(".field")?.dataset.path;
    const wasOpen = new Map([...this.panel.querySelectorAll("details")].map((part) => [part.dataset.group, part.open]));
    this.shape = shape;
    this.fields = values.map((value) => fieldOf(this.page, value));
    const groups = Map.groupBy(this.fields, ({ value }) => value.group);
    this.panel.replaceChildren(this.page.perform.element, ...[...groups].map(([group, fields]) => detailsOf(fields, wasOpen.get(group))));
    if (focused) this.panel.querySelector(`[data-path="${CSS.escape(focused)}"]`)?.querySelector("input, select, button")?.focus();
  }
}

/** A group of fields; those of the camera and of flows are open at first. */
function detailsOf(fields, wasOpen) {
  const { group, title, note, is_flow: isFlow } = fields[0].value, open = wasOpen ?? (isFlow || group === "camera");
  const words = make("summary", {}, make("b", {}, title), " ", make("small", {}, note));
  return make("details", { open, data: { group } }, words, ...fields.map(({ row }) => row));
}

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

/** A number as a field shows it. */
function written(number) { return String(+Number(number).toPrecision(6)); }

/** The row of a value: its name, and elements that show what the value is and set it. */
class Field {
  constructor(page, value) {
    const { name, unit } = value;
    Object.assign(this, { page, value, name, gestures: 0, words: `${name}${unit ? `, ${unit}` : ""}` });
    const className = () => `field${this.value.is_given ? " given" : ""}`;
    this.row = make("div", { className, title: () => this.#title, data: { path: nameOf(value.where) } }, make("span", "about name", name));
  }

  get #title() {
    const { file, where, description, unit } = this.value;
    const from = file ? ` From ${file.split("/").at(-1)}; an edit is written into this shot.` : "";
    return `${nameOf(where)}: ${description}${unit ? ` (${unit})` : ""}.${from}`;
  }

  get frame() { return this.page.shot.frameOf(this.value.where, this.page.film.at); }
  get now() { return this.page.shot.at(this.value, this.frame); }
  get keyHere() { return this.value.curve?.keys.find((key) => Math.abs(key.frame - this.frame) < 1e-6); }

  changes(given) { return this.page.shot.change(this.value, given, this.frame); }
  set(given, gesture = "") { return this.page.follow.end(this.changes(given), gesture); }

  /** The button that turns a constant into keys, and sets or removes the key of the current frame. */
  addKeyButton() {
    if (!this.value.can_change && !this.value.curve) return;
    const isKeyed = () => Boolean(this.value.curve?.keys.length);
    const words = () => (!this.value.curve ? "Give it keys, the first at this frame" : this.keyHere ? "Remove the key of this frame" : "Set a key at this frame");
    this.row.append(buttonOf("", words, () => this.toggleKey(), {
      className: () => `key plain${isKeyed() ? " keyed" : ""}`, textContent: () => (isKeyed() && !this.keyHere ? "◇" : "◆"),
      ariaLabel: () => `${this.name}: ${words()}`, ariaPressed: () => Boolean(this.keyHere),
    }));
    const { perform } = this.page, { where } = this.value, isArmed = () => perform.isArmed(where);
    this.row.append(buttonOf("●", "Arm it: R records what moves it", () => perform.arm(where), {
      className: () => `key plain${isArmed() ? " armed" : ""}`, ariaLabel: `${this.name}: arm`, ariaPressed: isArmed,
    }));
  }

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

  /** A field for a number: Enter sets, arrows step, Escape gives up. */
  numberInput(ariaLabel, get, set, step, shown = () => written(get())) {
    const input = make("input", { type: "text", inputMode: "decimal", autocomplete: "off", ariaLabel, value: shown });
    input.addEventListener("focus", () => { this.gestures += 1; input.select(); });
    input.addEventListener("blur", () => refresh(this.row));
    input.addEventListener("change", () => {
      const typed = input.value.trim(), number = Number(typed.replace(",", ".").replace("−", "-"));
      if (typed && Number.isFinite(number)) set(number, "");
      else if (typed) this.page.refused(`${this.name}: ${typed.slice(0, 40)} is no number. Write one, such as 0.5.`);
      input.value = written(get());
    });
    input.addEventListener("keydown", (event) => {
      const way = { ArrowUp: 1, ArrowDown: -1 }[event.key];
      if (event.key === "Escape") input.value = written(get());
      if (event.key === "Escape" || event.key === "Enter") input.blur();
      if (!way) return;
      event.preventDefault();
      const each = step() * (event.shiftKey ? 10 : 1), next = rounded(get() + way * each, each);
      input.value = written(next);
      set(next, `${nameOf(this.value.where)} ${this.gestures}`);
    });
    return input;
  }
}

class NumberValue extends Field {
  constructor(...about) {
    super(...about);
    [this.low, this.high] = rangeOf(this.value, Number(this.now));
    this.slider = sliderOf(this.words, 0, 0, 0, () => this.#slide(), {
      min: () => this.#bounds[0], max: () => this.#bounds[1], step: () => this.step, value: () => this.number,
      onchange: () => this.set(this.#slid).then(() => { this.slides = false; refresh(this.row); }),
    });
    this.slider.addEventListener("pointerdown", () => this.page.follow.prepare(this.value.where));
    const isBetween = () => this.value.curve && !this.keyHere; // keys: as many digits as one can tell apart
    const shown = () => (isBetween() && !this.slides ? String(+this.number.toPrecision(4)) : written(this.number));
    const set = (to, gesture) => this.set(this.#fit(to), gesture);
    this.row.append(this.slider, this.numberInput(`${this.words}, number`, () => this.now, set, () => this.step, shown));
    this.addKeyButton();
  }

  get step() { return this.value.form === "whole" ? 1 : stepOf(this.high - this.low); }
  get number() { return this.slides ? this.#slid : Number(this.now); }
  get #slid() { return this.#fit(rounded(Number(this.slider.value), this.step)); }
  #fit(number) { return this.value.form === "whole" ? Math.round(number) : number; }

  /** The ends of the slider, as wide as the value was at any time; above 0 where 0 is none of its values. */
  get #bounds() {
    const number = Number(this.now), { low, form } = this.value;
    [this.low, this.high] = [Math.min(this.low, number), Math.max(this.high, number)];
    return [low === 0 && this.low === 0 && this.step < number && form !== "whole" ? this.step : this.low, this.high];
  }

  #slide() {
    this.slides = true;
    refresh(this.row);
    this.page.follow.show(this.changes(this.#slid));
  }
}

/** What shows and sets a value in its row, by the kind of its field; a number has a class. */
const CONTROLS = {
  vector: (field) => {
    const inputs = ["x", "y", "z"].map((axis, i) => {
      const moved = (to) => field.now.map((old, k) => (k === i ? to : rounded(old, 1e-4)));
      const set = (to, gesture) => field.set(moved(to), gesture);
      return field.numberInput(`${field.words}, ${axis}`, () => field.now[i], set, () => 0.05);
    });
    return make("span", "wide", ...inputs);
  },
  name: (field) => {
    const names = field.value.names.map((each) => [each, each.replaceAll("_", " ")]);
    return listOf(field.words, names, (given) => field.set(given), { value: () => field.value.value });
  },
  switch: (field) => {
    const onchange = (event) => field.set(event.target.checked), checked = () => field.value.value;
    return make("input", { type: "checkbox", ariaLabel: field.words, onchange, checked });
  },
  formula: (field) => {
    const texts = () => [field.value.curve.formula].flat(), isOne = texts().length === 1;
    const inputs = texts().map((_, i) => {
      const where = [...field.value.where, "formula", ...(isOne ? [] : [i])];
      const onchange = (event) => field.page.shot.edit([{ kind: "set", where, value: event.target.value }]);
      const ariaLabel = `${field.words}, formula${isOne ? "" : ` ${"xyz"[i]}`}`, value = () => texts()[i];
      const about = { type: "text", className: "formula", spellcheck: false, autocomplete: "off" };
      return make("input", { ...about, ariaLabel, onchange, value });
    });
    return make("span", "wide", ...inputs);
  },
};

function kindOf({ form, value, curve, is_vector: isVector }) {
  if (curve && curve.formula !== null) return "formula";
  if (form === "axis") return typeof value === "string" ? "name" : "vector";
  return isVector ? "vector" : form;
}

/** The field of a value. */
function fieldOf(page, value) {
  const kind = kindOf(value);
  if (!CONTROLS[kind]) return new NumberValue(page, value);
  const field = new Field(page, value);
  field.row.append(CONTROLS[kind](field));
  if (kind === "vector") field.addKeyButton();
  return field;
}
