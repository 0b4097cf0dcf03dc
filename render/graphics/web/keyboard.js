// The keys of a page, and the help that lists them.

class Keyboard {
  /**
   * groups   [title, rows]; a row is [the keys as the help has them, what they do, {key: act}]
   * isReady  tells whether keys may act now
   *
   * A key is named as its event is, with `Shift+` or `Ctrl+` before it. A capital letter is one with Shift; where no
   * row has it, it counts as the small one, so that Caps Lock makes no difference.
   */
  constructor(groups, isReady = () => true) {
    Object.assign(this, { groups, isReady });
    const rows = groups.flatMap(([, each]) => each);
    this.acts = new Map([["?", () => this.help()], ...rows.flatMap(([, , acts = {}]) => Object.entries(acts))]);
    groups.at(-1)[1].push(["?", "These keys"]);
    this.dialog = document.body.appendChild(this.#dialog());
    const button = buttonOf("?", "Keys (?)", () => this.help(), { id: "help-button", className: "icon", ariaLabel: "Keys" });
    document.querySelector(".bar").append(button);
    document.addEventListener("keydown", (event) => this.#press(event));
    document.addEventListener("click", (event) => {
      if (event.detail > 0) event.target.closest("button, select")?.blur(); // so that the next Space plays
    });
  }

  #press(event) {
    if (event.altKey || event.defaultPrevented || this.dialog.open || !this.isReady() || isUsedBy(event.target, event.key)) return;
    const act = this.acts.get(this.#nameOf(event));
    if (!act) return;
    event.preventDefault();
    act(event);
  }

  #nameOf({ key, shiftKey, ctrlKey, metaKey }) {
    if (ctrlKey || metaKey) return `Ctrl+${shiftKey ? key : key.toLowerCase()}`;
    if (key.length > 1) return shiftKey ? `Shift+${key}` : key;
    return shiftKey && this.acts.has(key) ? key : key.toLowerCase();
  }

  #dialog() {
    const sections = this.groups.map(([title, rows]) => {
      const lines = rows.filter(([keys]) => keys).flatMap(([keys, words]) => [
        make("dt", {}, ...keys.split(" ").flatMap((key) => [make("kbd", {}, key), " "])), make("dd", {}, words),
      ]);
      return make("section", {}, make("h3", {}, title), make("dl", {}, ...lines));
    });
    const close = buttonOf("Close", "Close (Esc)", () => this.dialog.close(), { autofocus: true });
    return make("dialog", { id: "help", ariaLabel: "Keys" }, make("h2", {}, "Keys"), make("div", "columns", ...sections), close);
  }

  help() {
    this.dialog.showModal();
    this.dialog.scrollTop = 0; // where it is opened, the button that it begins with is at its end
  }
}

/** Tell whether an element itself does something with a key. */
function isUsedBy(element, key) {
  if (isField(element)) return true;
  if (element.matches("select, input[type=range]")) return /^(Arrow|Home|End|Page| $|Enter)/.test(key);
  return element.matches("a, button, summary, input[type=checkbox], [role=tab]") && [" ", "Enter"].includes(key);
}

/** Move an element that has the focus by arrow keys: `act(right, down, many)`, with Shift as many at once. */
function arrowKeys(element, act, { many = 10, isOn = () => true } = {}) {
  element.addEventListener("keydown", (event) => {
    const right = { ArrowLeft: -1, ArrowRight: 1 }[event.key] ?? 0, down = { ArrowUp: -1, ArrowDown: 1 }[event.key] ?? 0;
    if ((!right && !down) || !isOn()) return;
    event.preventDefault();
    event.stopPropagation();
    act(right, down, event.shiftKey ? many : 1);
  });
}
