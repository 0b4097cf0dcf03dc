// The address tells what is shown, so that it can be sent to somebody.

let remembering = 0;

function rememberSoon(review) {
  const said = new URLSearchParams({
    frame: review.transport.frame, a: review.a.name(false), b: review.b.name(false), mode: review.mode,
  });
  clearTimeout(remembering);
  remembering = setTimeout(() => history.replaceState(null, "", `#${said}`), 200);
}

/** Show what an address tells; of what it does not: the largest and longest render, and another beside it. */
function restoreFrom(review, hash) {
  const said = new URLSearchParams(hash.slice(1)), { sequences } = review;
  const named = (name) => sequences.find((each) => each.name(false) === name);
  const worth = (each) => (each.kind === "render" ? 1e9 : 1) * each.size[0] * each.there.length;
  const a = named(said.get("a")) ?? sequences.reduce((best, each) => (worth(each) > worth(best) ? each : best));
  const others = sequences.filter((each) => each !== a);
  review.b = named(said.get("b")) ?? others.find((each) => each.shot === a.shot) ?? others[0] ?? a;
  review.choose("a", a);
  const frame = Number.parseInt(said.get("frame"), 10);
  review.transport.go(Number.isFinite(frame) ? frame : review.transport.first);
  if (MODE_NAMES[said.get("mode")]) review.setMode(said.get("mode"));
}
