"use strict";
// Buttons, lists and fields: each does what a key does, and shows how things are.

const MODE_NAMES = {
  a: ["A", "A alone (1)"], b: ["B", "B alone (2)"], wipe: ["Wipe", "A left of an edge, B right of it (W)"],
  difference: ["Difference", "How far A and B are apart (D)"], side: ["Side by side", "A left, B right (S)"],
  grid: ["Grid", "All at once (G)"],
};
const SIZE_NAMES = { fit: ["Fit", "As large as fits (F)"], one: ["1:1", "A pixel for a pixel (Z)"] };
const TABS = { notes: ["Notes", "Q"], measures: ["Measures", "P"], levels: ["Levels", "Shift Z"], facts: ["Frame", "N"], shot: ["Shot", "Shift D"], mesh: ["Mesh", "M"] };
const id = (name) => document.getElementById(name);

class Controls {
  constructor(review) {
    this.review = review;
    this.#lists();
    this.#segments("modes", MODE_NAMES, (mode) => review.setMode(mode));
    this.#segments("sizes", SIZE_NAMES, (size) => review.setSize(size));
    this.#playback();
    this.#tabs();
    id("swap").append(icon("swap"));
    id("swap").addEventListener("click", () => review.swap());
    id("viewing-button").addEventListener("click", () => review.viewing.toggle());
    id("help-button").addEventListener("click", () => review.help());
    id("skip").addEventListener("click", () => review.toggleSkipped());
    const isAlone = review.sequences.length === 1;
    for (const part of ["swap", "label-b", "modes"]) id(part).hidden = isAlone;
    id("panel-button").addEventListener("click", () => review.togglePanel());
    id("frame").addEventListener("change", (event) => this.#frameTyped(event.target));
    document.addEventListener("click", (event) => {  // so that the next Space plays
      if (event.detail > 0) event.target.closest("button, select")?.blur();
    });
  }

  #lists() {
    const { review } = this;
    for (const side of ["a", "b"]) {
      const list = id(`choose-${side}`);
      for (const [title, sequences] of grouped(review)) {
        const group = list.appendChild(Object.assign(document.createElement("optgroup"), { label: title }));
        for (const each of sequences) group.append(new Option(each.name(review.isAlone), each.index));
      }
      list.addEventListener("change", () => review.choose(side, review.sequences[list.value]));
    }
    for (const gain of GAINS) id("gain").append(new Option(`×${gain}`, gain));
    id("gain").addEventListener("change", (event) => review.setGain(+event.target.value));
    for (const speed of SPEEDS) id("speed").append(new Option(`${speed}×`, speed));
    id("speed").addEventListener("change", (event) => review.transport.setSpeed(+event.target.value));
    id("wipe").addEventListener("input", (event) => review.setWipe(event.target.value / 100));
  }

  #segments(place, names, choose) {
    const group = id(place);
    group.setAttribute("role", "group");
    for (const [name, [words, title]] of Object.entries(names)) {
      if (name === "grid" && !this.review.hasGrid) continue;
      const button = group.appendChild(toggle(words, title, () => choose(name)));
      button.dataset.name = name;
    }
  }

  #playback() {
    const { review } = this, { transport } = review;
    const make = (name, title, click) => {
      const button = Object.assign(document.createElement("button"), { type: "button", className: "icon", title });
      button.setAttribute("aria-label", title);
      button.append(icon(name));
      button.addEventListener("click", click);
      return id("buttons").appendChild(button);
    };
    make("first", "First frame (Home)", () => { transport.pause(); transport.go(transport.first); });
    make("back", "Back a frame (←)", () => transport.step(-1));
    this.playButton = make("play", "Play (Space)", () => transport.toggle());
    make("ahead", "On a frame (→)", () => transport.step(1));
    make("last", "Last frame (End)", () => { transport.pause(); transport.go(transport.last); });
    make("loopIn", "Loop from here ([)", () => transport.setIn());
    make("loopOut", "Loop to here (])", () => transport.setOut());
    make("loopReset", "Loop over all (\\)", () => transport.resetRange());
  }

  #tabs() {
    for (const [name, [words, key]] of Object.entries(TABS)) {
      const tab = toggle(words, `${words} (${key})`, () => this.review.showTab(name));
      tab.id = `tab-${name}`;
      tab.setAttribute("role", "tab");
      tab.setAttribute("aria-controls", `panel-${name}`);
      tab.addEventListener("keydown", (event) => {
        const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (!way) return;
        event.stopPropagation();
        const names = Object.keys(TABS), next = names.at((names.indexOf(name) + way) % names.length);
        this.review.showTab(next);
        id(`tab-${next}`).focus();
      });
      id("tabs").append(tab);
    }
  }

  #frameTyped(field) {
    const frame = Number.parseInt(field.value, 10);
    if (Number.isFinite(frame)) this.review.seek(frame);
    field.value = this.review.transport.frame;
    field.blur();
  }

  /** Show how things are. */
  draw() {
    const { review } = this, { transport, stage, a, b, mode } = review;
    id("choose-a").value = a.index;
    id("choose-b").value = b.index;
    this.#press("modes", mode);
    this.#press("sizes", stage.zoom === null ? "fit" : stage.zoom === 1 ? "one" : "");
    id("gain-label").hidden = mode !== "difference";
    id("gain").value = stage.gain;
    id("wipe-label").hidden = mode !== "wipe";
    id("wipe").value = Math.round(100 * stage.wipe);
    id("speed").value = transport.speed;
    id("panel-button").setAttribute("aria-pressed", !id("panel").hidden);
    id("splitter").hidden = id("panel").hidden;
    this.drawFrame();
    review.drawing.draw();
    review.viewing.draw();
    const { inPoint, outPoint } = transport;
    id("about").textContent = a.note || a.about.title;
    id("range").textContent = transport.isLooped ? `Loop ${inPoint}–${outPoint}` : `${transport.first}–${transport.last}`;
    id("skip").hidden = a.there.length === a.numbers.length;
    id("skip").setAttribute("aria-pressed", review.skips);
    this.playButton.replaceChildren(icon(transport.playing ? "pause" : "play"));
    this.playButton.setAttribute("aria-label", transport.playing ? "Pause (Space)" : "Play (Space)");
    for (const name of Object.keys(TABS)) {
      const isShown = review.tab === name;
      id(`tab-${name}`).setAttribute("aria-selected", isShown);
      id(`tab-${name}`).removeAttribute("aria-pressed");
      id(`tab-${name}`).tabIndex = isShown ? 0 : -1;
      id(`panel-${name}`).hidden = !isShown;
    }
    const both = ["wipe", "side"].includes(mode), only = mode === "b" ? b : a;
    id("tag-a").textContent = mode === "grid" ? "" : both ? a.name(review.isAlone) : mode === "difference" ? `${a.name(review.isAlone)} − ${b.name(review.isAlone)}` : only.name(review.isAlone);
    id("tag-b").textContent = both ? b.name(review.isAlone) : "";
  }

  /** What changes with every frame. */
  drawFrame() {
    const { transport, a, b, mode } = this.review, { frame } = transport;
    if (document.activeElement !== id("frame")) id("frame").value = frame;
    id("timecode").textContent = a.timecode(frame);
    const [state, why] = (mode === "b" ? b : a).state(frame);
    id("state").textContent = state === "done" ? "" : state;
    id("state").title = why;
    id("state").dataset.state = state;
    const asked = +(transport.fps * transport.speed).toFixed(2);
    id("rate").textContent = transport.playing && transport.measured ? `${transport.measured.toFixed(1)} / ${asked} fps` : `${asked} fps`;
    id("rate").classList.toggle("slow", transport.playing && transport.measured > 0 && transport.measured < 0.93 * asked);
  }

  #press(place, name) {
    for (const button of id(place).children) button.setAttribute("aria-pressed", button.dataset.name === name);
  }
}

/** The sequences in groups: by shot where there are several, and by what they are. */
function grouped(review) {
  const words = { render: "Renders", relit: "Relit", version: "Versions", wedge: "Wedges" }, groups = new Map();
  for (const each of review.sequences) {
    const title = review.isAlone ? words[each.kind] : `${each.shot}: ${words[each.kind].toLowerCase()}`;
    groups.set(title, [...(groups.get(title) ?? []), each]);
  }
  return groups;
}
