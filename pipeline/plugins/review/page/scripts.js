// Data in scripts: a page in a folder may load these, and nothing else. Each calls a function with its name and its data.

function script(url) {
  return new Promise((resolve, reject) => {
    document.head.append(make("script", { src: url, onload: resolve, onerror: () => reject(new Error(`${url} cannot be read`)) }));
  });
}

/** three.js: kept as text, for a page that lies in a folder may load no modules from it. */
async function loadThree(file) {
  await script(file);
  return moduleOf(window.reviewThree);
}

class ScriptStore {
  /**
   * folder   where the scripts lie
   * caller   the name of the function that they call
   * decode   (data) what is kept of it, or a promise
   * arrived  called when something can be used, or is known to be broken
   * most     bytes that are kept of what has `bits`
   */
  constructor(folder, caller, decode, arrived, most = Infinity) {
    Object.assign(this, { folder, decode, arrived, most, entries: new Map() }); // by file; null while it is read, false if broken
    window[caller] = (file, data) => this.#decode(file, data);
  }

  /** What a script has, or null while it is read; false if it cannot be. */
  get(file) {
    if (!file) return null;
    if (!this.entries.has(file)) {
      this.entries.set(file, null);
      script(`${this.folder}/${file}`).catch(() => this.#settle(file, false));
    }
    const value = this.entries.get(file);
    if (value) this.#put(file, value);
    return value;
  }

  isBroken(file) { return this.entries.get(file) === false; }

  /** Keep an entry as the one that was used last. */
  #put(file, value) {
    this.entries.delete(file);
    this.entries.set(file, value);
  }

  async #decode(file, data) {
    try {
      this.#settle(file, await this.decode(data));
    } catch {
      this.#settle(file, false);
    }
  }

  #settle(file, value) {
    this.#put(file, value);
    let bytes = 0;
    for (const [key, each] of [...this.entries].reverse()) {
      bytes += each?.bits?.byteLength ?? 0;
      if (bytes > this.most && each) this.entries.delete(key);
    }
    this.arrived();
  }
}

function decoded(text, Kind) { return new Kind(bytesIn(text).buffer); }
