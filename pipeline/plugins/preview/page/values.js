// The panel: a group for each flow and each entry of the shot, a field for each value.

const PARTS = { flows: "Flow", subject: "Subject", resample: "Resampling", camera: "Camera", shutter: "Shutter", look: "Look", lights: "Lights", stage: "Stage", smooth: "Smoothing", speed: "Speed" };
const WRAPPERS = { sum: "sum", within: "within", blend: "blend", placed: "placed", mirrored: "mirrored", repeated: "repeated", reversed: "reversed", sequence: "sequence" };

/** The place in a path of the list of flows, of the shot or of one of its subjects; -1 for other values. */
function flowsAt(where) { return where[0] === "flows" ? 0 : where[0] === "subjects" && where[2] === "flows" ? 2 : -1; }

/** The path of the group that a value is in: its flow, its subject or the entry of the shot. */
function groupOf(where) {
  const start = flowsAt(where);
  if (start < 0) return where.slice(0, where[0] === "subjects" ? 2 : 1);
  let end = start + 2;
  for (let i = start + 1; i < where.length - 1; i++) if (typeof where[i] === "number" && typeof where[i + 1] === "string" && where[i - 1] !== "keys") end = i + 2;
  return where.slice(0, Math.min(end, where.length - 1));
}

/** A group in words: Flow 1: vortex in sum. */
function titleOf(group) {
  const start = flowsAt(group);
  if (start < 0) return group[0] === "subjects" ? [group[1].replaceAll("_", " "), "subject"] : [PARTS[group[0]], ""];
  const around = group.slice(start + 2, -1).filter((part) => part in WRAPPERS), numbers = group.filter((part) => typeof part === "number");
  const words = [`flow ${numbers.join(".")}`, ...(start ? [`of ${group[1]}`] : []), ...(around.length ? [`in ${around.join(", ")}`] : [])];
  return [String(group.at(-1)).replaceAll("_", " "), words.join(", ")];
}

class Values {
  constructor(page, panel) {
    Object.assign(this, { page, panel, fields: [], shape: "" });
  }

  /** Show a new state: fields stay where their values do, and with them the focus. */
  take(values) {
    const shape = JSON.stringify(values.map((value) => [value.where, value.form, value.names.length, value.is_vector, Boolean(value.curve), typeof value.value === "string", value.curve?.formula == null]));
    if (shape === this.shape) {
      this.fields.forEach((field, i) => field.take(values[i]));
      return;
    }
    const focused = document.activeElement?.closest?.(".field")?.dataset.path;
    const closed = new Set([...this.panel.querySelectorAll("details:not([open])")].map((part) => part.dataset.group));
    const known = new Set([...this.panel.querySelectorAll("details")].map((part) => part.dataset.group));
    this.shape = shape;
    this.fields = [];
    this.panel.replaceChildren();
    const groups = new Map();
    for (const value of values) {
      const group = groupOf(value.where), key = nameOf(group);
      if (!groups.has(key)) groups.set(key, this.#group(group, known.has(key) ? !closed.has(key) : group[0] === "camera" || flowsAt(group) >= 0));
      const rest = value.where.slice(group.length).map((part) => String(part).replaceAll("_", " "));
      const field = fieldOf(this.page, value, rest.join(" › ") || PARTS[group[0]].toLowerCase());
      this.fields.push(field);
      groups.get(key).append(field.row);
    }
    if (focused) this.panel.querySelector(`[data-path="${CSS.escape(focused)}"]`)?.querySelector("input, select, button")?.focus();
  }

  /** Another frame: what has keys has another value. */
  drawFrame() {
    for (const field of this.fields) if (field.value.curve) field.draw();
  }

  #group(group, isOpen) {
    const part = this.panel.appendChild(make("details", { open: isOpen })), [title, note] = titleOf(group);
    part.dataset.group = nameOf(group);
    const words = make("summary", { textContent: `${title[0].toUpperCase()}${title.slice(1)} ` });
    if (note) words.append(make("small", { textContent: note }));
    part.append(words);
    return part;
  }
}
