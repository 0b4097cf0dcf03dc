// The keys of the page, by what they are for.

function keysOf(r) {
  const { notes } = r.panels, { viewing, drawing } = r;
  return [
    ["Playing", [...r.controls.playback.keys, ["V", "Leave out frames that are not there", { v: () => r.toggleSkipped() }]]],
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
      ["Y", "Onion skin; Shift H: hide drawings", { y: () => r.toggleOnion(), H: () => r.toggleInk() }],
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
      ["Shift P", "Probe", { P: () => viewing.probe.toggle() }],
      ["/", "Loupe", { "/": () => viewing.probe.toggleLoupe() }],
      ["Shift S W", "Save the frame with drawings, without", { S: () => viewing.save(true), W: () => viewing.save(false) }],
    ]],
    ["Looking", [
      ["F", "Fit; also double click", { f: () => r.setSize("fit") }],
      ["Z", "A pixel for a pixel", { z: () => r.setSize("one") }],
      ["+ −", "Closer, farther; also the wheel, two fingers", { "+": () => r.zoomBy(1.25), "=": () => r.zoomBy(1.25), "-": () => r.zoomBy(0.8) }],
      ["H", "Hide or show the panel", { h: () => r.togglePanel() }],
      ["Shift F", "Full screen", { F: () => r.fullScreen() }],
      ["Q P N M", "Notes, measures, frame, mesh", {
        q: () => r.showTab("notes"), p: () => r.showTab("measures"), n: () => r.showTab("facts"), m: () => r.showTab("mesh"),
        Q: () => notes.setScope(!notes.showsAll),
      }],
      ["Shift Z", "Levels: waveforms and histogram", { Z: () => r.showTab("levels") }],
      ["Shift D", "Shot file, and how that of B differs", { D: () => r.showTab("shot") }],
      ["E", "Triangles of the mesh", { e: () => r.panels.mesh.toggle("lines") }],
      ["Shift M", "All frames as one mesh, or simulated ones", { M: () => r.panels.mesh.toggle("plays") }],
      ["C", "The shot's camera in the mesh view", { c: () => r.panels.mesh.follow(true) }],
      ["?", "These keys"],
    ]],
  ];
}
