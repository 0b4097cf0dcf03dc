// The notes of a page: kept by the browser, changed by people, and merged with those of others, by the schema that data.js
// has of review_notes.py.

class NoteBook {
  /** `page` is the page's identity, `given` the notes that it was written with; `changed()` is called after every change. */
  constructor(page, given, changed) {
    Object.assign(this, { changed, notes: new Map(), undone: [], done: [], isSaved: true });
    this.prefix = `flowsculpt.notes.1/${page}/`;
    this.unsettled = new Set();  // ids of notes whose latest revision may still be replaced
    this.#take(mergedNotes(given, this.#kept()));
    window.addEventListener("storage", (event) => this.#fromOtherTab(event));
    window.addEventListener("beforeunload", (event) => { if (!this.isSaved) event.preventDefault(); });
  }

  /** Notes that are not deleted, by frames. */
  get all() {
    return [...this.notes.values()].filter((note) => !note.deleted).sort((one, other) => one.first - other.first || one.last - other.last);
  }

  get(id) { return this.notes.get(id); }

  /** The notes of a sequence: those written on it, and those on the same picture of another one. */
  of(sequence) {
    return this.all.filter((note) => note.shot === sequence.shot && (
      note.sequence === sequence.label || (note.picture !== "" && note.picture === sequence.fact(note.first, "key"))
    ));
  }

  /** Begin a note; returns its id. */
  add(sequence, first, last, fields = {}) {
    const id = newId(), now = new Date().toISOString(), { author } = this;
    const picture = sequence.fact(first, "key") ?? "";
    this.#save({
      id, shot: sequence.shot, sequence: sequence.label, picture, first, last, status: "open", text: "", drawings: [],
      author, created: now, modified: now, deleted: false, ...fields, history: [],
    });
    return id;
  }

  /** Change a note. What it said before is kept as history, unless the same person changes it again on this visit. */
  edit(id, fields) {
    const note = this.notes.get(id), { author } = this;
    const isReplaced = this.unsettled.has(id) && note.author === author;
    const history = isReplaced ? note.history : [...note.history, revisionOf(note)];
    const modified = new Date(Math.max(Date.now(), Date.parse(note.modified) + 1)).toISOString();
    this.#save({ ...note, ...fields, author, modified, history });
  }

  #save(note) {
    this.notes.set(note.id, note);
    this.unsettled.add(note.id);
    this.#keep(note);
    this.changed();
  }

  /** Change a note so that it can be undone: of a note that said nothing before, that it is there. */
  editUndoably(id, fields) {
    const note = this.notes.get(id), isNew = saysNothing(note), names = Object.keys(fields);
    const before = isNew ? { deleted: true } : Object.fromEntries(names.map((name) => [name, note[name]]));
    this.done.push({ id, before, after: isNew ? { ...fields, deleted: false } : fields });
    this.undone = [];
    this.edit(id, fields);
  }

  undo() { this.#again(this.done, this.undone, "after", "before"); }
  redo() { this.#again(this.undone, this.done, "before", "after"); }

  /** Take the last step from one list to the other, unless somebody else has changed the note since. */
  #again(from, to, expected, next) {
    const step = from.pop(), note = step && this.notes.get(step.id);
    if (!step) return;
    if (Object.entries(step[expected]).some(([name, value]) => canonical(note[name]) !== canonical(value))) {
      tell("The note was changed elsewhere since, and stays as it is.", true);
      this.changed();
      return;
    }
    to.push(step);
    this.edit(step.id, step[next]);
  }

  /** Drop a note that was begun on this visit and says nothing; no storage and no file has it. */
  forget(id) {
    this.notes.delete(id);
    this.done = this.done.filter((step) => step.id !== id);
    this.changed();
  }

  /** Take in notes of others; returns how many are new or changed. */
  merge(notes) {
    const count = this.#take(notes);
    this.changed();
    return count;
  }

  /** The notes as a file has them; what they say now will not be replaced any more. */
  file() {
    this.unsettled.clear();
    this.isSaved = true;
    const notes = mergedNotes([...this.notes.values()].filter((note) => !saysNothing(note)));
    return `${JSON.stringify({ format: NOTES_FORMAT, version: NOTES_VERSION, notes }, null, 1)}\n`;
  }

  get author() { return this.name ?? stored((storage) => storage.getItem("flowsculpt.author")) ?? ""; }

  set author(name) {
    this.name = name.replace(/[\x00-\x1f\x7f-\x9f]|\p{Surrogate}/gu, "").trim().slice(0, 200);
    stored((storage) => storage.setItem("flowsculpt.author", this.name));
  }

  #take(notes) {
    let count = 0;
    for (const note of notes) {
      const there = this.notes.get(note.id), [both] = mergedNotes([note], there ? [there] : []);
      if (there && canonical(both) === canonical(there)) continue;
      this.notes.set(note.id, both);
      this.unsettled.delete(note.id);
      this.#keep(both);
      count += 1;
    }
    return count;
  }

  #keep(note) {
    if (!saysNothing(note)) stored((storage) => storage.setItem(this.prefix + note.id, JSON.stringify(note)), () => this.#tellUnsaved());
  }

  /** Tell once that the browser refuses to keep notes. */
  #tellUnsaved() {
    this.isSaved = false;
    if (!this.hasTold) tell("This browser keeps no notes: download them before you leave the page.", true);
    this.hasTold = true;
  }

  /** What an earlier visit left; what is no note is passed over. */
  #kept() {
    const read = (storage) => Object.keys(storage).filter((key) => key.startsWith(this.prefix)).map((key) => storage.getItem(key));
    return stored(read, () => []).flatMap(parsedNote);
  }

  #fromOtherTab({ key, newValue }) {
    if (key?.startsWith(this.prefix) && newValue) this.merge(parsedNote(newValue));
  }
}

/** Tell whether a note was begun, and nothing written or drawn yet. */
const saysNothing = (note) => !note.text && !note.drawings.length && !note.history.length && !note.deleted;

/**
 * A random UUID: the address of a blob ends with one. `crypto.randomUUID` is only there on secure pages, and a folder is
 * none everywhere.
 */
function newId() {
  const url = URL.createObjectURL(new Blob());
  URL.revokeObjectURL(url);
  return url.slice(-36);
}

/** The data of JSON; undefined where a text is none. */
function parsed(text) {
  try { return JSON.parse(text); } catch { return undefined; }
}

/** A list of the note in a text, or of none. */
function parsedNote(text) {
  const note = parsed(text);
  return noteFault(note, "note") ? [] : [note];
}

const NOTES_FORMAT = "flowsculpt notes", NOTES_VERSION = 1;
const STATUSES = ["open", "change", "approved"];

const schemaOf = (name) => window.reviewData.schema.$defs[name];
const isWithin = (size, least = 0, most = Infinity) => size >= least && size <= most;

/** What a value of a type must be, by the rule of a schema. */
const CHECKS = {
  boolean: (value) => typeof value === "boolean",
  integer: (value, rule) => Number.isInteger(value) && isWithin(value, rule.minimum, rule.maximum),
  string: (value, rule) => (
    typeof value === "string" && isWithin([...value].length, 0, rule.maxLength) && new RegExp(rule.pattern ?? "").test(value)
    && !/\p{Surrogate}/u.test(value) && (rule.enum?.includes(value) ?? true)
  ),
  array: (value, rule) => Array.isArray(value) && isWithin(value.length, rule.minItems, rule.maxItems),
  object: (value) => typeof value === "object" && value !== null && !Array.isArray(value),
};

/** The first fault of a value by a schema, or null. */
function faultOf(value, schema, place) {
  const rule = schema.$ref ? schemaOf(schema.$ref.split("/").at(-1)) : schema;
  if (!CHECKS[rule.type](value, rule)) return `${place} is ${String(JSON.stringify(value)).slice(0, 60)}, which the format does not allow`;
  if (rule.type === "array") return value.map((each, i) => faultOf(each, rule.items, `${place}.${i}`)).find(Boolean) ?? null;
  if (rule.type !== "object") return null;
  const missing = rule.required.find((name) => !Object.hasOwn(value, name));
  if (missing) return `${place}.${missing} is missing`;
  const unknown = Object.keys(value).find((name) => !Object.hasOwn(rule.properties, name));
  if (unknown !== undefined) return `${place}.${unknown.slice(0, 60)} is unknown in version ${NOTES_VERSION} of the format`;
  return Object.entries(rule.properties).map(([name, inner]) => faultOf(value[name], inner, `${place}.${name}`)).find(Boolean) ?? null;
}

/** The first fault of a note, or null: also of what a schema cannot say. */
function noteFault(note, place) {
  return faultOf(note, schemaOf("ReviewNote"), place) ?? [note, ...note.history].map((each) => revisionFault(each, place)).find(Boolean) ?? null;
}

function revisionFault({ first, last, drawings }, place) {
  if (first > last) return `${place}.first is after its last frame`;
  const isWrong = ({ kind, points: { length } }) => length % 2 || (kind !== "pen" && length !== (kind === "text" ? 2 : 4));
  const wrong = drawings.find(isWrong);
  return wrong ? `${place}.drawings: ${wrong.points.length} numbers are no ${wrong.kind}` : null;
}

/** The notes in the text of a file. Throws an Error that says in one sentence what is wrong with it. */
function notesIn(text) {
  const data = parsed(text);
  if (data === undefined) throw new Error("it is no JSON, or was cut short");
  if (data?.format !== NOTES_FORMAT || !Array.isArray(data.notes)) throw new Error("it is no file of notes");
  if (data.version !== NOTES_VERSION) throw new Error(`version ${String(data.version).slice(0, 20)} of its format is not read here, but ${NOTES_VERSION}`);
  const fault = data.notes.map((note, i) => noteFault(note, `notes.${i}`)).find(Boolean);
  if (fault) throw new Error(fault);
  return mergedNotes(data.notes);
}

/** JSON with sorted names and without letters beyond ASCII: Python writes the same. */
function canonical(value) {
  if (Array.isArray(value)) return `[${value.map(canonical).join(",")}]`;
  if (typeof value !== "object" || value === null) {
    return JSON.stringify(value).replace(/[\u007f-\uffff]/g, (letter) => `\\u${letter.charCodeAt(0).toString(16).padStart(4, "0")}`);
  }
  return `{${Object.keys(value).sort().map((name) => `${canonical(name)}:${canonical(value[name])}`).join(",")}}`;
}

/** What a note says, without its id and its history. */
function revisionOf(note) {
  return Object.fromEntries(Object.keys(schemaOf("NoteRevision").properties).map((name) => [name, note[name]]));
}

/** All notes with all their revisions; the latest revision of a note is shown, the others are its history. */
function mergedNotes(...collections) {
  const found = new Map();
  for (const note of collections.flat()) {
    if (!found.has(note.id)) found.set(note.id, new Map());
    for (const revision of [...note.history, revisionOf(note)]) {
      found.get(note.id).set(revision.modified + canonical(revision), revision);
    }
  }
  const notes = [...found].map(([id, revisions]) => {
    const history = [...revisions.keys()].sort().map((order) => revisions.get(order));
    return { id, ...history.pop(), history };
  });
  const order = (note) => note.created + note.id;
  return notes.sort((one, other) => (order(one) < order(other) ? -1 : 1));
}
