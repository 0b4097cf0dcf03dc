// Data in pages: base64, which may be deflated; what is read when it is needed; modules, and files to be kept.

function bytesIn(text) { return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)); }

async function inflated(text) {
  const stream = new Blob([bytesIn(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Series of `count` numbers from planes of their bytes, each the running sum of the differences stored. */
function summed(bytes, count, Kind) {
  const size = Kind.BYTES_PER_ELEMENT, series = [];
  for (let start = 0; start < bytes.length; start += count * size) {
    const values = new Kind(count);
    let last = 0;
    for (let k = 0; k < count; k++) {
      let change = 0;
      for (let plane = 0; plane < size; plane++) change |= bytes[start + plane * count + k] << (8 * plane);
      last = (last + change) | 0;
      values[k] = last;
    }
    series.push(values);
  }
  return series;
}

/** The module of a script's text: a page that lies in a folder may load none from there. */
function moduleOf(text) {
  const url = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  return import(url).finally(() => URL.revokeObjectURL(url));
}

/** Keep a file on the disk of whoever looks at the page. */
function download(name, content, type) {
  const url = URL.createObjectURL(new Blob([content], { type }));
  make("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

/** Do something with the browser's storage; where that is refused, what `refused` returns. */
function stored(act, refused = () => null) {
  try { return act(localStorage); } catch { return refused(); }
}
