// What the 3-D view needs, read when it is first asked for: three.js, and meshes.

/** What scripts in models/ call: each tells its mesh under its file's name. */
const models = new Map();
window.reviewModel = (name, data) => models.get(name).resolve(data);

function script(url) {
  return new Promise((resolve, reject) => {
    document.head.append(make("script", { src: url, onload: resolve, onerror: () => reject(new Error(`${url} cannot be read`)) }));
  });
}

/** three.js: kept as text, for a page that lies in a folder may load no modules from it. */
async function loadThree(file) {
  await script(file);
  const url = URL.createObjectURL(new Blob([window.reviewThree], { type: "text/javascript" }));
  try {
    return await import(url);
  } finally {
    URL.revokeObjectURL(url);
  }
}

function loadModel(name) {
  if (!models.has(name)) {
    const entry = {};
    entry.data = new Promise((resolve, reject) => Object.assign(entry, { resolve, reject }));
    models.set(name, entry);
    script(`models/${name}`).catch(entry.reject);
  }
  return models.get(name).data;
}

function decoded(text, Kind) { return new Kind(bytesIn(text).buffer); }
