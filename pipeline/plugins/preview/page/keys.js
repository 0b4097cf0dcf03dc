"use strict";
// Keys, and the help that lists them.

const KEYS = [
  ["Playing", [
    ["Space", "Play, pause", (page) => page.film.play(!page.film.playing), [" "]],
    ["← →", "A frame back, on; also , and .", null, []],
    ["", "", (page) => page.film.seek(page.film.at - 1), ["ArrowLeft", ","]],
    ["", "", (page) => page.film.seek(page.film.at + 1), ["ArrowRight", "."]],
    ["Shift ← →", "Ten frames", null, []],
    ["", "", (page) => page.film.seek(page.film.at - 10), ["Shift+ArrowLeft"]],
    ["", "", (page) => page.film.seek(page.film.at + 10), ["Shift+ArrowRight"]],
    ["Home End", "First, last frame", null, []],
    ["", "", (page) => page.film.seek(page.film.take.first), ["Home"]],
    ["", "", (page) => page.film.seek(page.film.take.last), ["End"]],
    ["F", "Follow the frames as they come", (page) => page.film.follow(), ["f"]],
    ["Enter", "Type a frame", (page) => document.getElementById("frame").select(), ["Enter"]],
  ]],
  ["Editing", [
    ["Ctrl Z", "Undo", null, []],
    ["Ctrl Shift Z", "Redo; also Ctrl Y", null, []],
    ["↑ ↓", "In a number: a step; with Shift ten", null, []],
    ["Esc", "Give up a drag", null, []],
    ["V H", "Show or hide values, handles", null, []],
    ["", "", (page) => page.togglePanel(), ["v"]],
    ["", "", (page) => page.toggleHandles(), ["h"]],
    ["?", "These keys", (page) => page.help(), ["?"]],
  ]],
  ["A key of a curve", [
    ["← →", "Move it a frame; with Shift ten", null, []],
    ["↑ ↓", "Change its value; with Shift tenfold", null, []],
    ["Delete", "Remove it", null, []],
    ["K", "A key of the chosen curve at this frame", (page) => page.addKey(), ["k"]],
  ]],
  ["The pointer in the picture", [
    ["drag", "Orbit the camera", null, []],
    ["wheel", "Closer, farther", null, []],
    ["handle", "Move a centre, aim an axis, size a radius", null, []],
  ]],
];

const ACTIONS = new Map(KEYS.flatMap(([, rows]) => rows.flatMap(([, , act, keys]) => keys.map((key) => [key, act]))));

function listenForKeys(page) {
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || document.getElementById("help").open || event.altKey) return;
    const { target } = event, isText = target.matches("input[type=text], textarea"), letter = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (event.ctrlKey || event.metaKey) {
      if (isText || !["z", "y"].includes(letter)) return;
      event.preventDefault();
      if (letter === "y" || event.shiftKey) page.shot.redo();
      else page.shot.undo();
      return;
    }
    if (isText) return;
    if (target.matches("select, input[type=range]") && /^(Arrow|Home|End| $|Enter)/.test(event.key)) return;
    if (target.matches("button, summary, input[type=checkbox]") && [" ", "Enter"].includes(event.key)) return;
    const act = ACTIONS.get(event.shiftKey && event.key.length > 1 ? `Shift+${event.key}` : letter);
    if (!act || !page.film.take) return;
    event.preventDefault();
    act(page);
  });
}

function showHelp(dialog) {
  dialog.replaceChildren(make("h2", { id: "help-title", textContent: "Keys" }));
  const columns = dialog.appendChild(make("div", { className: "columns" }));
  for (const [title, rows] of KEYS) {
    const part = columns.appendChild(make("section", {}, make("h3", { textContent: title })));
    const list = part.appendChild(make("dl"));
    for (const [keys, words] of rows.filter(([label]) => label)) {
      const term = list.appendChild(make("dt"));
      for (const key of keys.split(" ")) term.append(make("kbd", { textContent: key }), " ");
      list.append(make("dd", { textContent: words }));
    }
  }
  const close = make("button", { type: "button", textContent: "Close", title: "Close (Esc)" });
  close.addEventListener("click", () => dialog.close());
  dialog.append(close);
  dialog.showModal();
  close.focus();
}
