// Buttons, lists and fields: each does what a key does, and shows how things are.

const MODE_NAMES = {
  a: ["A", "A alone (1)"], b: ["B", "B alone (2)"], wipe: ["Wipe", "A left of an edge, B right of it (W)"],
  difference: ["Difference", "How far A and B are apart (D)"], side: ["Side by side", "A left, B right (S)"],
  grid: ["Grid", "All at once (G)"],
};
const SIZE_NAMES = { fit: ["Fit", "As large as fits (F)"], one: ["1:1", "A pixel for a pixel (Z)"] };
const TABS = { notes: ["Notes", "Q"], measures: ["Measures", "P"], levels: ["Levels", "Shift Z"], facts: ["Frame", "N"], shot: ["Shot", "Shift D"], mesh: ["Mesh", "M"] };
const KIND_NAMES = { render: "Renders", relit: "Relit", version: "Versions", wedge: "Wedges" };

class Controls {
  constructor(review) {
    Object.assign(this, { review, playback: new Playback(review.transport, id("buttons"), id("frame")) });
    this.#lists();
    this.modes = this.#choices("modes", "How A and B are shown", MODE_NAMES, (mode) => review.setMode(mode));
    this.sizes = this.#choices("sizes", "Size of the picture", SIZE_NAMES, (size) => review.setSize(size));
    if (!review.hasGrid) this.modes.get("grid").remove();
    this.tabs = new Map(Object.entries(TABS).map(([name, about]) => [name, this.#tab(name, ...about)]));
    id("viewing-button").onclick = () => review.viewing.toggle();
    id("panel-button").onclick = () => review.togglePanel();
    id("skip").onclick = () => review.toggleSkipped();
    const isAlone = review.sequences.length === 1;
    for (const part of [this.swap, this.lists.b.parentElement, id("modes")]) part.hidden = isAlone;
  }

  #lists() {
    const { review } = this, sequences = { a: [], b: [] };
    for (const side of ["a", "b"]) {
      const act = (index) => review.choose(side, review.sequences[index]);
      sequences[side] = make("select", { id: `choose-${side}`, ariaLabel: `Sequence ${side.toUpperCase()}`, onchange: (event) => act(event.target.value) });
      for (const [label, group] of grouped(review)) {
        sequences[side].append(make("optgroup", { label }, ...group.map((each) => new Option(each.name(review.isAlone), each.index))));
      }
    }
    this.lists = sequences;
    this.swap = iconButton("swap", "Swap A and B (X)", () => review.swap());
    const labels = Object.entries(sequences).map(([side, list]) => make("label", "inline", make("b", {}, side.toUpperCase()), list));
    id("choose").append(labels[0], this.swap, labels[1]);
    id("gain").append(...GAINS.map((gain) => new Option(`×${gain}`, gain)));
    id("gain").onchange = () => review.setGain(+id("gain").value);
    id("wipe").oninput = () => review.setWipe(id("wipe").value / 100);
  }

  /** Buttons of which one is pressed, by their names. */
  #choices(place, label, names, choose) {
    const buttons = new Map(Object.entries(names).map(([name, about]) => [name, buttonOf(...about, () => choose(name))]));
    id(place).append(segments(label, [...buttons.values()]));
    return buttons;
  }

  #tab(name, words, key) {
    const panel = make("div", { className: "tab inset", role: "tabpanel", id: `panel-${name}`, tabIndex: 0 });
    const tab = buttonOf(words, `${words} (${key})`, () => this.review.showTab(name), { id: `tab-${name}`, role: "tab" });
    tab.setAttribute("aria-controls", panel.id);
    panel.setAttribute("aria-labelledby", tab.id);
    arrowKeys(tab, (right) => {
      const names = Object.keys(TABS), next = names.at((names.indexOf(name) + right) % names.length);
      this.review.showTab(next);
      this.tabs.get(next).focus();
    });
    id("tabs").append(tab);
    id("panel").append(panel);
    return tab;
  }

  /** Show how things are. */
  draw() {
    const { review } = this, { stage, a, b, mode } = review;
    this.lists.a.value = a.index;
    this.lists.b.value = b.index;
    const size = stage.zoom === null ? "fit" : stage.zoom === 1 ? "one" : "";
    for (const [name, button] of this.modes) button.ariaPressed = name === mode;
    for (const [name, button] of this.sizes) button.ariaPressed = name === size;
    id("gain-label").hidden = mode !== "difference";
    id("gain").value = stage.gain;
    id("wipe-label").hidden = mode !== "wipe";
    id("wipe").value = Math.round(100 * stage.wipe);
    id("panel-button").ariaPressed = !id("panel").hidden;
    id("splitter").hidden = id("panel").hidden;
    this.playback.draw();
    this.drawFrame();
    review.drawing.draw();
    review.viewing.draw();
    id("about").textContent = a.note || a.about.title;
    Object.assign(id("skip"), { hidden: a.there.length === a.numbers.length, ariaPressed: review.skips });
    for (const [name, tab] of this.tabs) {
      const isShown = review.tab === name;
      Object.assign(tab, { ariaSelected: isShown, tabIndex: isShown ? 0 : -1 });
      id(`panel-${name}`).hidden = !isShown;
    }
    const [left, right] = this.#tags(mode, a.name(review.isAlone), b.name(review.isAlone));
    id("tag-a").textContent = left;
    id("tag-b").textContent = right;
  }

  /** The names over the picture, left and right. */
  #tags(mode, a, b) {
    if (mode === "grid") return ["", ""];
    if (mode === "difference") return [`${a} − ${b}`, ""];
    return mode === "wipe" || mode === "side" ? [a, b] : [mode === "b" ? b : a, ""];
  }

  /** What changes with every frame. */
  drawFrame() {
    const { transport, a, shownSequence } = this.review, { frame, playing, measured } = transport;
    this.playback.drawFrame();
    id("timecode").textContent = a.timecode(frame);
    const [state, why] = shownSequence.state(frame);
    Object.assign(id("state"), { textContent: state === "done" ? "" : state, title: why });
    id("state").dataset.state = state;
    const asked = +(transport.fps * transport.speed).toFixed(2);
    id("rate").textContent = playing && measured ? `${measured.toFixed(1)} / ${asked} fps` : `${asked} fps`;
    id("rate").classList.toggle("slow", playing && measured > 0 && measured < 0.93 * asked);
  }
}

/** The sequences in groups: by shot where there are several, and by what they are. */
function grouped(review) {
  const groups = new Map();
  for (const each of review.sequences) {
    const title = review.isAlone ? KIND_NAMES[each.kind] : `${each.shot}: ${KIND_NAMES[each.kind].toLowerCase()}`;
    groups.set(title, [...(groups.get(title) ?? []), each]);
  }
  return groups;
}
