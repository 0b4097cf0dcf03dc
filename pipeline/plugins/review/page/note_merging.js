// What a file of notes may hold, by the schema that data.js has of review_notes.py, and the rule by which files are merged.

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
