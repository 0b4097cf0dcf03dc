// Many sequences at the same frame: the cells of wedges as on their sheets, and all that the page has.

class Grid {
  constructor(element, review, wedges) {
    Object.assign(this, { element, review });
    const { sequences, isAlone } = review, own = sequences.filter((each) => each.kind !== "wedge");
    this.groups = wedges.map(({ shot, name, columns, cells, captions }) => (
      { title: isAlone ? name : `${shot} · ${name}`, cells: cells.map((index, i) => [sequences[index], captions[i]]), columns }
    ));
    const cells = own.map((each) => [each, each.name(isAlone)]);
    if (own.length > 1) this.groups.push({ title: "Renders and versions", cells, columns: Math.ceil(Math.sqrt(own.length)) });
  }

  get isUseful() { return this.groups.length > 0; }

  /** The pictures that it needs for a frame. */
  urls(frame) {
    return this.groups.flatMap((group) => group.cells.map(([sequence]) => sequence.url(sequence.among(frame)))).filter(Boolean);
  }

  draw() {
    if (this.element.hidden) return;
    this.tiles ??= this.#build();
    const { transport, cache } = this.review;
    for (const { sequence, canvas } of this.tiles) {
      const frame = sequence.among(transport.frame), url = sequence.url(frame), bitmap = cache.get(url);
      const context = canvas.getContext("2d", { alpha: false });
      if (bitmap) context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
      else if (!url || cache.isBroken(url)) {
        const [state, why] = sequence.state(frame);
        drawSlate(context, { x: 0, y: 0, width: canvas.width, height: canvas.height }, `frame ${frame} ${state}`, why);
      }
    }
  }

  /** The tiles in their groups: [{sequence, canvas}]. */
  #build() {
    const [width, height] = this.groups[0].cells[0][0].size, rows = this.groups.map(({ cells, columns }) => Math.ceil(cells.length / columns));
    this.element.style = `--rows: ${rows.reduce((sum, each) => sum + each, 0)}; --aspect: ${width / height}`;
    const tiles = this.groups.flatMap(({ title, cells, columns }) => {
      const own = cells.map(([sequence, caption]) => this.#tile(sequence, caption));
      this.element.append(make("h2", {}, title), make("div", { className: "cells", style: `--columns: ${columns}` }, ...own.map(({ button }) => button)));
      return own;
    });
    this.element.append(make("p", "note", "Click for A, with Shift for B; twice to see it large."));
    refresh(this.element);
    return tiles;
  }

  #tile(sequence, caption) {
    const { review } = this, scale = Math.min(1, 960 / sequence.size[0]), [width, height] = sequence.size.map((size) => Math.round(size * scale));
    const canvas = make("canvas", { width, height }), choose = (event) => review.choose(event.shiftKey ? "b" : "a", sequence);
    const sides = () => ["a", "b"].filter((side) => review[side] === sequence).join(" ").toUpperCase();
    const className = () => `cell plain${sides() ? " chosen" : ""}`;
    const button = buttonOf("", "", choose, { className, ondblclick: () => { review.choose("a", sequence); review.setMode("a"); } });
    button.append(canvas, make("span", { className: "mark", textContent: sides }), make("span", "caption", caption));
    return { sequence, canvas, button };
  }
}
