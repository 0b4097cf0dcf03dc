// Data in pages: base64, which may be deflated; what is read when it is needed; modules, and files to be kept.

function bytesIn(text) { return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)); }

async function inflated(text) {
  const stream = new Blob([bytesIn(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The module of a script's text: a page that lies in a folder may load none from there. */
async function moduleOf(text) {
  const url = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  try {
    return await import(url);
  } finally {
    URL.revokeObjectURL(url);
  }
}

/** Keep a file on the disk of whoever looks at the page. */
function download(name, content, type) {
  const url = URL.createObjectURL(new Blob([content], { type }));
  make("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

/** JSON that the browser keeps under a name; null where there is none, or it keeps nothing. */
function remembered(name) {
  try { return JSON.parse(localStorage.getItem(name)); } catch { return null; }
}

/** Keep a value for the next visit. */
function remember(name, value) {
  try { localStorage.setItem(name, JSON.stringify(value)); } catch { /* the page works without */ }
}
