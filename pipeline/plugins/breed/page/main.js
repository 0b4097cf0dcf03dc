// The children of a generation: they play, some are favourites, and one or two become parents of the next.

const facts = JSON.parse(id("facts").textContent);
const MOST_PARENTS = 2;

const state = { parents: [], favourites: [], change: facts.change, seed: facts.seed + 1, name: facts.next, ...stored((storage) => JSON.parse(storage.getItem(facts.folder))) };
let playsAll = false;

function playAll() {
  playsAll = !playsAll;
  refresh();
}

/** Pictures one below another: style shows the last of them, or plays them. */
function filmOf({ film, count }, about) {
  return make("img", { className: "film", src: `data:image/jpeg;base64,${film}`, style: `--count: ${count}; --aspect: ${facts.aspect}`, ...about });
}

/** A choice with a number in it or taken from it; of more than the most the oldest goes. */
function toggle(choice, number, most) {
  const list = state[choice];
  state[choice] = list.includes(number) ? list.filter((each) => each !== number) : [...list, number].slice(-most);
  show();
}

const children = facts.children.map((child, index) => {
  const number = index + 1, isFavourite = () => state.favourites.includes(number), isParent = () => state.parents.includes(number);
  const like = () => toggle("favourites", number, facts.children.length), choose = () => toggle("parents", number, MOST_PARENTS);
  const words = make("p", { title: child.name }, make("b", {}, String(number)), child.changes.join(", "));
  const buttons = make("div", {}, buttonOf("Favourite", `Keep child ${number}`, like, { ariaPressed: isFavourite }),
    buttonOf("Parent", `Breed from child ${number}`, choose, { className: "choose", ariaPressed: isParent }));
  const className = () => [isFavourite() && "favourite", isParent() && "parent", playsAll && "playing"].filter(Boolean).join(" ");
  id("children").append(make("article", { className }, filmOf(child, { alt: child.intent, onclick: like }), words, buttons));
  return { like };
});

if (facts.parents.length) id("ancestors").append("Children of");
for (const parent of facts.parents) id("ancestors").append(filmOf(parent, { alt: "" }), parent.name);

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
  give(id(name), { value: () => state[name], oninput: (event) => { state[name] = read(event.target.value); show(); } });
}

function copy() {
  getSelection().selectAllChildren(id("command"));
  document.execCommand("copy"); // `navigator.clipboard` is not there for every page of a file
  id("copy").textContent = "Copied";
  setTimeout(() => { id("copy").textContent = "Copy"; }, 1500);
}

const hasNoParents = () => !state.parents.length;
give(id("chosen"), { textContent: () => prospect(state.parents) });
give(id("amount"), { textContent: () => state.change });
give(id("command"), { textContent: () => (hasNoParents() ? "" : `flowsculpt breed --from-page "${choice()}"`) });
id("command").after(
  buttonOf("Copy", "", copy, { id: "copy", disabled: hasNoParents }),
  buttonOf("Save choice", "", () => download(`${facts.name}_choice.txt`, `${choice()}\n`, "text/plain"), { disabled: hasNoParents }),
);
give(id("play"), { onclick: playAll, ariaPressed: () => playsAll });
new Keyboard([["Children", [
  ["Space", "Play all", { " ": playAll }],
  ["1 … 9", "Make a child a favourite; with Tab the others too", Object.fromEntries(children.slice(0, 9).map(({ like }, i) => [i + 1, like]))],
]]]);
show();
