"use strict";
// Keys, and the help that lists them.

const KEYS = [
  ["Playing", [
    ["Space", "Play, pause", (r) => r.transport.toggle(), [" "]],
    ["← →", "A frame back, on; also , and .", null, []],
    ["", "", (r) => r.transport.step(-1), ["ArrowLeft", ","]],
    ["", "", (r) => r.transport.step(1), ["ArrowRight", "."]],
    ["Shift ← →", "Ten frames", null, []],
    ["", "", (r) => r.transport.step(-10), ["Shift+ArrowLeft"]],
    ["", "", (r) => r.transport.step(10), ["Shift+ArrowRight"]],
    ["Home End", "First, last frame", null, []],
    ["", "", (r) => r.jump(r.transport.first), ["Home"]],
    ["", "", (r) => r.jump(r.transport.last), ["End"]],
    ["J K L", "Backwards, pause, forwards; again: faster", null, []],
    ["", "", (r) => r.transport.shuttle(-1), ["j"]],
    ["", "", (r) => r.transport.pause(), ["k"]],
    ["", "", (r) => r.transport.shuttle(1), ["l"]],
    ["< >", "Slower, faster: 0.25× to 2×", null, []],
    ["", "", (r) => r.transport.changeSpeed(-1), ["<"]],
    ["", "", (r) => r.transport.changeSpeed(1), [">"]],
    ["I O", "Loop from here, to here; also [ ]", null, []],
    ["", "", (r) => r.transport.setIn(), ["i", "["]],
    ["", "", (r) => r.transport.setOut(), ["o", "]"]],
    ["\\", "Loop over all frames", (r) => r.transport.resetRange(), ["\\"]],
    ["V", "Leave out frames that are not there", (r) => r.toggleSkipped(), ["v"]],
    ["Enter", "Type a frame", (r) => r.typeFrame(), ["Enter"]],
  ]],
  ["Comparing", [
    ["1 2", "A, B", null, []],
    ["", "", (r) => r.setMode("a"), ["1"]],
    ["", "", (r) => r.setMode("b"), ["2"]],
    ["T", "From A to B and back", (r) => r.setMode(r.mode === "a" ? "b" : "a"), ["t"]],
    ["W", "Wipe; drag its edge", (r) => r.setMode("wipe"), ["w"]],
    ["D", "Difference; again: ×2, ×4, ×8, ×16", (r) => r.difference(), ["d"]],
    ["S", "Side by side", (r) => r.setMode("side"), ["s"]],
    ["G", "Grid of wedges and versions", (r) => r.setMode(r.mode === "grid" ? "a" : "grid"), ["g"]],
    ["X", "Swap A and B", (r) => r.swap(), ["x"]],
    ["↑ ↓", "The sequence before, after, as A; with Shift as B", null, []],
    ["", "", (r) => r.chooseNext("a", -1), ["ArrowUp"]],
    ["", "", (r) => r.chooseNext("a", 1), ["ArrowDown"]],
    ["", "", (r) => r.chooseNext("b", -1), ["Shift+ArrowUp"]],
    ["", "", (r) => r.chooseNext("b", 1), ["Shift+ArrowDown"]],
  ]],
  ["Notes", [
    ["A", "Note on this frame; Shift N: on the loop", null, []],
    ["", "", (r) => r.writeNote(), ["a"]],
    ["", "", (r) => r.writeNote(true), ["N"]],
    ["; '", "The note before, after", null, []],
    ["", "", (r) => r.panels.notes.step(-1), [";"]],
    ["", "", (r) => r.panels.notes.step(1), ["'"]],
    ["R Delete", "Edit, delete the chosen note", null, []],
    ["", "", (r) => r.panels.notes.edit(), ["r"]],
    ["", "", (r) => r.panels.notes.remove(), ["Delete"]],
    ["7 8 9", "It is open, to be changed, approved", null, []],
    ["", "", (r) => r.panels.notes.setStatus("open"), ["7"]],
    ["", "", (r) => r.panels.notes.setStatus("change"), ["8"]],
    ["", "", (r) => r.panels.notes.setStatus("approved"), ["9"]],
    ["Shift X", "List notes that are open, to be changed, approved, all", (r) => r.panels.notes.listNext(), ["X"]],
    ["B", "Draw; Esc ends; 3 pen, 4 arrow, 5 rectangle, 6 text", (r) => r.drawing.toggle(), ["b"]],
    ["", "", (r) => r.drawing.toggle(false), ["Escape"]],
    ["", "", (r) => r.drawing.setTool("pen"), ["3"]],
    ["", "", (r) => r.drawing.setTool("arrow"), ["4"]],
    ["", "", (r) => r.drawing.setTool("rectangle"), ["5"]],
    ["", "", (r) => r.drawing.setTool("text"), ["6"]],
    ["Shift I", "The next ink", (r) => r.drawing.nextInk(), ["I"]],
    ["{ }", "A thinner, thicker line", null, []],
    ["", "", (r) => r.drawing.changeWidth(-1), ["{"]],
    ["", "", (r) => r.drawing.changeWidth(1), ["}"]],
    ["U", "Undo; with Shift redo; also Ctrl Z", null, []],
    ["", "", (r) => r.notes.undo(), ["u", "Ctrl+z"]],
    ["", "", (r) => r.notes.redo(), ["U", "Ctrl+Z", "Ctrl+y"]],
    ["Backspace", "Erase the drawing of this frame", (r) => r.drawing.erase(), ["Backspace"]],
    ["Y", "Onion skin; Shift H: hide drawings", (r) => r.toggleOnion(), ["y"]],
    ["", "", (r) => r.toggleInk(), ["H"]],
    ["Shift J T O", "Download notes as JSON, text, OTIO", null, []],
    ["", "", (r) => downloadNotes(r, "json"), ["J"]],
    ["", "", (r) => downloadNotes(r, "txt"), ["T"]],
    ["", "", (r) => downloadNotes(r, "otio"), ["O"]],
    ["Shift L", "Load a file of notes; or drop it", () => id("notes-file").click(), ["L"]],
  ]],
  ["Layers", [
    ["Shift E", "Layers, exposure and channels; 0 resets", (r) => r.viewing.toggle(), ["E"]],
    ["", "", (r) => r.viewing.reset(), ["0"]],
    ["Shift V", "The next layer: AOVs, light groups", (r) => r.viewing.nextLayer(), ["V"]],
    ["Shift R G B", "Red, green, blue; Shift Y luminance", null, []],
    ["", "", (r) => r.viewing.set({ channel: "red" }), ["R"]],
    ["", "", (r) => r.viewing.set({ channel: "green" }), ["G"]],
    ["", "", (r) => r.viewing.set({ channel: "blue" }), ["B"]],
    ["", "", (r) => r.viewing.set({ channel: "luminance" }), ["Y"]],
    ["Shift A C", "Alpha; all channels", null, []],
    ["", "", (r) => r.viewing.toggleAlpha(), ["A"]],
    ["", "", (r) => r.viewing.set({ channel: "rgb" }), ["C"]],
    ["Page ↑ ↓", "Exposure, a quarter of a stop; with Shift gamma", null, []],
    ["", "", (r) => r.viewing.expose(0.25), ["PageUp"]],
    ["", "", (r) => r.viewing.expose(-0.25), ["PageDown"]],
    ["", "", (r) => r.viewing.changeGamma(1), ["Shift+PageUp"]],
    ["", "", (r) => r.viewing.changeGamma(-1), ["Shift+PageDown"]],
    ["Shift K", "False colour where it clips", (r) => r.viewing.set({ clipping: !r.viewing.grader.settings.clipping }), ["K"]],
    ["Shift P", "Probe", (r) => r.viewing.probe.toggle(), ["P"]],
    ["/", "Loupe", (r) => r.viewing.probe.toggleLoupe(), ["/"]],
    ["Shift S W", "Save the frame with drawings, without", null, []],
    ["", "", (r) => r.viewing.save(true), ["S"]],
    ["", "", (r) => r.viewing.save(false), ["W"]],
  ]],
  ["Looking", [
    ["F", "Fit; also double click", (r) => r.setSize("fit"), ["f"]],
    ["Z", "A pixel for a pixel", (r) => r.setSize("one"), ["z"]],
    ["+ −", "Closer, farther; also the wheel", null, []],
    ["", "", (r) => r.zoomBy(1.25), ["+", "="]],
    ["", "", (r) => r.zoomBy(0.8), ["-"]],
    ["H", "Hide or show the panel", (r) => r.togglePanel(), ["h"]],
    ["Shift F", "Full screen", (r) => r.fullScreen(), ["F"]],
    ["Q P N M", "Notes, measures, frame, mesh", null, []],
    ["", "", (r) => r.showTab("notes"), ["q"]],
    ["", "", (r) => r.panels.notes.setScope(!r.panels.notes.showsAll), ["Q"]],
    ["", "", (r) => r.showTab("measures"), ["p"]],
    ["", "", (r) => r.showTab("facts"), ["n"]],
    ["", "", (r) => r.showTab("mesh"), ["m"]],
    ["Shift Z", "Levels: waveforms and histogram", (r) => r.showTab("levels"), ["Z"]],
    ["Shift D", "Shot file, and how that of B differs", (r) => r.showTab("shot"), ["D"]],
    ["E", "Triangles of the mesh", (r) => r.panels.mesh.setLines(!r.panels.mesh.lines), ["e"]],
    ["Shift M", "All frames as one mesh, or simulated ones", (r) => r.panels.mesh.setMotion(!r.panels.mesh.plays), ["M"]],
    ["C", "The shot's camera in the mesh view", (r) => r.panels.mesh.follow(), ["c"]],
    ["?", "These keys", (r) => r.help(), ["?"]],
  ]],
];

const ACTIONS = new Map(KEYS.flatMap(([, rows]) => rows.flatMap(([, , act, keys]) => keys.map((key) => [key, act]))));

function listenForKeys(review) {
  document.addEventListener("keydown", (event) => {
    if (event.altKey || event.defaultPrevented || id("help").open) return;
    const { target } = event;
    if (target.matches("input[type=text], textarea")) return;
    if (target.matches("select, input[type=range]") && /^(Arrow|Home|End| $|Enter)/.test(event.key)) return;
    if (target.matches("button, summary, [role=tab]") && [" ", "Enter"].includes(event.key)) return;
    const act = ACTIONS.get(nameOf(event));
    if (!act) return;
    event.preventDefault();
    act(review);
  });
}

/** The name of a key press in KEYS. Letters are small unless Shift means something else; Caps Lock does not. */
function nameOf({ key, shiftKey, ctrlKey, metaKey }) {
  if (ctrlKey || metaKey) return `Ctrl+${shiftKey ? key : key.toLowerCase()}`;
  if (key.length > 1) return shiftKey ? `Shift+${key}` : key;
  return shiftKey && ACTIONS.has(key) ? key : key.toLowerCase();
}

function showHelp() {
  const dialog = id("help");
  dialog.replaceChildren(Object.assign(document.createElement("h2"), { id: "help-title", textContent: "Keys" }));
  const columns = dialog.appendChild(Object.assign(document.createElement("div"), { className: "columns" }));
  for (const [title, rows] of KEYS) {
    const part = columns.appendChild(document.createElement("section"));
    part.append(Object.assign(document.createElement("h3"), { textContent: title }));
    const list = part.appendChild(document.createElement("dl"));
    for (const [keys, words] of rows.filter(([label]) => label)) {
      const term = list.appendChild(document.createElement("dt"));
      for (const key of keys.split(" ")) term.append(Object.assign(document.createElement("kbd"), { textContent: key }), " ");
      list.append(Object.assign(document.createElement("dd"), { textContent: words }));
    }
  }
  const close = toggle("Close", "Close (Esc)", () => dialog.close());
  dialog.append(close);
  dialog.showModal();
  close.focus({ preventScroll: true });
  dialog.scrollTop = 0;  // where it is opened, the button that it begins with is at its end
}
