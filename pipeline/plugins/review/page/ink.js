// Drawings of notes over the picture: vectors in ten-thousandths of the picture's width, drawn at any size.

const UNITS = 10000;
const GHOSTS = [[-1, 0.34], [1, 0.2]];  // onion skin: the drawn frame before, and the one after
const RIGHT_TO_LEFT = /[\p{Script=Arabic}\p{Script=Hebrew}\p{Script=Syriac}\p{Script=Thaana}\p{Script=Nko}\p{Script=Adlam}]/u;

class InkLayer {
  constructor(canvas, review) {
    Object.assign(this, { canvas, review, showsOnion: false, isVisible: true });
    this.context = canvas.getContext("2d");
  }

  /** Where which sequence's picture lies on the stage, in pixels of the display. */
  shown() {
    const { mode, stage, a, b } = this.review;
    if (mode === "grid") return [];
    const [one, other] = stage.places(), half = this.canvas.width / 2, whole = this.canvas.width;
    if (mode === "side") return [{ sequence: a, place: one, from: 0, to: half }, { sequence: b, place: other, from: half, to: whole }];
    if (mode === "wipe") {
      const edge = stage.wipeAt(one);
      return [{ sequence: a, place: one, from: 0, to: edge }, { sequence: b, place: one, from: edge, to: whole }];
    }
    return [{ sequence: mode === "b" ? b : a, place: one, from: 0, to: whole }];
  }

  /** The part of the stage at a point: {sequence, place}. */
  at(point) { return this.shown().find(({ from, to }) => point.x >= from && point.x < to); }

  draw() {
    const { canvas, context, review } = this, { width, height } = review.stage.canvas;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    else context.clearRect(0, 0, width, height);
    if (!this.isVisible) return;
    for (const { sequence, place, from, to } of this.shown()) {
      context.save();
      context.beginPath();
      context.rect(from, 0, to - from, height);
      context.clip();
      this.drawOver(context, sequence, place, review.transport.frame);
      const { unfinished } = review.drawing;
      if (unfinished && unfinished.sequence === sequence) drawStroke(context, unfinished.stroke, place);
      context.restore();
    }
  }

  /** Draw the strokes of a frame, and with onion skin those of the drawn frames around it, faintly. */
  drawOver(context, sequence, place, frame) {
    const strokes = this.review.notes.of(sequence).flatMap((note) => note.drawings);
    if (this.showsOnion) {
      const drawn = [...new Set(strokes.map((stroke) => stroke.frame))].sort((one, other) => one - other);
      for (const [way, alpha] of GHOSTS) {
        const near = way < 0 ? drawn.findLast((each) => each < frame) : drawn.find((each) => each > frame);
        context.globalAlpha = alpha;
        for (const stroke of strokes) if (stroke.frame === near) drawStroke(context, stroke, place);
      }
      context.globalAlpha = 1;
    }
    for (const stroke of strokes) if (stroke.frame === frame) drawStroke(context, stroke, place);
  }
}

/** Draw one stroke over a picture that lies at `place`, with a dark edge so that it is seen on any ground. */
function drawStroke(context, stroke, place) {
  const unit = place.width / UNITS, { kind, points } = stroke;
  const at = (i) => [place.x + points[i] * unit, place.y + points[i + 1] * unit];
  const width = Math.max(1, stroke.width * unit);
  context.save();
  Object.assign(context, { lineJoin: "round", lineCap: "round", shadowColor: "rgba(0, 0, 0, 0.75)", shadowBlur: Math.max(2, 0.6 * width) });
  Object.assign(context, { strokeStyle: stroke.ink, fillStyle: stroke.ink, lineWidth: width });
  context.beginPath();
  if (kind === "text") drawWords(context, stroke, at(0), 6 * width);
  else if (kind === "rectangle") context.rect(...at(0), at(2)[0] - at(0)[0], at(2)[1] - at(0)[1]);
  else if (kind === "arrow") arrowPath(context, at(0), at(2), width);
  else penPath(context, at, points.length);
  if (kind !== "text") context.stroke();
  context.restore();
}

/** A smooth line: curves between the middles of its points. A line of one point is a dot. */
function penPath(context, at, count) {
  context.moveTo(...at(0));
  if (count === 2) context.lineTo(...at(0));
  for (let i = 2; i < count - 2; i += 2) {
    const [x, y] = at(i), [nextX, nextY] = at(i + 2);
    context.quadraticCurveTo(x, y, (x + nextX) / 2, (y + nextY) / 2);
  }
  if (count > 2) context.lineTo(...at(count - 2));
}

function arrowPath(context, [fromX, fromY], [toX, toY], width) {
  const angle = Math.atan2(toY - fromY, toX - fromX), length = Math.hypot(toX - fromX, toY - fromY);
  const head = Math.min(4.5 * width, 0.6 * length);
  context.moveTo(fromX, fromY);
  context.lineTo(toX, toY);
  for (const side of [-0.5, 0.5]) {
    context.moveTo(toX - head * Math.cos(angle + side), toY - head * Math.sin(angle + side));
    context.lineTo(toX, toY);
  }
}

function drawWords(context, stroke, [x, y], size) {
  Object.assign(context, { font: `600 ${size}px system-ui, sans-serif`, textBaseline: "top", textAlign: "left" });
  stroke.text.split("\n").forEach((line, i) => {
    context.direction = RIGHT_TO_LEFT.test(line.match(/\p{L}/u)?.[0] ?? "") ? "rtl" : "ltr";
    context.fillText(line, x, y + 1.25 * size * i);
  });
}
