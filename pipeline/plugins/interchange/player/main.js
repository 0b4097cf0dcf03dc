// The page of a sculpture: it plays, is scrubbed, and is turned.

const HOLD = 0.8; // seconds that the last frame stays before a clip that does not close begins again
const AWAKE = 2500; // ms that the bar stays

/** The bar, the keys, and time. */
class Controls {
  constructor(player) {
    const tail = facts.closes ? 0 : facts.loops ? 1 : HOLD * facts.rate;
    Object.assign(this, { player, shots: facts.cameras.every(Boolean) });
    this.transport = new Transport((what) => this.#changed(what), { isSmooth: true, tail });
    this.transport.setNumbers(facts.numbers.slice(facts.dissolve), facts.rate);
    this.playback = new Playback(this.transport, id("buttons"), id("frame"), ["play"]);
    this.strip = new FrameStrip(id("strip"), this.transport, { stateOf: () => "there" });
    Object.assign(id("follow"), { hidden: !this.shots, onclick: () => this.#follow() });
    new Keyboard([["Playing", this.playback.keys], ["Looking", [
      ...player.orbit.keys,
      ["C", "The shot's camera", { c: () => this.#follow() }],
      ["?", "These keys"],
    ]]]);
    for (const name of ["pointermove", "pointerdown", "keydown"]) addEventListener(name, () => this.#wake());
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) this.transport.play();
    this.#wake();
  }

  #follow() { this.player.follow(!this.player.follows); }

  #changed(what) {
    if (!this.strip) return;
    const { frame, last } = this.transport;
    if (what !== "frame") {
      this.playback.draw();
      this.strip.draw();
      return;
    }
    this.playback.drawFrame();
    this.strip.drawHead();
    this.player.show(facts.loops ? frame : Math.min(frame, last)); // else the last frame stays for a while
  }

  #wake() {
    id("bar").classList.remove("idle");
    clearTimeout(this.sleep);
    this.sleep = setTimeout(() => id("bar").classList.add("idle"), AWAKE);
  }
}

async function begin() {
  if (location.hash === "#bare") document.documentElement.classList.add("bare");
  try {
    const player = new Player(await moduleOf(await bytesOf(facts.three)));
    await player.build();
    window.flowsculpt = { player, transport: new Controls(player).transport };
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
