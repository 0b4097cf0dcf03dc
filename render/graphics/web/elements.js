// Elements of the document, their icons, and words that are told for a while.

const id = (name) => document.getElementById(name);
const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
/** The value after another in a list, or so many on; the first follows the last, and what is not there. */
const nextOf = (list, value, steps = 1) => list.at((list.indexOf(value) + steps) % list.length);

/**
 * Give an element properties; ARIA names are properties too: `role`, `ariaLabel`, `ariaPressed`. `data` becomes
 * data attributes. What is a function, but no handler, is asked at each `refresh`.
 */
function give(element, { data, ...about }) {
  Object.assign(element.dataset, data);
  for (const [name, value] of Object.entries(about)) {
    if (typeof value !== "function" || name.startsWith("on")) element[name] = value;
    else element.live = { ...element.live, [name]: value };
  }
  if (element.live) element.dataset.live = "";
  return element;
}

/** Show how things are on every element that was given functions. A field in which somebody types keeps its text. */
function refresh(within = document) {
  for (const element of within.querySelectorAll("[data-live]")) {
    const isTyped = element === document.activeElement && isField(element);
    for (const [name, value] of Object.entries(element.live)) {
      const now = value();
      if (String(now) !== String(element[name]) && !(isTyped && name === "value")) element[name] = now;
    }
  }
}

/** Whether an element is typed in. */
const isField = (element) => element.matches("textarea, input:not([type=range], [type=checkbox])");

/** An element with a class, or with these properties, and its children. */
function make(tag, about = {}, ...inner) {
  const element = give(document.createElement(tag), typeof about === "string" ? { className: about } : about);
  element.append(...inner);
  return element;
}

/** The same of SVG, which has attributes instead of properties. */
function svg(name, { data, ...attributes } = {}, ...inner) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  Object.assign(element.dataset, data);
  setAttributes(element, attributes);
  element.append(...inner);
  return element;
}

function setAttributes(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
}

/** A button with words or an icon that does what a key does too; its title names the key. */
function buttonOf(words, title, onclick, more = {}) {
  return make("button", { type: "button", title, onclick, ...more }, words);
}

function iconButton(name, title, onclick, more = {}) {
  return buttonOf(icon(name), title, onclick, { className: "icon plain", ariaLabel: title, ...more });
}

/** Buttons side by side, of which one is pressed: [value, words, title] each. `value()` is the one that is chosen. */
function choiceOf(label, options, value, choose) {
  const buttons = options.map(([each, words, title]) => (
    buttonOf(words, title, () => choose(each), { ariaPressed: () => value() === each })
  ));
  return make("div", { className: "segments", role: "group", ariaLabel: label }, ...buttons);
}

/** A list to choose from, of [value, words]. */
function listOf(label, options, act, more = {}) {
  const list = make("select", {}, ...options.map(([value, words]) => new Option(words, value)));
  return give(list, { ariaLabel: label, onchange: () => act(list.value), ...more });
}

/** A slider that acts while it is moved. */
function sliderOf(label, low, high, step, act, more = {}) {
  return make("input", { type: "range", min: low, max: high, step, ariaLabel: label, oninput: (event) => act(+event.target.value), ...more });
}

/** Draw the inside of an element anew; what has the focus there, by its `data-focus`, keeps it. */
function redrawn(holder, draw) {
  const { focus } = holder.contains(document.activeElement) ? document.activeElement.dataset : {};
  draw();
  if (focus) holder.querySelector(`[data-focus="${CSS.escape(focus)}"]`)?.focus();
}

/** Draw again whenever the size of an element changes. */
function whenResized(element, draw) { new ResizeObserver(draw).observe(element); }

/** Where a pointer is over an element, as shares of its width and height. */
function shareOf(element, event) {
  const { left, top, width, height } = element.getBoundingClientRect();
  return { x: (event.clientX - left) / width, y: (event.clientY - top) / height };
}

/** Which of so many columns of an element a pointer is over. */
function columnAt(element, event, count) {
  return clamp(Math.floor(shareOf(element, event).x * count), 0, count - 1);
}

/** Tell something in the element `message`; a fault longer, and in red. */
function tell(words, isFault = false) {
  const place = id("message");
  place.textContent = words;
  place.classList.toggle("fault", isFault);
  clearTimeout(tell.timer);
  tell.timer = setTimeout(() => { place.textContent = ""; }, isFault ? 15000 : 6000);
}

/** Icons are drawn in lines of a 16 × 16 square, in the ink of the words around them. */

const ICONS = {
  first: "M3.5 3v10M13 3.5 6.5 8l6.5 4.5z",
  back: "M11.5 3.5 5 8l6.5 4.5z",
  play: "M5 3v10l8-5z",
  pause: "M5 3.5v9M11 3.5v9",
  ahead: "M4.5 3.5 11 8l-6.5 4.5z",
  last: "M12.5 3v10M3 3.5 9.500 8 3 12.5z",
  swap: "M4 5.500h9M10.500 3 13 5.500 10.500 8M12 10.500H3M5.500 8 3 10.500 5.500 13",
  loopIn: "M9.500 3h-4v10h4",
  loopOut: "M6.500 3h4v10h-4",
  loopReset: "M3.500 4.500v7M12.500 4.500v7M6 6l4 4M10 6l-4 4",
  pen: "M3 13l.8-3.200L10.700 3.300a1.200 1.200 0 0 1 1.700 0l.3.3a1.200 1.200 0 0 1 0 1.700L5.800 12.200z",
  arrow: "M3 13 12.500 3.500M6.500 3.500h6v6",
  rectangle: "M2.500 4h11v8h-11z",
  text: "M3.500 4.500v-1h9v1M8 3.500v9M6.500 12.500h3",
  dot: "M8 3.500a4.500 4.500 0 1 0 0 9 4.500 4.500 0 0 0 0-9z",
  thinner: "M3.500 8h9",
  thicker: "M3.500 8h9M8 3.500v9",
  undo: "M6 3.500 3 6.500l3 3M3.500 6.500h6a3 3 0 0 1 0 6h-3",
  redo: "M10 3.500l3 3-3 3M12.500 6.500h-6a3 3 0 0 0 0 6h3",
  erase: "M3 4.500h10M6.500 4.500v-2h3v2M4.500 4.500l.7 9h5.600l.7-9",
  onion: "M2.500 2.500h7v7h-7zM6.500 6.500h7v7h-7z",
  close: "M4 4l8 8M12 4l-8 8",
};

function icon(name) { return svg("svg", { viewBox: "0 0 16 16", "aria-hidden": true }, svg("path", { d: ICONS[name] })); }
