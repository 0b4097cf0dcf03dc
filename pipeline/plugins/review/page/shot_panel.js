// The shot file of A, and where that of B differs: line by line.

const CONTEXT = 3;  // equal lines around a difference
const MOST_LINES = 3000;

class ShotPanel {
  constructor(element, review, sources) {
    Object.assign(this, { element, review, sources });
  }

  draw() {
    if (this.element.hidden) return;
    const { a, b } = this.review;
    if (this.shown?.[0] === a && this.shown[1] === b) return;
    this.shown = [a, b];
    const [one, other] = [a, b].map((each) => this.sources[each.source]?.split("\n"));
    if (!one || !other) {
      this.element.replaceChildren(make("p", "note", `The page has no shot file of ${(one ? b : a).name(this.review.isAlone)}.`));
    } else if (a.source === b.source) {
      this.element.replaceChildren(make("p", "note", a === b ? "" : "The shot files of A and B are the same."), lineList(one.map((line) => [" ", line])));
    } else {
      const lines = differences(one, other), count = lines.filter(([sign]) => sign !== " ").length;
      const legend = make("p", "note", `${count} ${count === 1 ? "line differs" : "lines differ"}: − `, a.name(this.review.isAlone), " (A), + ", b.name(this.review.isAlone), " (B).");
      this.element.replaceChildren(legend, lineList(shortened(lines)));
    }
    this.element.scrollTop = 0;
  }
}

/** Lines of two texts as [sign, line]: − of the first only, + of the second only, and a space of both, by their longest
 *  common subsequence; of very long texts all lines are told as changed. */
function differences(one, other) {
  const less = (lines) => lines.map((line) => ["−", line]), more = (lines) => lines.map((line) => ["+", line]);
  if (Math.max(one.length, other.length) > MOST_LINES) return [...less(one), ...more(other)];
  const width = other.length + 1, lengths = new Uint16Array((one.length + 1) * width), found = [];
  for (let i = one.length - 1; i >= 0; i--) {
    for (let j = other.length - 1; j >= 0; j--) {
      const at = i * width + j;
      lengths[at] = one[i] === other[j] ? 1 + lengths[at + width + 1] : Math.max(lengths[at + width], lengths[at + 1]);
    }
  }
  let i = 0, j = 0;
  while (i < one.length && j < other.length) {
    const at = i * width + j;
    if (one[i] === other[j]) {
      found.push([" ", one[i]]);
      i += 1;
      j += 1;
    } else if (lengths[at + width] >= lengths[at + 1]) {
      found.push(["−", one[i]]);
      i += 1;
    } else {
      found.push(["+", other[j]]);
      j += 1;
    }
  }
  return [...found, ...less(one.slice(i)), ...more(other.slice(j))];
}

/** Lines far from a difference in one: [null, how many]. */
function shortened(lines) {
  const isNear = lines.map((_, i) => lines.slice(Math.max(0, i - CONTEXT), i + CONTEXT + 1).some(([sign]) => sign !== " "));
  const kept = [];
  lines.forEach((line, i) => {
    if (isNear[i]) kept.push(line);
    else if (kept.length && kept.at(-1)[0] === null) kept.at(-1)[1] += 1;
    else kept.push([null, 1]);
  });
  return kept;
}

function lineList(lines) {
  const names = { "−": "less", "+": "more" };
  return make("div", "shot-lines", ...lines.map(([sign, line]) => (
    sign === null ? make("div", "gap", `⋯ ${line} equal ${line === 1 ? "line" : "lines"}`) : make("div", names[sign] ?? "", make("b", {}, sign), line)
  )));
}
