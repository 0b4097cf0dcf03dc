// Notes as files: downloaded as JSON, text and OpenTimelineIO, and read from JSON.

const MARKER_COLORS = { open: "BLUE", change: "ORANGE", approved: "GREEN" };

/** `12` or `12–20`. */
const framesOf = (note) => (note.first === note.last ? String(note.first) : `${note.first}–${note.last}`);
/** `2026-11-23 21:10` of a time as it is written, UTC. */
const minuteOf = (time) => time.slice(0, 16).replace("T", " ");
/** Who wrote a note and, if it is somebody else, who changed it last. */
const authorOf = (note) => [...new Set([(note.history[0] ?? note).author, note.author].map((name) => name || "no name"))].join(", ");

/** Files of notes: their names and keys, what is in them, and its type. */
const NOTE_FORMS = {
  json: ["JSON", "Shift J", ({ notes }) => notes.file(), "application/json"],
  txt: ["Text", "Shift T", ({ notes }) => notesText(notes.all), "text/plain"],
  otio: ["OTIO", "Shift O", (review) => notesTimeline(review, review.notes.all), "application/json"],
};

/** Download all notes of the page, also what is being written. */
function downloadNotes(review, form) {
  const [, , content, type] = NOTE_FORMS[form];
  review.panels.notes.form.finish();
  download(`${review.title}.notes.${form}`, content(review), type);
  review.redraw();
}

/** Notes by shot and sequence: [[shot, sequence, notes]]. */
function bySequence(notes) {
  const groups = Map.groupBy(notes, (note) => `${note.shot} · ${note.sequence}`);
  return [...groups.keys()].sort().map((name) => [groups.get(name)[0].shot, groups.get(name)[0].sequence, groups.get(name)]);
}

function notesText(notes) {
  const parts = bySequence(notes).map(([shot, sequence, group]) => {
    const entries = group.map((note) => {
      const drawn = note.drawings.length ? `[${strokesOf(note)}]` : "";
      const words = [note.text, drawn].filter(Boolean).join("\n").replaceAll("\n", "\n    ");
      return `  ${framesOf(note)}  ${note.status}  ${authorOf(note)}  ${minuteOf(note.modified)} UTC\n    ${words}\n`;
    });
    return `${shot} · ${sequence}\n\n${entries.join("\n")}`;
  });
  return parts.join("\n") || "No notes.\n";
}

/** `2 strokes`, with the words that are written on the picture. */
function strokesOf({ drawings }) {
  const words = drawings.filter(({ text }) => text).map(({ text }) => `“${text}”`);
  return `${drawings.length} ${drawings.length === 1 ? "stroke" : "strokes"}${words.length ? `: ${words.join(", ")}` : ""}`;
}

/** A timeline with a clip for every sequence that has notes, and a marker for every note. */
function notesTimeline(review, notes) {
  const clips = bySequence(notes).map(([shot, sequence, group]) => {
    const about = review.shots[shot], rate = about?.fps ?? 24;
    const numbers = about?.numbers ?? group.flatMap((note) => [note.first, note.last]);
    const whole = rangeOf(Math.min(...numbers), Math.max(...numbers), rate);
    return {
      ...otioItem("Clip.2", `${shot} · ${sequence}`),
      source_range: whole,
      markers: group.map((note) => ({
        ...otioItem("Marker.2", note.text.split("\n")[0].slice(0, 80) || note.status),
        metadata: { flowsculpt: { ...note, history: undefined } },
        color: MARKER_COLORS[note.status],
        marked_range: rangeOf(note.first, note.last, rate),
        comment: note.text,
      })),
      media_references: { DEFAULT_MEDIA: { ...otioItem("MissingReference.1", ""), available_range: whole } },
      active_media_reference_key: "DEFAULT_MEDIA",
    };
  });
  const track = { ...otioItem("Track.1", "notes"), kind: "Video", children: clips };
  const stack = { ...otioItem("Stack.1", "tracks"), children: [track] };
  return `${JSON.stringify({ ...otioItem("Timeline.1", review.title), global_start_time: null, tracks: stack }, null, 1)}\n`;
}

const otioItem = (schema, name) => ({ OTIO_SCHEMA: schema, name, metadata: {} });

function rangeOf(first, last, rate) {
  const time = (value) => ({ OTIO_SCHEMA: "RationalTime.1", value, rate });
  return { OTIO_SCHEMA: "TimeRange.1", start_time: time(first), duration: time(last - first + 1) };
}

/** Merge files of notes that somebody chose or dropped, and tell what came of each. */
async function loadNotes(review, files) {
  for (const file of files) {
    try {
      const count = review.notes.merge(notesIn(await file.text()));
      tell(`${file.name}: ${count} ${count === 1 ? "note" : "notes"} new or changed.`);
    } catch (error) {
      tell(`${file.name} is left out: ${error.message}.`, true);
    }
  }
}

/** Read notes from the file chooser, and from files that are dropped on the page. */
function acceptNotes(review, chooser) {
  chooser.addEventListener("change", async () => {
    await loadNotes(review, [...chooser.files]);
    chooser.value = "";
  });
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    loadNotes(review, [...event.dataTransfer.files]);
  });
}
