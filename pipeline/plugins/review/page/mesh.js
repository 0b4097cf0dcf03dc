// The sculpture at the playhead, in three dimensions: to be turned, and triangles to be seen. It is a frame as it was
// simulated, or all frames as one mesh.

class MeshPanel {
  constructor(element, review, three, hint) {
    Object.assign(this, { element, review, three, hint, words: make("p", "note") });
    Object.assign(this, { plays: true, lines: false }); // one mesh in all frames; its triangles
    element.classList.add("mesh");
  }

  draw() {
    const none = "This page has no meshes of this shot; --models says how many it may have.";
    if (!this.three || !this.review.a.about.models.length) return this.element.replaceChildren(make("p", "note", this.three ? none : this.hint));
    this.begun ??= this.#begin();
    this.begun.then(() => this.#show(), (error) => this.element.replaceChildren(make("p", "note", `No 3-D view: ${error.message}`)));
  }

  async #begin() {
    await script(this.three); // its text, for a page that lies in a folder may load no modules from it
    const bundle = await moduleOf(window.reviewThree);
    const decode = async (data) => (data.glb ? new bundle.GLTFLoader().parseAsync((await inflated(data.glb)).buffer, "") : data);
    this.models = new ScriptStore("models", "reviewModel", decode, () => this.review.drawPanel());
    this.view = new MeshView(bundle.THREE, this.review);
    this.element.replaceChildren(this.#bar(), make("div", "mesh-stage", this.view.canvas), this.words);
    whenResized(this.view.canvas, () => this.view.resize());
  }

  #bar() {
    const { review, view } = this, { orbit } = view;
    return make("div", "mesh-bar",
      buttonOf("Motion", "One mesh that plays every frame, or simulated frames (Shift M)", () => review.toggle(this, "plays"), { ariaPressed: () => this.plays, hidden: () => !this.hasMotion }),
      buttonOf("Triangles", "Show the triangles (E)", () => review.toggle(this, "lines"), { ariaPressed: () => this.lines }),
      buttonOf("Shot's camera", "Look through the camera of the shot (C)", () => view.follow(!view.follows), { ariaPressed: () => view.follows }),
      buttonOf("Free", "Turn freely, not about the vertical axis", () => review.toggle(orbit, "isFree"), { ariaPressed: () => orbit.isFree }));
  }

  /** Show what is known of the frame; what is still being read is shown when it comes. */
  #show() {
    const { a, transport } = this.review, { models, motion } = a.about;
    const number = nearestOf(models.map(([each]) => each), transport.frame), [, still] = models.find(([each]) => each === number);
    const moving = this.plays ? this.models.get(motion.file) : null;
    const isBroken = this.models.isBroken(motion.file) || Boolean(moving && !moving.scene); // or it has no motion
    const plays = this.plays && motion.file && !isBroken, file = plays ? motion.file : still, data = plays ? moving : this.models.get(still);
    this.hasMotion = motion.file && !isBroken;
    refresh(this.element);
    if (data === false) this.words.textContent = `${file} cannot be read.`;
    if (!data) return;
    const { THREE } = this.view, motionOf = () => (data.meshes ??= new MovingMesh(THREE, data, motion.first, a.about.fps));
    if (this.view.shownName !== file) this.view.put(file, plays ? motionOf() : new StillMeshes(THREE, data, number));
    this.view.lines = this.lines;
    const words = this.view.show(transport.frame), without = isBroken ? "its file cannot be read." : motion.without;
    this.words.textContent = without ? `${words}. It does not play: ${without}` : words;
  }
}

class MeshView extends ShotView {
  constructor(THREE, review) {
    super(THREE, new THREE.WebGLRenderer({ antialias: true }));
    this.review = review;
    give(this.canvas, { role: "img", ariaLabel: "Mesh", tabIndex: 0, className: "inset grab" });
    this.scene.background = new THREE.Color(0x1f1f1f);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x4a4a4a, 1.5), this.camera);
    for (const [power, ...place] of [[2.2, -2.2, 2.6, 2.4], [1.1, 2.6, 1.2, -2.4]]) { // key and rim
      const light = new THREE.DirectionalLight(0xffffff, power);
      light.position.set(...place);
      this.camera.add(light);
    }
  }

  /** Put other meshes in the place of those that are there. */
  put(name, meshes) {
    this.shown?.dispose?.();
    if (this.shown) this.scene.remove(this.shown.group);
    Object.assign(this, { shown: meshes, shownName: name });
    this.scene.add(meshes.group);
  }

  /** Show a frame, or the nearest that there is; tell in words what is shown. */
  show(frame) {
    const { what } = this.shown, number = this.shownNumber = this.shown.show(frame);
    this.canvas.ariaLabel = `Mesh of frame ${number}, ${what}`;
    this.look();
    return [`Frame ${number}`, ...(number === frame ? [] : ["the nearest on this page"]), what].join(", ");
  }

  aim() {
    if (!this.shown) return;
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
    const position = of("origin") ?? [middle[0], middle[1] + 1, middle[2] + 8], target = of("target") ?? middle;
    this.orbit.view = { position, target, up: of("up") ?? [0, 1, 0] };
    this.orbit.point(this.camera);
    this.#fitView(low, high);
  }

  /** As close as everything seen of the shot allows: what fitted once still fits, so that nothing jumps. */
  #fitView(low, high) {
    const corner = new this.THREE.Vector3();
    if (this.shot !== this.review.a.about) Object.assign(this, { shot: this.review.a.about, reach: { x: 0, y: 0 } });
    for (let i = 0; i < 8; i++) {
      corner.set(...[0, 1, 2].map((axis) => (i >> axis & 1 ? high : low)[axis])).applyMatrix4(this.camera.matrixWorldInverse);
      this.reach.x = Math.max(this.reach.x, Math.abs(corner.x / corner.z));
      this.reach.y = Math.max(this.reach.y, Math.abs(corner.y / corner.z));
    }
    this.widen(2.08 * Math.max(this.reach.y, this.reach.x / this.camera.aspect));
  }

  /** Lines grow faint where they would cover all. */
  #inkLines() {
    const edge = this.review.a.about.mean_edges[this.shownNumber] ?? 0, tall = this.orbit.slope * this.orbit.distance;
    const pixels = (edge / tall) * this.canvas.clientHeight * devicePixelRatio;
    for (const lines of this.shown.lined) {
      lines.visible = this.lines;
      lines.material.opacity = clamp(pixels / 20, 0.14, 0.6);
    }
  }

  render() {
    if (!this.shown) return;
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

/** Matt grey, and the lines of triangles. */
function clayMaterials(THREE) {
  const clay = new THREE.MeshStandardMaterial({
    color: 0xb4b4b4, roughness: 0.72, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  });
  return [clay, new THREE.MeshBasicMaterial({ color: 0x111111, wireframe: true, transparent: true, opacity: 0.5 })];
}

/** A simulated frame: its surfaces, and its clouds as balls. Positions are in steps from the lowest corner. */
class StillMeshes {
  constructor(THREE, data, number) {
    Object.assign(this, { data, number, group: new THREE.Group(), lined: [] });
    this.group.position.set(...data.low);
    this.group.scale.setScalar(data.step);
    const values = (text, Kind, size, normalized) => new THREE.BufferAttribute(decoded(text, Kind), size, normalized);
    const placed = (text) => new THREE.BufferGeometry().setAttribute("position", values(text, Uint16Array, 3));
    if (data.faces) {
      const geometry = placed(data.positions).setAttribute("normal", values(data.normals, Int8Array, 3, true));
      const [clay, wire] = clayMaterials(THREE);
      geometry.setIndex(values(data.faces, data.wide ? Uint32Array : Uint16Array, 1));
      this.lined = [new THREE.Mesh(geometry, wire)];
      this.group.add(new THREE.Mesh(geometry, clay), ...this.lined);
    }
    if (data.points) {
      const geometry = placed(data.centres).setAttribute("radius", values(data.radii, Float32Array, 1));
      this.group.add(new THREE.Points(geometry, ballMaterial(THREE)));
    }
    const kinds = [[data.triangles, "triangles"], [data.points, "points"]].filter(([size]) => size);
    this.what = kinds.map(([size, kind]) => `${count(size)} ${kind}`).join(" and ");
  }

  show() { return this.number; }

  box() { return this.data; }

  dispose() { this.group.traverse((each) => each.geometry?.dispose()); }
}

/** All frames: poses, between which vertices move on straight lines. It is kept, for going back to it. */
class MovingMesh {
  /** Takes a GLB whose morph targets are blended two at a time. */
  constructor(THREE, { scene, animations }, first, fps) {
    Object.assign(this, { THREE, first, fps, group: scene, lined: [] });
    this.last = first + Math.round((animations[0]?.duration ?? 0) * fps);
    scene.updateMatrixWorld(true);
    const meshes = [], tracks = animations[0]?.tracks ?? [];
    scene.traverse((each) => each.isMesh && meshes.push(each));
    this.parts = meshes.map((mesh) => this.#part(mesh, tracks.find(({ name }) => name === `${mesh.name}.morphTargetInfluences`)));
    const triangles = meshes.reduce((sum, { geometry }) => sum + geometry.index.count / 3, 0);
    this.what = `${count(triangles)} triangles, one mesh in all frames`;
  }

  #part(mesh, track) {
    const { THREE } = this, { geometry } = mesh, { position = [], normal = [] } = geometry.morphAttributes;
    const blend = { value: new THREE.Vector2() };
    geometry.morphAttributes = {};  // blended below: three.js would keep all targets as floats on the graphics card
    mesh.updateMorphTargets();
    const [clay, wire] = clayMaterials(THREE).map((material) => blended(material, blend));
    const lines = new THREE.Mesh(geometry, wire);
    mesh.material = clay;
    mesh.add(lines);
    for (const each of [mesh, lines]) each.frustumCulled = false;
    this.lined.push(lines);
    const rest = geometry.attributes.position, boxes = [null, ...position].map((target) => boxOf(THREE, rest, target, mesh.matrixWorld));
    return { geometry, blend, position, normal, boxes, weights: track?.createInterpolant() };
  }

  /** Show a frame, or the nearest of the motion; return its number. */
  show(frame) {
    const number = this.#nearest(frame);
    for (const part of this.parts) {
      if (!part.position.length) continue;
      const [one, other] = this.#blend(part, number);
      for (const [name, [index]] of [["One", one], ["Other", other]]) {
        part.geometry.setAttribute(`place${name}`, part.position[index]);
        part.geometry.setAttribute(`normal${name}`, part.normal[index]);
      }
      part.blend.value.set(one[1], other[1]);
    }
    return number;
  }

  #nearest(frame) { return clamp(frame, this.first, this.last); }

  /** The two targets of a frame that count, each with its weight. */
  #blend({ weights, position }, number) {
    const all = Array.from(weights?.evaluate((number - this.first) / this.fps) ?? []);
    const used = all.map((weight, index) => [index, weight]).filter(([, weight]) => weight);
    const unused = [Math.min(used[0]?.[0] ?? 0, position.length - 1), 0];
    return [used[0] ?? unused, used[1] ?? unused];
  }

  /** The lowest and highest corner of everything in a frame, and of the poses that it lies between. */
  box(frame) {
    const all = new this.THREE.Box3();
    for (const part of this.parts) {
      const used = part.position.length ? this.#blend(part, this.#nearest(frame)).filter(([, weight]) => weight) : [];
      const shares = used.reduce((sum, [, weight]) => sum + weight, 0);
      if (shares < 1) all.union(part.boxes[0]);
      for (const [index] of used) all.union(part.boxes[index + 1]);
    }
    return { low: all.min.toArray(), high: all.max.toArray() };
  }
}

/** The bounds of positions, with what a morph target adds to them. */
function boxOf(THREE, rest, target, matrix) {
  const box = new THREE.Box3(), place = new THREE.Vector3(), change = new THREE.Vector3();
  for (let i = 0; i < rest.count; i++) {
    place.fromBufferAttribute(rest, i);
    if (target) place.add(change.fromBufferAttribute(target, i));
    box.expandByPoint(place);
  }
  return box.applyMatrix4(matrix);
}

/** A material whose vertices are those at rest, with two targets by their weights. */
function blended(material, blend) {
  material.onBeforeCompile = (shader) => {
    shader.uniforms.blend = blend;
    shader.vertexShader = `uniform vec2 blend; attribute vec3 placeOne, placeOther, normalOne, normalOther;\n${shader.vertexShader}`
      .replace("#include <begin_vertex>", "vec3 transformed = position + blend.x * placeOne + blend.y * placeOther;")
      .replace("#include <beginnormal_vertex>", "vec3 objectNormal = normalize(normal + blend.x * normalOne + blend.y * normalOther);");
  };
  material.customProgramCacheKey = () => `blended ${material.type}`;
  return material;
}
