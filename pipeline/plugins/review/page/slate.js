// What stands in the place of a picture that is not there.

const GREYS = { ground: "#232323", line: "#3a3a3a", quiet: "#a3a3a3", ink: "#ededed" };

/** Draw a slate: `title` large, `note` below it, into a rectangle {x, y, width, height}. */
function drawSlate(context, place, title, note) {
  const { x, y, width, height } = place;
  context.save();
  context.beginPath();
  context.rect(x, y, width, height);
  context.clip();
  context.fillStyle = GREYS.ground;
  context.fillRect(x, y, width, height);
  context.strokeStyle = GREYS.line;
  context.lineWidth = Math.max(1, height / 360);
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(x + width, y + height);
  context.moveTo(x + width, y);
  context.lineTo(x, y + height);
  context.stroke();
  const size = Math.max(11, Math.min(height / 11, width / 16));
  const measure = (text, font) => { context.font = font; return context.measureText(text).width; };
  const big = `600 ${size}px system-ui, sans-serif`, small = `${size * 0.52}px system-ui, sans-serif`;
  const lines = wrapped(note, (text) => measure(text, small) < 0.8 * width).slice(0, 4);
  const wide = Math.max(measure(title, big), ...lines.map((line) => measure(line, small))) + 2 * size;
  const tall = size * (1.9 + 0.85 * lines.length);
  const top = y + (height - tall) / 2;
  context.fillStyle = GREYS.ground;
  context.fillRect(x + (width - wide) / 2, top, wide, tall);
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  context.fillStyle = GREYS.ink;
  context.font = big;
  context.fillText(title, x + width / 2, top + 1.25 * size);
  context.fillStyle = GREYS.quiet;
  context.font = small;
  lines.forEach((line, i) => context.fillText(line, x + width / 2, top + (2.15 + 0.8 * i) * size));
  context.restore();
}

/** Text in lines that fit. */
function wrapped(text, fits) {
  const lines = [];
  for (const word of text.split(/\s+/).filter(Boolean)) {
    const longer = lines.length ? `${lines.at(-1)} ${word}` : word;
    if (lines.length && fits(longer)) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}
