// The sculpture at the playhead, in three dimensions: to be turned, and triangles to be seen.

class MeshPanel {
  constructor(element, review, three, hint) {
    Object.assign(this, { element, review, three, hint, lines: false, follows: true, plays: true, moving: new Map() });
    element.classList.add("mesh");
  }

  draw() {
    if (this.element.hidden) return;
    if (!this.three) return void this.element.replaceChildren(make("p", "note", this.hint));
    if (!this.review.a.about.models.length) {
      return void this.element.replaceChildren(make("p", "note", "This page has no meshes of this shot; --models says how many it may have."));
    }
    if (!this.view) this.view = this.#begin();
    this.view.then(() => this.#show(), (error) => this.element.replaceChildren(make("p", "note", `No 3-D view: ${error.message}`)));
  }

  resize() {
    if (!this.renderer || this.element.hidden) return;
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    const ratio = dotsOf(), size = `${width} ${height} ${ratio}`;
    if (this.size !== size) {
      this.size = size;
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
    }
    if (this.follows && this.shown) this.#aim();
    this.#render();
  }

  async #begin() {
    const bundle = await loadThree(this.three), { THREE } = bundle;
    const decode = async (data) => (data.glb ? new bundle.GLTFLoader().parseAsync((await inflated(data.glb)).buffer, "") : data);
    Object.assign(this, { THREE, models: new ScriptStore("models", "reviewModel", decode, () => this.draw()) });
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    const canvas = Object.assign(this.renderer.domElement, { role: "img", ariaLabel: "Mesh", tabIndex: 0, className: "inset" });
    this.stage = make("div", "mesh-stage", canvas);
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0x1f1f1f);
    this.camera = new THREE.PerspectiveCamera(26, 1, 0.01, 1000);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x4a4a4a, 1.5));
    const key = new THREE.DirectionalLight(0xffffff, 2.2), rim = new THREE.DirectionalLight(0xffffff, 1.1);
    key.position.set(-2.2, 2.6, 2.4);
    rim.position.set(2.6, 1.2, -2.4);
    this.camera.add(key, rim);
    this.scene.add(this.camera);
    this.orbit = new Orbit(canvas, () => this.#look(), () => this.follow(false));
    this.#buildBar();
    this.element.replaceChildren(this.bar, this.stage, this.words);
    whenResized(this.stage, () => this.resize());
  }

  #buildBar() {
    this.buttons = {
      plays: buttonOf("Motion", "One mesh that plays every frame, or simulated frames (Shift M)", () => this.toggle("plays")),
      lines: buttonOf("Triangles", "Show the triangles (E)", () => this.toggle("lines")),
      follows: buttonOf("Shot's camera", "Look through the camera of the shot (C)", () => this.follow(!this.follows)),
      isFree: buttonOf("Free", "Turn freely, not about the vertical axis", () => { this.orbit.isFree = !this.orbit.isFree; this.#mark(); }),
    };
    this.bar = make("div", "mesh-bar", ...Object.values(this.buttons));
    this.words = make("p", "note");
    this.#mark();
  }

  #mark() {
    for (const [name, button] of Object.entries(this.buttons ?? {})) button.ariaPressed = this[name] ?? this.orbit[name];
  }

  /** Switch `plays`, one mesh in all frames, or `lines`, the triangles. */
  toggle(name) {
    this[name] = !this[name];
    this.#mark();
    this.draw();
  }

  follow(follows) {
    this.follows = follows;
    this.#mark();
    if (follows && this.shown) { this.#aim(); this.#render(); }
  }

  /** Show what is known of the frame; what is still being read is shown when it comes. */
  #show() {
    const { a, transport } = this.review, { models, motion } = a.about;
    const isNearer = (each, best) => Math.abs(each[0] - transport.frame) < Math.abs(best[0] - transport.frame);
    const [number, still] = models.reduce((best, each) => (isNearer(each, best) ? each : best));
    const moving = this.plays ? this.models.get(motion.file) : null;
    const isBroken = this.models.isBroken(motion.file) || Boolean(moving && !moving.scene); // or it has no motion
    const plays = this.plays && motion.file && !isBroken, file = plays ? motion.file : still, data = plays ? moving : this.models.get(still);
    this.buttons.plays.hidden = !motion.file || isBroken;
    if (data === false) this.words.textContent = `${file} cannot be read.`;
    if (!data) return;
    if (this.shownName !== file) this.#build(file, plays ? this.#motion(file, data) : new StillMeshes(this.THREE, data, number));
    this.#pose(isBroken ? "its file cannot be read." : motion.without);
  }

  #motion(file, gltf) {
    const { motion, fps } = this.review.a.about;
    if (!this.moving.has(file)) this.moving.set(file, new MovingMesh(this.THREE, gltf, motion.first, fps));
    return this.moving.get(file);
  }

  #build(name, meshes) {
    this.shown?.dispose();
    if (this.shown) this.scene.remove(this.shown.group);
    Object.assign(this, { shown: meshes, shownName: name });
    this.scene.add(meshes.group);
  }

  /** Show the frame at the playhead, or the nearest that there is. */
  #pose(without) {
    const { frame } = this.review.transport, { what } = this.shown;
    this.shownNumber = this.shown.show(frame);
    const words = [`Frame ${this.shownNumber}`, ...(this.shownNumber === frame ? [] : ["the nearest on this page"]), what].join(", ");
    this.words.textContent = without ? `${words}. It does not play: ${without}` : words;
    this.renderer.domElement.ariaLabel = `Mesh of frame ${this.shownNumber}, ${what}`;
    this.resize();
  }

  /** The shot's camera at the playhead. */
  #aim() {
    if (this.shown instanceof MovingMesh && this.fitted !== this.shown) {
      for (const number of this.review.a.numbers) this.#place(number);
      this.fitted = this.shown;
    }
    this.#place(this.review.transport.frame);
  }

  /** The shot's camera of a frame; where that is not known, from the front. */
  #place(frame) {
    const { a } = this.review, of = (name) => a.fact(frame, `camera.${name}`), { low, high } = this.shown.box(frame);
    const middle = low.map((value, axis) => (value + high[axis]) / 2);
    const origin = of("origin") ?? [middle[0], middle[1] + 1, middle[2] + 8], target = of("target") ?? middle;
    this.orbit.view = { position: origin, target, up: of("up") ?? [0, 1, 0] };
    this.orbit.point(this.camera);
    this.#fitView(low, high);
  }

  #look() {
    this.orbit.point(this.camera);
    this.#render();
  }

  /** As close as everything seen of the shot allows: what fitted once still fits, so that nothing jumps. */
  #fitView(low, high) {
    const corner = new this.THREE.Vector3(), { aspect } = this.camera;
    if (this.shot !== this.review.a.about) Object.assign(this, { shot: this.review.a.about, reach: { x: 0, y: 0 } });
    for (let i = 0; i < 8; i++) {
      corner.set(...[0, 1, 2].map((axis) => (i >> axis & 1 ? high : low)[axis])).applyMatrix4(this.camera.matrixWorldInverse);
      this.reach.x = Math.max(this.reach.x, Math.abs(corner.x / corner.z));
      this.reach.y = Math.max(this.reach.y, Math.abs(corner.y / corner.z));
    }
    this.orbit.slope = 2.08 * Math.max(this.reach.y, this.reach.x / aspect);
    this.camera.fov = (360 / Math.PI) * Math.atan(this.orbit.slope / 2);
    this.camera.updateProjectionMatrix();
  }

  /** Lines grow faint where they would cover all. */
  #inkLines() {
    const { a } = this.review, edge = a.about.measures[this.shownNumber]?.mean_edge ?? 0;
    const tall = this.orbit.slope * this.orbit.distance;
    const pixels = (edge / tall) * this.stage.clientHeight * (dotsOf());
    for (const { material } of this.shown.lined) material.opacity = Math.min(0.6, Math.max(0.14, pixels / 20));
  }

  #render() {
    if (!this.shown) return;
    for (const lines of this.shown.lined) lines.visible = this.lines;
    this.#inkLines();
    this.renderer.render(this.scene, this.camera);
  }
}

/** Points as balls of their own radii. three.js gives all one size, and takes no field of view into account. */
function ballMaterial(THREE) {
  const material = new THREE.PointsMaterial({ color: 0xb4b4b4 });
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = `attribute float radius;\n${shader.vertexShader}`.replace(
      "gl_PointSize = size;", "gl_PointSize = 2.0 * radius * projectionMatrix[1][1];");
    shader.fragmentShader = shader.fragmentShader.replace("outgoingLight = diffuseColor.rgb;", `
      vec2 place = 2.0 * gl_PointCoord - 1.0;
      float height = 1.0 - dot(place, place);
      if (height < 0.0) discard;
      outgoingLight = diffuseColor.rgb * (0.3 + 0.7 * sqrt(height));`);
  };
  return material;
}
