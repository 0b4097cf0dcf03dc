// The children of a generation: they play, some are favourites, and one or two become parents of the next.

const facts = JSON.parse(id("facts").textContent);
const MOST_PARENTS = 2, MILLISECONDS = 160, HOLD = 4; // the last picture stays for some beats

const state = { parents: [], favourites: [], change: facts.change, seed: facts.seed + 1, name: facts.next, ...stored((storage) => JSON.parse(storage.getItem(facts.folder))) };
const address = (picture) => `data:image/jpeg;base64,${picture}`;
const playing = new Set();
let playsAll = false, beat = 0;

function playAll() {
  playsAll = !playsAll;
  beat = 0;
  refresh();
}

setInterval(() => {
  beat += 1;
  for (const child of facts.children) {
    const last = child.pictures.length - 1, moves = playsAll || playing.has(child);
    const index = moves ? Math.min(beat % (last + 1 + HOLD), last) : last;
    if (child.shown === index) continue;
    child.shown = index;
    child.image.src = address(child.pictures[index]);
  }
}, MILLISECONDS);

/** A choice with a number in it or taken from it; of more than the most the oldest goes. */
function toggle(choice, number, most) {
  const list = state[choice];
  state[choice] = list.includes(number) ? list.filter((each) => each !== number) : [...list, number].slice(-most);
  show();
}

facts.children.forEach((child, index) => {
  const number = index + 1, isFavourite = () => state.favourites.includes(number), isParent = () => state.parents.includes(number);
  child.like = () => toggle("favourites", number, facts.children.length);
  const choose = () => toggle("parents", number, MOST_PARENTS);
  child.image = make("img", { alt: child.intent, onclick: child.like });
  const words = make("p", { title: child.name }, make("b", {}, String(number)), child.changes.join(", "));
  const buttons = make("div", {}, buttonOf("Favourite", `Keep child ${number}`, child.like, { ariaPressed: isFavourite }),
    buttonOf("Parent", `Breed from child ${number}`, choose, { className: "choose", ariaPressed: isParent }));
  const className = () => [isFavourite() && "favourite", isParent() && "parent"].filter(Boolean).join(" ");
  const card = make("article", { className }, child.image, words, buttons);
  for (const name of ["pointerenter", "focusin"]) card.addEventListener(name, () => { beat = 0; playing.add(child); });
  for (const name of ["pointerleave", "focusout"]) card.addEventListener(name, () => playing.delete(child));
  id("children").append(card);
});

if (facts.parents.length) id("ancestors").append("Children of");
for (const { name, pictures } of facts.parents) id("ancestors").append(make("img", { src: address(pictures.at(-1)), alt: "" }), name);

/** The choice as `breed --from-page` reads it. */
function choice() {
  const words = [facts.folder, `parents=${state.parents.join(",")}`];
  if (state.favourites.length) words.push(`favourites=${[...state.favourites].sort((a, b) => a - b).join(",")}`);
  words.push(`change=${state.change}`, `seed=${state.seed}`);
  if (state.name) words.push(`name=${state.name}`);
  return words.map((word) => (/^[\w.,=\/-]+$/.test(word) ? word : `'${word.replace(/'/g, "")}'`)).join(" ");
}

/** What will come of the parents that are chosen, in words. */
function prospect([one, other]) {
  if (one === undefined) return "Choose one child as the parent of the next generation, or two to cross them.";
  if (other === undefined) return `Child ${one} will have twelve children. Choose a second one to cross them.`;
  return `Children ${one} and ${other} will be crossed.`;
}

function show() {
  refresh();
  stored((storage) => storage.setItem(facts.folder, JSON.stringify(state)));
}

/** What the fields make of what is typed. */
const READERS = {
  name: (text) => text.trim().replace(/[^A-Za-z0-9_-]+/g, "_").replace(/^[_-]+/, ""),
  change: Number,
  seed: (text) => Math.max(0, Math.trunc(Number(text)) || 0),
};
for (const [name, read] of Object.entries(READERS)) {
  id(name).value = state[name];
  id(name).oninput = () => { state[name] = read(id(name).value); show(); };
}

async function copy() {
  try {
    await navigator.clipboard.writeText(id("command").textContent);
  } catch { // a page of a file may not be allowed to
    getSelection().selectAllChildren(id("command"));
    document.execCommand("copy");
  }
  id("copy").textContent = "Copied";
  setTimeout(() => { id("copy").textContent = "Copy"; }, 1500);
}

const hasNoParents = () => !state.parents.length;
give(id("chosen"), { textContent: () => prospect(state.parents) });
give(id("amount"), { textContent: () => state.change });
give(id("command"), { textContent: () => (hasNoParents() ? "" : `flowsculpt breed --from-page "${choice()}"`) });
give(id("copy"), { onclick: copy, disabled: hasNoParents });
give(id("save"), { onclick: () => download(`${facts.name}_choice.txt`, `${choice()}\n`, "text/plain"), disabled: hasNoParents });
give(id("play"), { onclick: playAll, ariaPressed: () => playsAll });
new Keyboard([["Children", [
  ["Space", "Play all", { " ": playAll }],
  ["1 … 9", "Make a child a favourite; with Tab the others too", Object.fromEntries(facts.children.slice(0, 9).map((child, i) => [i + 1, child.like]))],
]]]);
show();
