// What a file of notes may hold, and the rule by which files are merged: the same as in review_notes.py.

const NOTES_FORMAT = "flowsculpt notes", NOTES_VERSION = 1;
const STATUSES = ["open", "change", "approved"];
const TIME = /^20[0-9]{2}-(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])T([01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9]\.[0-9]{3}Z$/;

const isWhole = (limit) => (value) => Number.isInteger(value) && Math.abs(value) <= limit;
const isText = (most, pattern) => (value) => (
  typeof value === "string" && [...value].length <= most && pattern.test(value) && !/\p{Surrogate}/u.test(value)
);
const isLine = isText(400, /^[^\x00-\x1f\x7f-\x9f]*$/);
const isWords = isText(20000, /^[^\x00-\x08\x0b-\x1f\x7f-\x9f]*$/);
const isTime = isText(24, TIME);
const isListOf = (most, check) => (value) => Array.isArray(value) && value.length <= most && value.every(check);

const STROKE_RULES = {
  frame: isWhole(1e6),
  kind: (value) => ["pen", "arrow", "rectangle", "text"].includes(value),
  ink: isText(7, /^#[0-9a-f]{6}$/),
  width: (value) => Number.isInteger(value) && value >= 1 && value <= 1000,
  points: (value) => isListOf(20000, isWhole(1e5))(value) && value.length >= 2 && value.length % 2 === 0,
  text: isWords,
};
const REVISION_RULES = {
  shot: isText(100, /^[A-Za-z0-9][A-Za-z0-9_.-]*$/),
  sequence: isLine,
  picture: isText(64, /^[0-9a-f]*$/),
  first: isWhole(1e6),
  last: isWhole(1e6),
  status: (value) => STATUSES.includes(value),
  text: isWords,
  drawings: isListOf(2000, () => true),
  author: isLine,
  created: isTime,
  modified: isTime,
  deleted: (value) => typeof value === "boolean",
};
const NOTE_RULES = {
  ...REVISION_RULES,
  id: isText(36, /^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$/),
  history: isListOf(10000, () => true),
};

/** The first fault of an object, or null. */
function faultOf(value, rules, place) {
  if (typeof value !== "object" || value === null || Array.isArray(value)) return `${place} is no object`;
  for (const [name, isRight] of Object.entries(rules)) {
    if (!Object.hasOwn(value, name)) return `${place}.${name} is missing`;
    if (!isRight(value[name])) return `${place}.${name} is ${String(JSON.stringify(value[name])).slice(0, 60)}, which the format does not allow`;
  }
  const unknown = Object.keys(value).find((name) => !Object.hasOwn(rules, name));
  return unknown === undefined ? null : `${place}.${unknown.slice(0, 60)} is unknown in version ${NOTES_VERSION} of the format`;
}

function strokeFault(stroke, place) {
  const fault = faultOf(stroke, STROKE_RULES, place);
  if (fault || stroke.kind === "pen") return fault;
  const { length } = stroke.points;
  return length === (stroke.kind === "text" ? 2 : 4) ? null : `${place}.points: ${length} numbers are no ${stroke.kind}`;
}

function revisionFault(revision, rules, place) {
  const fault = faultOf(revision, rules, place);
  if (fault) return fault;
  if (revision.first > revision.last) return `${place}.first is after its last frame`;
  return revision.drawings.map((stroke, i) => strokeFault(stroke, `${place}.drawings.${i}`)).find(Boolean) ?? null;
}

function noteFault(note, place) {
  return revisionFault(note, NOTE_RULES, place)
    ?? note.history.map((each, i) => revisionFault(each, REVISION_RULES, `${place}.history.${i}`)).find(Boolean) ?? null;
}

/** The notes in the text of a file. Throws an Error that says in one sentence what is wrong with it. */
function notesIn(text) {
  let data;
  try {
    data = JSON.parse(text);
  } catch {
    throw new Error("it is no JSON, or was cut short");
  }
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
  return Object.fromEntries(Object.keys(REVISION_RULES).map((name) => [name, note[name]]));
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
