// The page of a sculpture: it plays, is scrubbed, and is turned.

const HOLD = 0.8; // seconds that the last frame stays before a clip that does not close begins again

/** Time, with its controls and keys; it is what the player shows. */
function timeOf(player) {
  const hasCameras = facts.cameras.every(Boolean), tail = facts.closes ? 0 : facts.loops ? 1 : HOLD * facts.rate;
  const transport = new Transport({ isSmooth: true, tail }), follow = () => player.follow(hasCameras && !player.follows);
  const playback = new Playback(transport, ["play"]);
  new FrameStrip(id("strip"), transport, { stateOf: () => "there" });
  id("strip").before(playback.buttons);
  id("strip").after(playback.field);
  give(id("follow"), { hidden: !hasCameras, onclick: follow, ariaPressed: () => player.follows });
  new Keyboard([["Playing", playback.keys], ["Looking", [
    ...player.orbit.keys,
    ["C", "The shot's camera", { c: follow }],
  ]]]);
  transport.listen(() => {
    refresh();
    const frame = facts.loops ? transport.frame : Math.min(transport.frame, transport.last); // the last one stays for a while
    if (frame !== player.number) player.show(frame);
  });
  transport.setNumbers(facts.numbers.slice(facts.dissolve), facts.rate);
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) transport.play();
  return transport;
}

/** Show the bar: style lets it fade after a while, which begins again. */
function wake() {
  for (const fading of id("bar").getAnimations()) fading.currentTime = 0;
}

async function begin() {
  if (location.hash === "#bare") document.documentElement.classList.add("bare");
  try {
    const player = new Player(await moduleOf(await bytesOf(facts.three)));
    await player.build();
    window.flowsculpt = { player, transport: timeOf(player) };
    for (const name of ["pointermove", "pointerdown", "keydown"]) addEventListener(name, wake);
    const draw = () => {
      player.draw();
      requestAnimationFrame(draw);
    };
    draw();
  } catch (error) {
    id("wait").textContent = `This browser cannot show the sculpture: ${error.message}`;
    throw error;
  }
}

begin();
