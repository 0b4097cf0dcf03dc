"use strict";
// The measures of a shot's meshes, and the seconds its frames took, as charts.

const STAGE_INKS = {
  simulate: ["simulating", "#8796a8"],
  smooth_normals: ["smoothing", "#a5ad92"],
  render: ["rendering", "#d8c8a4"],
  finish: ["denoising", "#b3907d"],
};
const UP_INK = "#a9c6b6", DOWN_INK = "#d6ab95";

class MeasuresPanel {
  constructor(element, review) {
    this.element = element;
    this.review = review;
  }

  draw() {
    if (this.element.hidden) return;
    if (this.shown !== this.review.a) this.#build(this.review.a);
    for (const chart of this.charts) chart.draw(this.review.transport.frame);
  }

  resize() {
    if (this.charts && Math.abs(this.#stretch() - this.stretched) > 0.04) this.shown = null;
    this.draw();
  }

  /** By how much charts are higher than they must be, for the room that there is. */
  #stretch() {
    const natural = this.charts.reduce((sum, { about }) => sum + about.height, 0);
    const words = this.charts.reduce((sum, { about }) => sum + (about.legend ? 86 : 38), 24);
    return Math.min(1.8, Math.max(1, (this.element.clientHeight - words) / natural));
  }

  #build(sequence) {
    this.shown = sequence;
    this.element.replaceChildren();
    const { numbers, measures, limits } = sequence.about, seek = (frame) => this.review.seek(frame);
    const rows = numbers.map((number) => measures[number] ?? null);
    const of = (name) => rows.map((row) => row?.[name] ?? null);
    const has = (name) => rows.some((row) => Number.isFinite(row?.[name]));
    const add = (about, parts) => new Chart(this.element, about, numbers, parts, seek);
    this.charts = [];
    if (has("vertices")) this.charts.push(add(...counted(of("vertices"), of("faces"))));
    if (has("splits")) this.charts.push(add(...changed(of("splits"), of("collapses"))));
    if (rows.some((row) => row?.edges)) this.charts.push(add(...edges(rows, limits)));
    if (rows.some((row) => row?.quality)) this.charts.push(add(...quality(rows)));
    if (has("area")) this.charts.push(add(...kept(of("area"), of("volume"))));
    if (rows.some((row) => row?.crossings)) {
      this.charts.push(add(...crossed(of("crossings"))));
    }
    const stages = Object.keys(STAGE_INKS).filter((stage) => sequence.seconds[stage]);
    if (stages.length) this.charts.push(add(...seconds(numbers, stages, sequence.seconds)));
    this.stretched = this.#stretch();
    for (const chart of this.charts) chart.stretch(this.stretched);
    if (!this.charts.length) this.element.append("No meshes of this shot are in the store, and so there are no measures.");
  }
}

const count = (value) => (value === null || value === undefined ? "–" : Math.round(value).toLocaleString("en").replaceAll(",", "\u2009"));
const short = (value) => (Math.abs(value) >= 1e6 ? `${(value / 1e6).toPrecision(3)} M` : Math.abs(value) >= 1e4 ? `${(value / 1e3).toPrecision(3)} k` : `${+value.toPrecision(3)}`);
const digits = (value, many = 4) => (Number.isFinite(value) ? `${+value.toPrecision(many)}` : "–");

function counted(vertices, faces) {
  const range = extent(vertices);
  return [
    { title: "Vertices", hint: "how many the mesh has", height: 52 },
    {
      paint(context, chart) {
        paintLine(context, chart, vertices, range, CHART_INKS.line);
        labelAxis(context, chart, short(Math.max(...vertices)), short(Math.min(...vertices.filter((v) => v !== null))));
      },
      value: (place) => count(vertices[place]) + (faces[place] ? `, ${count(faces[place])} triangles` : ""),
    },
  ];
}

/** Crossings, which are counted in some frames only: a line from one of these to the next. */
function crossed(values) {
  const counted = values.filter(Number.isFinite), range = extent(values);
  return [
    { title: "Crossings", hint: "pairs of faces that pass through each other; counted in some frames", height: 48 },
    {
      paint(context, chart) {
        paintLine(context, chart, bridged(values), range, CHART_INKS.line);
        labelAxis(context, chart, short(Math.max(...counted)), short(Math.min(...counted)));
      },
      value: (place) => (Number.isFinite(values[place]) ? count(values[place]) : "not counted"),
    },
  ];
}

/** The values with gaps between two of them filled along a straight line. */
function bridged(values) {
  const filled = [...values];
  let last = -1;
  values.forEach((value, i) => {
    if (!Number.isFinite(value)) return;
    for (let k = last + 1; last >= 0 && k < i; k++) filled[k] = values[last] + ((value - values[last]) * (k - last)) / (i - last);
    last = i;
  });
  return filled;
}

function changed(splits, collapses) {
  const most = Math.max(1, ...splits, ...collapses);
  return [
    { title: "Splits and collapses", hint: "splits upwards, collapses downwards", height: 72 },
    {
      paint(context, chart) {
        const middle = chart.height / 2, each = chart.plotWidth / chart.numbers.length;
        const bar = (values, ink, way) => {
          context.fillStyle = ink;
          values.forEach((value, i) => {
            const tall = ((value ?? 0) / most) * (middle - 2);
            context.fillRect(i * each, way > 0 ? middle - tall : middle, Math.max(0.5, each - 0.6), tall);
          });
        };
        bar(splits, UP_INK, 1);
        bar(collapses, DOWN_INK, -1);
        context.fillStyle = "#6a6a6a";
        context.fillRect(0, Math.round(middle), chart.plotWidth, 1);
        labelAxis(context, chart, short(most), short(most));
      },
      value: (place) => `${count(splits[place])} splits, ${count(collapses[place])} collapses`,
    },
  ];
}

function edges(rows, [shortest, longest]) {
  const top = rows.find((row) => row?.edge_top)?.edge_top ?? 1;
  const shares = rows.map((row) => (row && row.edges ? row.edges : null));
  return [
    { title: "Edge lengths", hint: "share of the edges by length, brighter where there are more", height: 96 },
    {
      paint(context, chart) {
        paintHeat(context, chart, shares);
        if (longest && longest < top) paintLevel(context, chart, longest / top, `maximum ${digits(longest)}`);
        if (shortest && shortest < top) paintLevel(context, chart, shortest / top, `minimum ${digits(shortest)}`);
      },
      value: (place) => `mean ${digits(rows[place]?.mean_edge, 3)}`,
      aside: (context, chart, place) => paintHistogram(context, chart, shares[place]),
    },
  ];
}

function quality(rows) {
  const shares = rows.map((row) => row?.quality ?? null), worst = rows.map((row) => row?.worst ?? null);
  return [
    {
      title: "Triangle quality",
      hint: "share of the triangles by roundness, from needles below to equilateral ones above; the line: a hundredth is below it",
      height: 74,
    },
    {
      paint(context, chart) {
        paintHeat(context, chart, shares);
        paintLine(context, chart, worst, [0, 1], DOWN_INK);
      },
      value: (place) => `worst hundredth under ${digits(worst[place], 2)}`,
      aside: (context, chart, place) => paintHistogram(context, chart, shares[place]),
    },
  ];
}

function kept(area, volume) {
  const share = (values) => {
    const first = values.find((value) => Number.isFinite(value));
    return values.map((value) => (Number.isFinite(value) && first ? (100 * value) / first : null));
  };
  const lines = [share(area), share(volume)], range = extent(lines.flat());
  return [
    { title: "Area and volume", hint: "of the first frame's, per cent; volume is dashed", height: 56 },
    {
      paint(context, chart) {
        paintLine(context, chart, lines[0], range, CHART_INKS.line);
        paintLine(context, chart, lines[1], range, CHART_INKS.second, [4, 3]);
        const there = lines.flat().filter((value) => value !== null);
        labelAxis(context, chart, `${Math.max(...there).toFixed(0)} %`, `${Math.min(...there).toFixed(0)} %`);
      },
      value: (place) => `${digits(area[place])}${volume[place] === null ? "" : `, ${digits(volume[place])}`}`,
    },
  ];
}

function seconds(numbers, stages, told) {
  const columns = numbers.map((number) => stages.map((stage) => told[stage][number] ?? 0));
  const sums = columns.map((column) => column.reduce((sum, s) => sum + s, 0));
  const sorted = [...sums].sort((a, b) => a - b);
  const usual = 1.6 * sorted[Math.floor(0.96 * (sorted.length - 1))], most = Math.min(sorted.at(-1), usual) || 1;
  return [
    {
      title: "Seconds",
      hint: `a frame took, by stage: ${stages.map((stage) => STAGE_INKS[stage][0]).join(", ")}`,
      height: 64,
      legend: stages.map((stage) => STAGE_INKS[stage]),
    },
    {
      paint(context, chart) {
        const each = chart.plotWidth / numbers.length;
        columns.forEach((column, i) => {
          let y = chart.height;
          column.forEach((value, stage) => {
            const tall = (value / most) * (chart.height - 4);
            context.fillStyle = STAGE_INKS[stages[stage]][1];
            context.fillRect(i * each, Math.max(0, y - tall), Math.max(0.5, each - 0.6), Math.min(tall, y));
            y = Math.max(0, y - tall);
          });
          if (sums[i] <= most) return;
          context.fillStyle = CHART_INKS.back;  // what is beyond the scale is broken off
          context.fillRect(i * each, 3, Math.max(0.5, each - 0.6), 2);
        });
        labelAxis(context, chart, `${digits(most, 2)} s`, "0");
      },
      value: (place) => (sums[place] ? `${digits(sums[place], 3)} s` : "–"),
      parts: (place) => columns[place].map((value) => (value ? digits(value, 2) : "–")),
    },
  ];
}
