"use strict";
const facts = JSON.parse(document.getElementById("facts").textContent);
const byId = (id) => document.getElementById(id);
const MOST_PARENTS = 2, MILLISECONDS = 160, HOLD = 4; // the last picture stays for some beats

const state = Object.assign(
  { parents: [], favourites: [], change: facts.change, seed: facts.seed + 1, name: facts.next },
  remembered(),
);

function remembered() {
  try { return JSON.parse(localStorage.getItem(facts.folder)) || {}; } catch { return {}; }
}

function remember() {
  try { localStorage.setItem(facts.folder, JSON.stringify(state)); } catch { /* the page works without */ }
}

const address = (picture) => `data:image/jpeg;base64,${picture}`;
const playing = new Set();
let playsAll = false, beat = 0;

setInterval(() => {
  beat += 1;
  for (const child of facts.children) {
    const count = child.pictures.length, moves = playsAll || playing.has(child);
    const index = moves ? Math.min(beat % (count + HOLD), count - 1) : count - 1;
    if (child.shown !== index) {
      child.shown = index;
      child.image.src = address(child.pictures[index]);
    }
  }
}, MILLISECONDS);

function toggled(list, number, most) {
  if (list.includes(number)) return list.filter((each) => each !== number);
  return [...list, number].slice(-most);
}

function button(words, kind, act) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = words;
  made.className = kind;
  made.addEventListener("click", act);
  return made;
}

facts.children.forEach((child, index) => {
  const number = index + 1, card = document.createElement("article");
  const image = new Image(), words = document.createElement("p"), label = document.createElement("b");
  child.image = image;
  image.alt = child.intent;
  const like = () => { state.favourites = toggled(state.favourites, number, facts.children.length); show(); };
  image.addEventListener("click", like);
  card.addEventListener("pointerenter", () => { beat = 0; playing.add(child); });
  card.addEventListener("pointerleave", () => playing.delete(child));
  card.addEventListener("focusin", () => { beat = 0; playing.add(child); });
  card.addEventListener("focusout", () => playing.delete(child));
  label.textContent = number;
  words.append(label, child.changes.join(", "));
  words.title = child.name;
  const buttons = document.createElement("div");
  child.like = button("Favourite", "like", like);
  child.choose = button("Parent", "choose", () => { state.parents = toggled(state.parents, number, MOST_PARENTS); show(); });
  buttons.append(child.like, child.choose);
  card.append(image, words, buttons);
  child.card = card;
  byId("children").append(card);
});

if (facts.parents.length) {
  byId("ancestors").append("Children of");
  for (const parent of facts.parents) {
    const image = new Image();
    image.src = address(parent.pictures[parent.pictures.length - 1]);
    image.alt = "";
    byId("ancestors").append(image, parent.name);
  }
}

function choice() {
  const words = [facts.folder, `parents=${state.parents.join(",")}`];
  if (state.favourites.length) words.push(`favourites=${[...state.favourites].sort((a, b) => a - b).join(",")}`);
  words.push(`change=${state.change}`, `seed=${state.seed}`);
  if (state.name) words.push(`name=${state.name}`);
  return words.map((word) => (/^[\w.,=\/-]+$/.test(word) ? word : `'${word.replace(/'/g, "")}'`)).join(" ");
}

function show() {
  facts.children.forEach((child, index) => {
    const isLiked = state.favourites.includes(index + 1), isParent = state.parents.includes(index + 1);
    child.like.setAttribute("aria-pressed", isLiked);
    child.choose.setAttribute("aria-pressed", isParent);
    child.card.classList.toggle("favourite", isLiked);
    child.card.classList.toggle("parent", isParent);
  });
  const parents = state.parents.length;
  byId("chosen").textContent =
    parents === 0 ? "Choose one child as the parent of the next generation, or two to cross them."
    : parents === 1 ? `Child ${state.parents[0]} will have twelve children. Choose a second one to cross them.`
    : `Children ${state.parents.join(" and ")} will be crossed.`;
  byId("amount").textContent = state.change;
  byId("command").textContent = parents ? `flowsculpt breed --from-page "${choice()}"` : "";
  byId("copy").disabled = byId("save").disabled = !parents;
  remember();
}

byId("name").value = state.name;
byId("change").value = state.change;
byId("seed").value = state.seed;
byId("name").addEventListener("input", (event) => {
  state.name = event.target.value.trim().replace(/[^A-Za-z0-9_-]+/g, "_").replace(/^[_-]+/, "");
  show();
});
byId("change").addEventListener("input", (event) => { state.change = Number(event.target.value); show(); });
byId("seed").addEventListener("input", (event) => { state.seed = Math.max(0, Math.trunc(Number(event.target.value)) || 0); show(); });

byId("copy").addEventListener("click", async () => {
  try {
    await navigator.clipboard.writeText(byId("command").textContent);
  } catch { // a page of a file may not be allowed to
    getSelection().selectAllChildren(byId("command"));
    document.execCommand("copy");
  }
  byId("copy").textContent = "Copied";
  setTimeout(() => { byId("copy").textContent = "Copy"; }, 1500);
});

byId("save").addEventListener("click", () => {
  const link = document.createElement("a");
  link.href = `data:text/plain;charset=utf-8,${encodeURIComponent(`${choice()}\n`)}`;
  link.download = `${facts.name}_choice.txt`;
  link.click();
});

function playAll() {
  playsAll = !playsAll;
  beat = 0;
  byId("play").setAttribute("aria-pressed", playsAll);
}

byId("play").addEventListener("click", playAll);
document.addEventListener("keydown", (event) => {
  if (event.key === " " && event.target === document.body) {
    event.preventDefault();
    playAll();
  }
});
show();
