// Many sequences at the same frame: the cells of wedges as on their sheets, and all that the page has.

class Grid {
  constructor(element, review, wedges) {
    Object.assign(this, { element, review });
    const own = review.sequences.filter((each) => each.kind !== "wedge");
    const groupOf = (title, cells, columns) => ({ title, cells, columns: columns ?? Math.ceil(Math.sqrt(cells.length)) });
    this.groups = wedges.map(({ shot, name, columns, cells, captions }) => {
      const words = captions.map((lines) => lines.map((line) => line.join(" ")).join(", "));
      return groupOf(review.isAlone ? name : `${shot} · ${name}`, cells.map((index, i) => [review.sequences[index], words[i]]), columns);
    });
    if (own.length > 1) this.groups.push(groupOf("Renders and versions", own.map((each) => [each, each.name(review.isAlone)])));
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

  #build() {
    const [width, height] = this.groups[0].cells[0][0].size, rows = this.groups.map(({ cells, columns }) => Math.ceil(cells.length / columns));
    this.element.style.setProperty("--rows", rows.reduce((sum, each) => sum + each, 0));
    this.element.style.setProperty("--aspect", width / height);
    this.tiles = [];
    this.parts = this.groups.map((group) => {
      const cells = make("div", "cells", ...group.cells.map(([sequence, caption]) => this.#tile(sequence, caption)));
      cells.style.setProperty("--columns", group.columns);
      this.element.append(make("h2", {}, group.title), cells);
      return cells;
    });
    this.element.append(make("p", "note", "Click for A, with Shift for B; twice to see it large."));
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
