// Data in pages: base64, which may be deflated; what is read when it is needed; modules, and files to be kept.

function bytesIn(text) { return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)); }

async function inflated(text) {
  const stream = new Blob([bytesIn(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
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
