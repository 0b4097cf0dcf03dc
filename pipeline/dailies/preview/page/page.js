// Shows frames as they come. A take is what one text of the shot makes; while its frames are missing, those of
// the take before are shown.
"use strict";

const $ = (id) => document.getElementById(id);
const strip = $("strip");

let take = null; // what the server said of it
let pictures = new Map(); // frame -> {image, take}
let at = 0;
let playing = true;
let follows = true; // the newest frame, until the whole take is there
let arrived = new Set();

function begin(message) {
  const same = take && take.session === message.session && take.first === message.first && take.last === message.last;
  if (!same) pictures = new Map();
  take = message;
  arrived = new Set();
  follows = true;
  if (!same) at = take.first;
  $("shot").textContent = take.shot;
  document.title = `${take.shot} – flowsculpt live`;
  $("trouble").hidden = true;
  strip.setAttribute("aria-valuemin", take.first);
  strip.setAttribute("aria-valuemax", take.last);
  drawStrip();
}

function frame(message) {
  if (!take || message.take !== take.take) return;
  const image = new Image(), { session } = take;
  image.onload = () => {
    if (session !== take.session || message.take !== take.take) return;
    const held = pictures.get(message.frame);
    if (held && held.take === message.take && held.drawn > message.drawn) return;
    pictures.set(message.frame, { image, take: message.take, drawn: message.drawn });
    arrived.add(message.frame);
    if (follows && playing && arrived.size <= take.last - take.first && !reused(message)) at = message.frame;
    if (at === message.frame) show();
    if (arrived.size > take.last - take.first) follows = false;
    drawStrip();
  };
  image.src = `frames/${message.take}/${message.frame}.jpg?${take.session}${message.drawn}`;
}

// What an edit left as it was comes at once, and is nothing to look at.
const reused = (message) => performance.now() - begun < 250 && message.frame !== take.first;
let begun = 0;

function show() {
  const held = pictures.get(at);
  $("frame").textContent = at;
  strip.setAttribute("aria-valuenow", at);
  if (!held) return;
  $("picture").src = held.image.src;
  $("picture").alt = `Frame ${at} of ${take.shot}`;
  $("picture").hidden = false;
  $("wait").hidden = true;
}

function drawStrip() {
  if (!take) return;
  const many = take.last - take.first + 1, ratio = window.devicePixelRatio || 1;
  strip.width = Math.round(strip.clientWidth * ratio);
  strip.height = Math.round(22 * ratio);
  const pen = strip.getContext("2d"), wide = strip.width / many;
  for (let i = 0; i < many; i++) {
    const held = pictures.get(take.first + i);
    pen.fillStyle = !held ? "#1f1f1f" : held.take === take.take ? "#7f8a94" : "#43474b";
    pen.fillRect(Math.floor(i * wide), 0, Math.ceil(wide), strip.height);
  }
  pen.fillStyle = "#ffffff";
  pen.fillRect((at - take.first + 0.5) * wide - ratio, 0, 2 * ratio, strip.height);
}

function go(frame) {
  if (!take) return;
  at = Math.min(take.last, Math.max(take.first, frame));
  show();
  drawStrip();
}

function play(wanted) {
  playing = wanted;
  $("play").textContent = playing ? "Stop" : "Play";
  $("play").setAttribute("aria-pressed", String(playing));
}

let due = 0;
function tick(now) {
  requestAnimationFrame(tick);
  if (!playing || follows || !take || now < due) return;
  due = Math.max(due + 1000 / take.fps, now - 100);
  go(at >= take.last ? take.first : at + 1);
}
requestAnimationFrame(tick);

function seek(event) {
  const box = strip.getBoundingClientRect();
  play(false);
  go(take.first + Math.floor(((event.clientX - box.left) / box.width) * (take.last - take.first + 1)));
}
strip.addEventListener("pointerdown", (event) => {
  if (!take) return;
  strip.setPointerCapture(event.pointerId);
  seek(event);
});
strip.addEventListener("pointermove", (event) => strip.hasPointerCapture(event.pointerId) && seek(event));
$("play").addEventListener("click", () => play(!playing));
addEventListener("resize", drawStrip);
addEventListener("keydown", (event) => {
  if (!take || event.ctrlKey || event.metaKey || event.altKey) return;
  const step = event.shiftKey ? 10 : 1;
  const does = {
    " ": () => play(!playing),
    ArrowLeft: () => (play(false), go(at - step)),
    ArrowRight: () => (play(false), go(at + step)),
    Home: () => (play(false), go(take.first)),
    End: () => (play(false), go(take.last)),
    f: () => ((follows = true), play(true)),
  }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!does || (event.key === " " && event.target === $("play"))) return;
  event.preventDefault();
  does();
});

const events = new EventSource("events");
events.onmessage = (event) => {
  const message = JSON.parse(event.data);
  if (message.event === "begin") {
    begun = performance.now();
    begin(message);
  } else if (message.event === "frame") frame(message);
  else {
    $("state").textContent = message.trouble ? "" : message.words;
    $("trouble").textContent = message.trouble ? message.words : "";
    $("trouble").hidden = !message.trouble;
  }
};
events.onerror = () => ($("state").textContent = "flowsculpt has ended; start it again to go on.");
