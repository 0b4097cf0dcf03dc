// What the page holds: keyframes of the sculptures, and the frames between which time is.

const facts = JSON.parse(id("facts").textContent);
const blobs = JSON.parse(id("blobs").textContent);

/** The bytes of a blob: base64 of deflated data. */
async function bytesOf(index) {
  const bytes = await inflated(blobs[index]);
  blobs[index] = null;
  return bytes;
}

/** Poses of `parts` numbers a vertex, in rows of four: each is the one before it plus its differences. */
function poses(bytes, count, parts) {
  const series = summed(bytes, count, Int16Array), all = [];
  for (let pose = 0; pose < series.length / parts; pose++) {
    const rows = new Int16Array(4 * count), before = all[pose - 1];
    for (let part = 0; part < parts; part++) {
      const values = series[parts * pose + part];
      for (let k = 0; k < count; k++) rows[4 * k + part] = values[k] + (before ? before[4 * k + part] : 0);
    }
    all.push(rows);
  }
  return all;
}

/** Unfolds normals from an octahedron, whose corners are `most` from its middle, to unit vectors of 32767. */
function unfold(rows, most) {
  for (let k = 0; k < rows.length; k += 4) {
    let x = rows[k] / most, y = rows[k + 1] / most;
    const z = 1 - Math.abs(x) - Math.abs(y), below = Math.max(-z, 0);
    x -= below * (x < 0 ? -1 : 1);
    y -= below * (y < 0 ? -1 : 1);
    const scale = 32767 / Math.hypot(x, y, z);
    rows.set([x, y, z].map((part) => Math.round(scale * part)), k);
  }
  return rows;
}

/** The two entries around a frame number in an ascending list, and the share of the second. */
function between(numbers, number) {
  let k = 0;
  while (k < numbers.length - 2 && numbers[k + 1] <= number) k++;
  const next = Math.min(k + 1, numbers.length - 1), apart = numbers[next] - numbers[k];
  return [k, next, apart ? clamp((number - numbers[k]) / apart, 0, 1) : 0];
}

/** Poses around a frame: of a loop that returns, the first is a frame after the last; `turns` may only look so. */
function poseAt(numbers, number) {
  const last = numbers.at(-1);
  if (!facts.meets || number <= last) return between(numbers, number);
  return [numbers.length - 1, 0, Math.min(number - last, 1)];
}

const mixed = (rows, number) => {
  const [k, next, share] = poseAt(facts.numbers, number);
  return rows[k].map((value, at) => value + share * (rows[next][at] - value));
};
