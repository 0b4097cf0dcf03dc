"use strict";
// The surfaces and clouds nearest to the playhead, in three dimensions: to be turned, and triangles to be seen.

class MeshPanel {
  constructor(element, review, three, hint) {
    Object.assign(this, { element, review, three, hint, lines: false, follows: true });
    element.classList.add("mesh");
  }

  draw() {
    if (this.element.hidden) return;
    if (!this.three) return void this.element.replaceChildren(paragraph(this.hint));
    if (!this.review.a.about.models.length) {
      return void this.element.replaceChildren(paragraph("This page has no meshes of this shot; --models says how many it may have."));
    }
    if (!this.view) this.view = this.#begin();
    this.view.then(() => this.#show(), (error) => this.element.replaceChildren(paragraph(`No 3-D view: ${error.message}`)));
  }

  resize() {
    if (!this.renderer || this.element.hidden) return;
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    this.renderer.setPixelRatio(window.devicePixelRatio || 1);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.follows && this.group) this.#aim();
    this.#render();
  }

  async #begin() {
    const bundle = await loadThree(this.three), { THREE } = bundle;
    this.THREE = THREE;
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.stage = Object.assign(document.createElement("div"), { className: "mesh-stage" });
    this.renderer.domElement.setAttribute("role", "img");
    this.renderer.domElement.setAttribute("aria-label", "Mesh");
    this.stage.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0x1f1f1f);
    this.camera = new THREE.PerspectiveCamera(26, 1, 0.01, 1000);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x4a4a4a, 1.5));
    const key = new THREE.DirectionalLight(0xffffff, 2.2), rim = new THREE.DirectionalLight(0xffffff, 1.1);
    key.position.set(-2.2, 2.6, 2.4);
    rim.position.set(2.6, 1.2, -2.4);
    this.camera.add(key, rim);
    this.scene.add(this.camera);
    this.clay = new THREE.MeshStandardMaterial({
      color: 0xb4b4b4, roughness: 0.72, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
    });
    this.wire = new THREE.MeshBasicMaterial({ color: 0x111111, wireframe: true, transparent: true, opacity: 0.5 });
    this.balls = ballMaterial(THREE);
    this.controls = new bundle.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("start", () => this.#follow(false));
    this.controls.addEventListener("change", () => this.#render());
    this.#buildBar();
    this.element.replaceChildren(this.bar, this.stage, this.words);
    new ResizeObserver(() => this.resize()).observe(this.stage);
  }

  #buildBar() {
    this.bar = Object.assign(document.createElement("div"), { className: "mesh-bar" });
    this.lineButton = toggle("Triangles", "Show the triangles (E)", () => this.setLines(!this.lines));
    this.followButton = toggle("Shot's camera", "Look through the camera of the shot (C)", () => this.#follow(!this.follows));
    this.bar.append(this.lineButton, this.followButton);
    this.words = Object.assign(document.createElement("p"), { className: "note" });
    this.#mark();
  }

  #mark() {
    this.lineButton?.setAttribute("aria-pressed", this.lines);
    this.followButton?.setAttribute("aria-pressed", this.follows);
  }

  setLines(lines) {
    this.lines = lines;
    this.#mark();
    if (this.group) this.#render();
  }

  follow() { this.#follow(true); }

  #follow(follows) {
    this.follows = follows;
    this.#mark();
    if (follows && this.group) { this.#aim(); this.#render(); }
  }

  async #show() {
    const { a, transport } = this.review, frame = transport.frame;
    const [number, name] = a.about.models.reduce((best, each) => (Math.abs(each[0] - frame) < Math.abs(best[0] - frame) ? each : best));
    this.wanted = name;
    let data;
    try {
      data = await loadModel(name);
    } catch (error) {
      this.words.textContent = error.message;
      return;
    }
    if (this.wanted !== name) return;
    if (this.shownName !== name) this.#build(data);
    Object.assign(this, { shownName: name, shownNumber: number });
    const kinds = [[data.triangles, "triangles"], [data.points, "points"]].filter(([number]) => number);
    const what = kinds.map(([number, kind]) => `${count(number)} ${kind}`).join(" and ");
    this.words.textContent = number === frame ? `Frame ${number}, ${what}` : `Frame ${number}, the nearest on this page, ${what}`;
    this.renderer.domElement.setAttribute("aria-label", `Mesh of frame ${number}, ${what}`);
    this.resize();
    if (this.follows) this.#aim();
    this.#render();
  }

  #build(data) {
    const { THREE } = this;
    this.group?.traverse((each) => each.geometry?.dispose());
    this.scene.remove(this.group);
    this.group = new THREE.Group();
    this.lined = null;
    if (data.faces) {
      const geometry = this.#placed(data, data.positions);
      geometry.setAttribute("normal", new THREE.BufferAttribute(decoded(data.normals, Int8Array), 3, true));
      geometry.setIndex(new THREE.BufferAttribute(decoded(data.faces, data.wide ? Uint32Array : Uint16Array), 1));
      this.lined = new THREE.Mesh(geometry, this.wire);
      this.group.add(new THREE.Mesh(geometry, this.clay), this.lined);
    }
    if (data.points) {
      const geometry = this.#placed(data, data.centres);
      geometry.setAttribute("radius", new THREE.BufferAttribute(decoded(data.radii, Float32Array), 1));
      this.group.add(new THREE.Points(geometry, this.balls));
    }
    this.box = data;
    this.middle = new THREE.Vector3(...data.low.map((low, axis) => (low + data.high[axis]) / 2));
    this.scene.add(this.group);
  }

  /** A geometry with positions of 16 bits over the box of the data. */
  #placed(data, text) {
    const packed = decoded(text, Uint16Array), positions = new Float32Array(packed.length);
    const steps = data.low.map((low, axis) => (data.high[axis] - low) / 65535);
    for (let i = 0; i < packed.length; i++) positions[i] = data.low[i % 3] + packed[i] * steps[i % 3];
    return new this.THREE.BufferGeometry().setAttribute("position", new this.THREE.BufferAttribute(positions, 3));
  }

  /** The shot's camera at the playhead; where that is not known, from the front. */
  #aim() {
    const { a, transport } = this.review, of = (name) => a.fact(transport.frame, `camera.${name}`);
    const origin = of("origin") ?? [this.middle.x, this.middle.y + 1, this.middle.z + 8];
    const target = of("target") ?? this.middle.toArray();
    this.camera.up.fromArray(of("up") ?? [0, 1, 0]);
    this.camera.position.fromArray(origin);
    this.controls.target.fromArray(target);
    this.camera.lookAt(...target);
    this.camera.updateMatrixWorld();
    this.#fitView();
    this.controls.update();
  }

  /** As close as everything seen of the shot allows: what fitted once still fits, so that nothing jumps. */
  #fitView() {
    const corner = new this.THREE.Vector3(), { low, high } = this.box, { aspect } = this.camera;
    if (this.shot !== this.review.a.about) Object.assign(this, { shot: this.review.a.about, reach: { x: 0, y: 0 } });
    for (let i = 0; i < 8; i++) {
      corner.set(...[0, 1, 2].map((axis) => (i >> axis & 1 ? high : low)[axis])).applyMatrix4(this.camera.matrixWorldInverse);
      this.reach.x = Math.max(this.reach.x, Math.abs(corner.x / corner.z));
      this.reach.y = Math.max(this.reach.y, Math.abs(corner.y / corner.z));
    }
    this.camera.fov = (360 / Math.PI) * Math.atan(1.04 * Math.max(this.reach.y, this.reach.x / aspect));
    this.camera.updateProjectionMatrix();
  }

  /** Lines grow faint where they would cover all. */
  #inkLines() {
    const { a } = this.review, edge = a.about.measures[this.shownNumber]?.mean_edge ?? 0;
    const distance = this.camera.position.distanceTo(this.controls.target);
    const tall = 2 * distance * Math.tan((this.camera.fov * Math.PI) / 360);
    const pixels = (edge / tall) * this.stage.clientHeight * (window.devicePixelRatio || 1);
    this.wire.opacity = Math.min(0.6, Math.max(0.14, pixels / 20));
  }

  #render() {
    if (!this.group) return;
    if (this.lined) this.lined.visible = this.lines;
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

function paragraph(text) {
  return Object.assign(document.createElement("p"), { className: "note", textContent: text });
}

function toggle(text, title, click) {
  const button = Object.assign(document.createElement("button"), { type: "button", textContent: text, title });
  button.addEventListener("click", click);
  return button;
}
