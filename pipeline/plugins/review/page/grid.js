// Many sequences at the same frame: the cells of wedges as on their sheets, and all that the page has.

const SMALLEST_TILE = 150;

class Grid {
  constructor(element, review, wedges) {
    Object.assign(this, { element, review });
    const own = review.sequences.filter((each) => each.kind !== "wedge");
    this.groups = wedges.map((wedge) => ({
      title: `${review.isAlone ? "" : `${wedge.shot} · `}${wedge.name}`,
      columns: wedge.columns,
      cells: wedge.cells.map((index, i) => [review.sequences[index], wedge.captions[i].map((line) => line.join(" ")).join(", ")]),
    }));
    if (own.length > 1) {
      this.groups.push({ title: "Renders and versions", columns: null, cells: own.map((each) => [each, each.name(review.isAlone)]) });
    }
  }

  get isUseful() { return this.groups.length > 0; }

  /** The pictures that it needs for a frame. */
  urls(frame) {
    return this.groups.flatMap((group) => group.cells.map(([sequence]) => sequence.url(sequence.among(frame)))).filter(Boolean);
  }

  draw() {
    if (this.element.hidden) return;
    if (!this.tiles) this.#build();
    const { a, b, transport, cache } = this.review;
    for (const { sequence, canvas, button, mark } of this.tiles) {
      const frame = sequence.among(transport.frame), url = sequence.url(frame), bitmap = url && cache.get(url);
      const context = canvas.getContext("2d", { alpha: false });
      if (bitmap) context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
      else if (!url || cache.isBroken(url)) {
        const [state, why] = sequence.state(frame);
        drawSlate(context, { x: 0, y: 0, width: canvas.width, height: canvas.height }, `frame ${frame} ${state}`, why);
      }
      mark.textContent = [sequence === a && "A", sequence === b && "B"].filter(Boolean).join(" ");
      button.classList.toggle("chosen", sequence === a || sequence === b);
    }
  }

  /** All tiles are as large as they may be for everything to fit; beyond a smallest size the grid scrolls. */
  resize() {
    if (this.element.hidden || !this.tiles) return;
    const width = this.element.clientWidth - 40, height = this.element.clientHeight - 56;
    let wide = width;
    while (wide > SMALLEST_TILE && this.#height(wide, width) > height) wide -= 4;
    this.groups.forEach((group, i) => {
      const columns = columnsOf(group, wide, width);
      this.parts[i].style.gridTemplateColumns = `repeat(${columns}, ${Math.floor(Math.min(wide, (width - 14 * (columns - 1)) / columns))}px)`;
    });
  }

  /** How high everything is with tiles of a width. */
  #height(wide, width) {
    return this.groups.reduce((sum, group) => {
      const columns = columnsOf(group, wide, width), [w, h] = group.cells[0][0].size;
      const tile = Math.min(wide, (width - 14 * (columns - 1)) / columns);
      return sum + 50 + Math.ceil(group.cells.length / columns) * ((tile * h) / w + 40);
    }, 0);
  }

  #build() {
    this.tiles = [];
    this.parts = this.groups.map((group) => {
      const cells = make("div", "cells", ...group.cells.map(([sequence, caption]) => this.#tile(sequence, caption)));
      this.element.append(make("h2", {}, group.title), cells);
      return cells;
    });
    this.element.append(make("p", "note", "Click for A, with Shift for B; twice to see it large."));
    this.resize();
  }

  #tile(sequence, caption) {
    const scale = Math.min(1, 960 / sequence.size[0]), [width, height] = sequence.size.map((size) => Math.round(size * scale));
    const canvas = make("canvas", { width, height }), mark = make("span", "mark");
    const button = buttonOf("", "", (event) => this.review.choose(event.shiftKey ? "b" : "a", sequence), { className: "cell" });
    button.append(canvas, mark, make("span", "caption", caption));
    button.addEventListener("dblclick", () => { this.review.choose("a", sequence); this.review.setMode("a"); });
    this.tiles.push({ sequence, canvas, button, mark });
    return button;
  }
}

/** As many columns as its sheet has, or as fit. */
function columnsOf(group, wide, width) {
  return group.columns ?? Math.max(1, Math.min(group.cells.length, Math.floor((width + 14) / (wide + 14))));
}
