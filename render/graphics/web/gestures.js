// What a mouse, a pen, fingers and a trackpad do to an element.

/**
 * start(event)         the main button, a pen or a finger goes down
 * move(event, begun, dx, dy)  it has moved by more than a little: since the last time by so many pixels
 * end(event, begun)    it was released after a move
 * click(event)         it was released without one
 * cancel(event)        the move was given up: by Escape, by a second finger, or by the browser
 * over(isDone)         after each of the last three
 * pan(dx, dy)          the middle or the right button, the main one with Shift, or two fingers move, in pixels
 * zoom(factor, event)  the wheel turns, or two fingers move apart; above 1 is farther
 * hover(event)         a pointer moves that is not down
 */
function gestures(element, acts) {
  const down = new Map(); // the last event of each pointer that is down
  let drag = null;

  const finish = (way, event) => {
    const { begun, isMoved } = drag;
    drag = gestures.active = null;
    if (isMoved) acts[way]?.(event, begun);
    else if (way === "end") acts.click?.(event);
    acts.over?.(isMoved && way === "end");
  };

  element.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    event.stopPropagation();
    element.setPointerCapture(event.pointerId);
    down.set(event.pointerId, event);
    if (drag) return finish("cancel", event);
    if (event.button === 0 && down.size === 1 && !(event.shiftKey && acts.pan)) {
      drag = { begun: event, last: event, isMoved: false };
      gestures.active = { element, giveUp: (by) => finish("cancel", by) };
      acts.start?.(event);
    }
    element.focus?.({ preventScroll: true, focusVisible: false });
  });

  element.addEventListener("pointermove", (event) => {
    const last = down.get(event.pointerId);
    if (!last) return acts.hover?.(event);
    down.set(event.pointerId, event);
    if (drag) {
      drag.isMoved ||= apart(event, drag.begun) >= 3;
      if (!drag.isMoved) return;
      acts.move?.(event, drag.begun, event.clientX - drag.last.clientX, event.clientY - drag.last.clientY);
      drag.last = event;
      return;
    }
    const other = [...down.values()].find((each) => each !== event), share = other ? 0.5 : 1;
    acts.pan?.(share * (event.clientX - last.clientX), share * (event.clientY - last.clientY));
    if (other) acts.zoom?.(apart(last, other) / Math.max(1, apart(event, other)), event);
  });

  for (const [name, way] of [["pointerup", "end"], ["pointercancel", "cancel"]]) {
    element.addEventListener(name, (event) => {
      down.delete(event.pointerId);
      if (drag) finish(way, event);
    });
  }
  if (acts.pan) element.addEventListener("contextmenu", (event) => event.preventDefault());
  if (!acts.zoom) return;
  element.addEventListener("wheel", (event) => {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode ? 16 : 1); // some browsers count lines
    acts.zoom(Math.exp((event.ctrlKey ? 0.01 : 0.001) * pixels), event); // with Ctrl it is a pinch on a trackpad
  }, { passive: false });
}

const apart = (one, other) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);

document.addEventListener("keydown", (event) => {
  if (event.key !== "Escape" || !gestures.active) return;
  event.preventDefault();
  gestures.active.giveUp(event);
}, true);
