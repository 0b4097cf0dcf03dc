// Elements of the document. ARIA names are properties too: `role`, `ariaLabel`, `ariaPressed`.

const id = (name) => document.getElementById(name);
const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

/** An element with a class, or with these properties, and its children. */
function make(tag, about = {}, ...inner) {
  const element = Object.assign(document.createElement(tag), typeof about === "string" ? { className: about } : about);
  element.append(...inner);
  return element;
}

/** The same of SVG, which has attributes instead of properties. */
function svg(name, attributes = {}, ...inner) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...inner);
  return element;
}

/** A button that does what a key does too; its title names the key. */
function buttonOf(words, title, act, more = {}) {
  return make("button", { type: "button", textContent: words, title, onclick: act, ...more });
}

function iconButton(name, title, act) {
  const button = buttonOf("", title, act, { className: "icon", ariaLabel: title });
  button.append(icon(name));
  return button;
}

/** Buttons side by side, of which one or some are pressed. */
function segments(label, buttons) {
  return make("div", { className: "segments", role: "group", ariaLabel: label }, ...buttons);
}

/** A list to choose from, of [value, words]. */
function listOf(label, options, act) {
  const list = make("select", { ariaLabel: label, onchange: () => act(list.value) });
  list.append(...options.map(([value, words]) => new Option(words, value)));
  return list;
}

/** A slider that acts while it is moved. */
function sliderOf(label, low, high, step, act, more = {}) {
  return make("input", { type: "range", min: low, max: high, step, ariaLabel: label, oninput: (event) => act(+event.target.value), ...more });
}

/** Show a text in a field, unless somebody has typed there since the last one. */
function showValue(field, text) {
  if (document.activeElement === field && field.value !== (field.shownText ?? field.value)) return;
  field.value = field.shownText = text;
}

/** Draw again whenever the size of an element changes. */
function whenResized(element, draw) { new ResizeObserver(draw).observe(element); }

/** How many pixels of the display a pixel of the page has. */
const dotsOf = () => window.devicePixelRatio || 1;
