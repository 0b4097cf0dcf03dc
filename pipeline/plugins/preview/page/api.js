// Requests to the server: each has a JSON object as its answer, or is refused with one message.

class RefusedError extends Error {
  /** status: 409 where the file was changed meanwhile, 422 for a bad value, 507 where the disk refuses. */
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

const ENDED = "flowsculpt has ended, so nothing was written. Start it again and open its new address.";

/** Ask the server by the name of a request. Throws RefusedError. */
async function ask(name, body) {
  let answer;
  try {
    answer = await fetch(name, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
  } catch {
    throw new RefusedError(ENDED, 0);
  }
  const data = await answer.json().catch(() => ({ error: `The server answers ${answer.status}; load the page again.` }));
  if (!answer.ok) throw new RefusedError(data.error, answer.status);
  return data;
}
