// Buttons, lists and fields, each of which does what a key does and shows how things are; and the keys, by what they are for.

const MODE_NAMES = {
  a: ["A", "A alone (1)"], b: ["B", "B alone (2)"], wipe: ["Wipe", "A left of an edge, B right of it (W)"],
  difference: ["Difference", "How far A and B are apart (D)"], side: ["Side by side", "A left, B right (S)"],
  grid: ["Grid", "All at once (G)"],
};
const TABS = { notes: ["Notes", "Q"], measures: ["Measures", "P"], levels: ["Levels", "Shift Z"], facts: ["Frame", "N"], shot: ["Shot", "Shift D"], mesh: ["Mesh", "M"] };
const KIND_NAMES = { render: "Renders", relit: "Relit", version: "Versions", wedge: "Wedges" };

function buildControls(review) {
  const isAlone = review.sequences.length === 1, { stage } = review;
  const swap = iconButton("swap", "Swap A and B (X)", () => review.swap(), { className: "icon", hidden: isAlone });
  const [a, b] = ["a", "b"].map((side) => make("label", "inline", make("b", {}, side.toUpperCase()), sequenceList(review, side)));
  b.hidden = isAlone;
  id("choose").append(a, swap, b);
  buildModes(review, isAlone);
  const sizes = [[null, "Fit", "As large as fits (F)"], [1, "1:1", "A pixel for a pixel (Z)"]];
  id("sizes").append(
    choiceOf("Size of the picture", sizes, () => stage.zoom, (zoom) => review.setSize(zoom)),
    buttonOf("View", "Layers, exposure, channels, probe (Shift E)", () => review.viewing.toggle(), { ariaPressed: () => review.viewing.isOn }),
    buttonOf("Panel", "Show or hide the panel (H)", () => review.togglePanel(), { ariaPressed: () => !id("panel").hidden }),
  );
  give(id("splitter"), { hidden: () => id("panel").hidden });
  const names = () => review.shownSequences.map((each) => each.name(review.isAlone));
  const label = () => `Frame ${review.transport.frame}, ${names().join(" and ")}`;
  give(id("stage"), { hidden: () => review.mode === "grid", ariaLabel: label });
  give(id("edge"), { hidden: () => !stage.edge, className: () => `edge ${stage.mode}`, style: () => `left: ${stage.edge / devicePixelRatio}px` });
  give(id("grid"), { hidden: () => review.mode !== "grid" });
  for (const [name, about] of Object.entries(TABS)) addTab(review, name, ...about);
  const tags = () => (review.mode === "grid" ? [] : review.mode === "difference" ? [names().join(" − ")] : names());
  give(id("tag-a"), { textContent: () => tags()[0] ?? "" });
  give(id("tag-b"), { textContent: () => tags()[1] ?? "" });
  buildTime(review);
}

/** How A and B are shown, with the gain of their difference or the edge between them. */
function buildModes(review, isAlone) {
  const { stage } = review, isOther = (mode) => () => review.mode !== mode;
  const modes = Object.entries(MODE_NAMES).filter(([mode]) => mode !== "grid" || review.grid.isUseful);
  const gains = GAINS.map((gain) => [gain, `×${gain}`]);
  id("modes").hidden = isAlone;
  id("modes").append(
    choiceOf("How A and B are shown", modes.map(([mode, about]) => [mode, ...about]), () => review.mode, (mode) => review.setMode(mode)),
    make("label", { className: "inline", hidden: isOther("difference") }, "Gain",
      listOf("Gain of the difference", gains, (gain) => review.change(stage, { gain: +gain }), { id: "gain", value: () => stage.gain })),
    make("label", { className: "inline", hidden: isOther("wipe") }, "Wipe", sliderOf("Wipe position, per cent", 0, 100, 1,
      (share) => review.change(stage, { wipe: share / 100 }), { id: "wipe", value: () => Math.round(100 * stage.wipe) })),
  );
}

/** The list of sequences in groups: by shot where there are several, and by what they are. */
function sequenceList(review, side) {
  const groups = Map.groupBy(review.sequences, ({ shot, kind }) => (review.isAlone ? KIND_NAMES[kind] : `${shot}: ${KIND_NAMES[kind].toLowerCase()}`));
  const choose = (event) => review.choose(side, review.sequences[event.target.value]);
  const lists = [...groups].map(([label, group]) => make("optgroup", { label }, ...group.map((each) => new Option(each.name(review.isAlone), each.index))));
  const about = { id: `choose-${side}`, ariaLabel: `Sequence ${side.toUpperCase()}`, onchange: choose, value: () => review[side].index };
  return make("select", about, ...lists);
}

function addTab(review, name, words, key) {
  const isShown = () => review.tab === name, tabId = `tab-${name}`;
  const panel = make("div", { className: "tab inset", role: "tabpanel", id: `panel-${name}`, tabIndex: 0, hidden: () => !isShown() });
  const tab = buttonOf(words, `${words} (${key})`, () => review.showTab(name), {
    id: tabId, role: "tab", className: "plain", ariaSelected: isShown, tabIndex: () => (isShown() ? 0 : -1),
  });
  setAttributes(tab, { "aria-controls": panel.id });
  setAttributes(panel, { "aria-labelledby": tabId });
  arrowKeys(tab, (right) => {
    const next = nextOf(Object.keys(TABS), name, right);
    review.showTab(next);
    id(`tab-${next}`).focus();
  });
  id("tabs").append(tab);
  id("panel").append(panel);
}

/** The buttons and fields of time, and what is told beside them: timecode, state, and how fast it plays. */
function buildTime(review) {
  const { transport, playback } = review, state = () => review.shownSequence.state(transport.frame);
  const asked = () => +(transport.fps * transport.speed).toFixed(2), isMeasured = () => transport.playing && transport.measured > 0;
  const isWhole = () => review.a.there.length === review.a.numbers.length;
  const told = (id, title, textContent, className = id) => make("output", { id, className, title, textContent });
  const skip = { id: "skip", hidden: isWhole, ariaPressed: () => review.skips };
  id("time").append(
    playback.buttons, make("label", "inline", "Frame", playback.field),
    told("timecode", "Hours : minutes : seconds : frames", () => review.a.timecode(transport.frame)),
    told("state", () => state()[1], () => (state()[0] === "done" ? "" : state()[0]), () => `state ${state()[0]}`),
    make("span", "grow"), make("span", { className: "about", textContent: () => review.a.note || review.a.about.title }),
    playback.range, buttonOf("Skip missing", "Leave out frames that are not there (V)", () => review.toggleSkipped(), skip),
    make("label", "inline", "Speed", playback.speed),
    told("rate", "Frames a second, asked for and measured", () => (isMeasured() ? `${transport.measured.toFixed(1)} / ` : "") + `${asked()} fps`,
      () => `rate${isMeasured() && transport.measured < 0.93 * asked() ? " slow" : ""}`),
  );
}

function keysOf(r) {
  const { notes } = r.panels, { viewing, drawing } = r;
  return [
    ["Playing", [...r.playback.keys, ["V", "Leave out frames that are not there", { v: () => r.toggleSkipped() }]]],
    ["Comparing", [
      ["1 2", "A, B", { 1: () => r.setMode("a"), 2: () => r.setMode("b") }],
      ["T", "From A to B and back", { t: () => r.setMode(r.mode === "a" ? "b" : "a") }],
      ["W", "Wipe; drag its edge", { w: () => r.setMode("wipe") }],
      ["D", "Difference; again: ×2, ×4, ×8, ×16", { d: () => r.difference() }],
      ["S", "Side by side", { s: () => r.setMode("side") }],
      ["G", "Grid of wedges and versions", { g: () => r.setMode(r.mode === "grid" ? "a" : "grid") }],
      ["X", "Swap A and B", { x: () => r.swap() }],
      ["↑ ↓", "The sequence before, after, as A; with Shift as B", {
        ArrowUp: () => r.chooseNext("a", -1), ArrowDown: () => r.chooseNext("a", 1),
        "Shift+ArrowUp": () => r.chooseNext("b", -1), "Shift+ArrowDown": () => r.chooseNext("b", 1),
      }],
    ]],
    ["Notes", [
      ["A", "Note on this frame; Shift N: on the loop", { a: () => r.writeNote(), N: () => r.writeNote(true) }],
      ["; '", "The note before, after", { ";": () => notes.step(-1), "'": () => notes.step(1) }],
      ["R Delete", "Edit, delete the chosen note", { r: () => notes.edit(), Delete: () => notes.remove() }],
      ["7 8 9", "It is open, to be changed, approved", Object.fromEntries(STATUSES.map((status, i) => [7 + i, () => notes.setStatus(status)]))],
      ["Shift X", "List notes that are open, to be changed, approved, all", { X: () => notes.listNext() }],
      ["B", "Draw; Esc ends; 3 pen, 4 arrow, 5 rectangle, 6 text", {
        b: () => drawing.toggle(), Escape: () => drawing.toggle(false),
        ...Object.fromEntries(Object.entries(TOOLS).map(([tool, [, key]]) => [key, () => drawing.setTool(tool)])),
      }],
      ["Shift I", "The next ink", { I: () => drawing.nextInk() }],
      ["{ }", "A thinner, thicker line", { "{": () => drawing.changeWidth(-1), "}": () => drawing.changeWidth(1) }],
      ["U", "Undo; with Shift redo; also Ctrl Z", {
        u: () => r.notes.undo(), "Ctrl+z": () => r.notes.undo(),
        U: () => r.notes.redo(), "Ctrl+Z": () => r.notes.redo(), "Ctrl+y": () => r.notes.redo(),
      }],
      ["Backspace", "Erase the drawing of this frame", { Backspace: () => drawing.erase() }],
      ["Y", "Onion skin; Shift H: hide drawings", { y: () => r.toggle(r.ink, "showsOnion"), H: () => r.toggle(r.ink, "isVisible") }],
      ["Shift J T O", "Download notes as JSON, text, OTIO", { J: () => downloadNotes(r, "json"), T: () => downloadNotes(r, "txt"), O: () => downloadNotes(r, "otio") }],
      ["Shift L", "Load a file of notes; or drop it", { L: () => id("notes-file").click() }],
    ]],
    ["Layers", [
      ["Shift E", "Layers, exposure and channels; 0 resets", { E: () => viewing.toggle(), 0: () => viewing.reset() }],
      ["Shift V", "The next layer: AOVs, light groups", { V: () => viewing.nextLayer() }],
      ["Shift R G B", "Red, green, blue; Shift Y luminance", {
        R: () => viewing.set({ channel: "red" }), G: () => viewing.set({ channel: "green" }),
        B: () => viewing.set({ channel: "blue" }), Y: () => viewing.set({ channel: "luminance" }),
      }],
      ["Shift A C", "Alpha; all channels", { A: () => viewing.toggleAlpha(), C: () => viewing.set({ channel: "rgb" }) }],
      ["Page ↑ ↓", "Exposure, a quarter of a stop; with Shift gamma", {
        PageUp: () => viewing.expose(0.25), PageDown: () => viewing.expose(-0.25),
        "Shift+PageUp": () => viewing.changeGamma(1), "Shift+PageDown": () => viewing.changeGamma(-1),
      }],
      ["Shift K", "False colour where it clips", { K: () => viewing.toggleClipping() }],
      ["Shift P", "Probe", { P: () => r.toggle(viewing.probe, "isOn") }],
      ["/", "Loupe", { "/": () => r.toggle(viewing.probe, "hasLoupe") }],
      ["Shift S W", "Save the frame with drawings, without", { S: () => viewing.save(true), W: () => viewing.save(false) }],
    ]],
    ["Looking", [
      ["F", "Fit; also double click", { f: () => r.setSize(null) }],
      ["Z", "A pixel for a pixel", { z: () => r.setSize(1) }],
      ["+ −", "Closer, farther; also the wheel, two fingers", { "+": () => r.zoomBy(1.25), "=": () => r.zoomBy(1.25), "-": () => r.zoomBy(0.8) }],
      ["H", "Hide or show the panel", { h: () => r.togglePanel() }],
      ["Shift F", "Full screen", { F: () => r.fullScreen() }],
      ["Q P N M", "Notes, measures, frame, mesh", {
        q: () => r.showTab("notes"), p: () => r.showTab("measures"), n: () => r.showTab("facts"), m: () => r.showTab("mesh"),
        Q: () => notes.list({ showsAll: !notes.showsAll }),
      }],
      ["Shift Z", "Levels: waveforms and histogram", { Z: () => r.showTab("levels") }],
      ["Shift D", "Shot file, and how that of B differs", { D: () => r.showTab("shot") }],
      ["E", "Triangles of the mesh", { e: () => r.toggle(r.panels.mesh, "lines") }],
      ["Shift M", "All frames as one mesh, or simulated ones", { M: () => r.toggle(r.panels.mesh, "plays") }],
      ["C", "The shot's camera in the mesh view", { c: () => r.panels.mesh.view?.follow(true) }],
    ]],
  ];
}
