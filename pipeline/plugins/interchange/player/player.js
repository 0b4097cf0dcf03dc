// The sculpture: keyframes between which vertices move on straight lines, lit as in the shot's pictures.

const REACH = 2.6, TALL = 3; // stage units around the sculpture where shadows are drawn, and how long they get

/** The share of a light that comes past the sculpture: percentage-closer soft shadows (Fernando, 2005).
 *
 * A light's shadow has in `intensity` how far blockers are looked for, in `radius` the width of half-shadows by
 * the difference of depths between surface and blocker; both in shares of the map. For lights of perspective
 * too that width is linear in this difference, as depths of maps go by one over the distance. */
const SOFT_SHADOW = `
  vec2 inDisc(int k, int count, float turn) {
    float angle = 2.39996323 * float(k) + turn;
    return sqrt((float(k) + 0.5) / float(count)) * vec2(cos(angle), sin(angle));
  }
  float getShadow(sampler2D map, vec2 size, float reach, float bias, float width, vec4 place) {
    vec3 at = place.xyz / place.w;
    vec3 across = dFdx(at), down = dFdy(at);
    float area = across.x * down.y - across.y * down.x;  // how depth changes over the map, on this surface
    vec2 slope = vec2(down.y * across.z - across.y * down.z, across.x * down.z - down.x * across.z);
    slope = abs(area) < 1e-12 ? vec2(0.0) : clamp(slope / area, -4.0, 4.0);
    at.z += bias;
    if (min(at.x, at.y) < 0.0 || max(at.x, at.y) > 1.0 || at.z > 1.0) return 1.0;
    float turn = 6.28318531 * fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    float blockers = 0.0, depths = 0.0;
    for (int k = 0; k < 10; k++) {
      vec2 offset = reach * inDisc(k, 10, turn);
      float depth = unpackRGBAToDepth(texture2D(map, at.xy + offset));
      if (depth < at.z + dot(slope, offset)) { blockers += 1.0; depths += depth; }
    }
    if (blockers == 0.0 || blockers == 10.0) return 1.0 - blockers / 10.0;
    float radius = clamp(width * (at.z - depths / blockers), 1.5 / size.x, reach), open = 0.0;
    for (int k = 0; k < 20; k++) {
      vec2 offset = radius * inDisc(k, 20, turn);
      open += step(at.z + dot(slope, offset), unpackRGBAToDepth(texture2D(map, at.xy + offset)));
    }
    return open / 20.0;
  }
`;

class Player extends ShotView {
  constructor({ THREE }) {
    const chunks = THREE.ShaderChunk;
    const [before, , after] = chunks.shadowmap_pars_fragment.split(/(?=float getShadow\(|vec2 cubeToUV\()/);
    chunks.shadowmap_pars_fragment = before + SOFT_SHADOW + after;
    super(THREE, new THREE.WebGLRenderer({ canvas: id("view"), antialias: false, powerPreference: "high-performance" }));
    Object.assign(this.renderer.shadowMap, { enabled: true, type: THREE.PCFShadowMap, autoUpdate: false });
    this.renderer.toneMapping = THREE.NoToneMapping;
    this.scene.background = new THREE.Color(0, 0, 0);
    this.set = new THREE.Group(); // floor and lights, which follow the sculpture
    this.scene.add(this.set);
    this.blend = { value: 0 };
    this.images = new Map(); // decoded pictures, by the number of their blob
    this.follows = facts.cameras.every(Boolean);
  }

  async build() {
    await this.#buildView();
    await this.#buildStage();
    this.#buildLights();
    this.#buildSurroundings();
    this.sculptures = [];
    for (const part of facts.parts) this.sculptures.push(await this.#sculpture(part));
    this.show(facts.numbers[0] + facts.dissolve);
    if (!this.follows) this.#standBack();
    whenResized(this.canvas, () => this.resize());
    this.resize();
  }

  // The view of the shot: light, rendered to a texture, becomes display values by a table of colours.

  async #buildView() {
    const { THREE } = this, view = facts.view;
    const table = new THREE.Data3DTexture(await bytesOf(view.table), view.side, view.side, view.side);
    Object.assign(table, { minFilter: THREE.LinearFilter, magFilter: THREE.LinearFilter, needsUpdate: true });
    const target = () => new THREE.WebGLRenderTarget(1, 1, { type: THREE.HalfFloatType, samples: 4 });
    this.light = target();
    this.beginning = facts.dissolve ? target() : this.light; // what the end of a loop dissolves into
    this.weight = { value: 0 };
    this.screen = new THREE.Scene();
    const material = new THREE.ShaderMaterial({
      uniforms: {
        light: { value: this.light.texture }, beginning: { value: this.beginning.texture }, weight: this.weight, table: { value: table }, side: { value: view.side },
        toe: { value: view.toe }, white: { value: view.white }, gain: { value: 2 ** view.exposure },
      },
      vertexShader: "varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }",
      fragmentShader: `
        precision highp sampler3D;
        uniform sampler2D light, beginning; uniform sampler3D table; uniform float side, toe, white, gain, weight;
        varying vec2 at;
        vec3 shown(vec3 light) {
          vec3 place = log2(1.0 + clamp(gain * light, 0.0, white) / toe) / log2(1.0 + white / toe);
          return texture(table, (place * (side - 1.0) + 0.5) / side).rgb;
        }
        void main() {
          vec3 colour = shown(texture2D(light, at).rgb);
          if (weight > 0.0) colour = mix(colour, shown(texture2D(beginning, at).rgb), weight);
          float grain = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715)))) - 0.5;
          gl_FragColor = vec4(colour + grain / 255.0, 1.0);
        }`,
      depthTest: false,
    });
    this.screen.add(new THREE.Mesh(new THREE.PlaneGeometry(2, 2), material));
    this.flat = new THREE.OrthographicCamera();
  }

  // Floor and lights, in stage units.

  async #buildStage() {
    const { THREE } = this;
    this.floors = [];
    if (!facts.stage) return;
    for (const numbers of facts.stage.meshes) {
      const [points, normals, colours, sent, faces] = await Promise.all(numbers.map(bytesOf));
      const geometry = new THREE.BufferGeometry();
      const channels = (3 * colours.length) / points.length;  // 4 where the horizon fades
      const floats = (bytes, size = 3) => new THREE.BufferAttribute(new Float32Array(bytes.buffer), size);
      geometry.setAttribute("position", floats(points)).setAttribute("normal", floats(normals)).setAttribute("color", floats(colours, channels));
      geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(faces.buffer), 1));
      const shown = { vertexColors: true, side: THREE.DoubleSide, transparent: channels === 4 }, clearcoatRoughness = facts.stage.roughness;
      const shines = { ...shown, roughness: 1, specularIntensity: 0, clearcoat: 1, clearcoatRoughness };
      const material = clearcoatRoughness === null ? new THREE.MeshLambertMaterial(shown) : this.#lit(new THREE.MeshPhysicalMaterial(shines));
      this.set.add(Object.assign(new THREE.Mesh(geometry, material), { receiveShadow: true }));
      const sends = geometry.clone().setAttribute("color", floats(sent, channels));
      this.floors.push(new THREE.Mesh(sends, new THREE.MeshBasicMaterial(shown)));
    }
  }

  #buildLights() {
    const { THREE } = this, { lights } = facts;
    this.spots = lights.spots.map((spot) => {
      const light = new THREE.SpotLight(new THREE.Color(...spot.power));
      Object.assign(light, { userData: spot, angle: 1.5, penumbra: 1, decay: 2, castShadow: spot.casts });
      light.position.set(...spot.position);
      light.target.position.set(...spot.target);
      light.shadow.mapSize.set(1024, 1024);
      light.shadow.bias = -0.001;
      this.set.add(light, light.target);
      return light;
    });
    this.suns = [];
    for (const sun of lights.suns) this.#distant(sun.irradiance, 1, sun.direction, 2048, 0.01);
    const { zenith, horizon, nadir } = lights.sky;
    const below = lights.ground.map((value, k) => Math.max(0.7 * value, facts.stage ? 0 : nadir[k]));
    const above = zenith.map((value, k) => (value + horizon[k]) / 2);
    this.scene.add(new THREE.HemisphereLight(new THREE.Color(...above), new THREE.Color(...below), 0.75 * Math.PI));
    for (const [x, z] of [[-0.7, -0.4], [0.7, -0.4], [0, 0.8]]) { // the rest of the sky, whose shadows are soft
      this.#distant(above, Math.PI / 10, [-x, -1, -z], 256, 0.5);
    }
    if (lights.shows_sky) this.set.add(this.#sky(800));
  }

  /** Adds light from a direction and around it by the tangent of an angle; it casts shadows. */
  #distant(colour, intensity, direction, side, spread) {
    const { THREE } = this, light = new THREE.DirectionalLight(new THREE.Color(...colour), intensity);
    light.userData = { direction: new THREE.Vector3(...direction).normalize(), spread };
    light.castShadow = true;
    light.shadow.mapSize.set(side, side);
    this.suns.push(light);
    this.scene.add(light, light.target);
  }

  #sky(radius) {
    const { THREE } = this, { zenith, horizon, nadir } = facts.lights.sky;
    const vector = (colour) => ({ value: new THREE.Vector3(...colour) });
    return new THREE.Mesh(new THREE.SphereGeometry(radius, 32, 32), new THREE.ShaderMaterial({
      uniforms: { zenith: vector(zenith), horizon: vector(horizon), nadir: vector(nadir) },
      vertexShader: "varying vec3 at; void main() { at = position; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }",
      fragmentShader: `
        uniform vec3 zenith, horizon, nadir; varying vec3 at;
        void main() {
          float height = normalize(at).y;
          gl_FragColor = vec4(mix(horizon, height > 0.0 ? zenith : nadir, abs(height)), 1.0);
        }`,
      side: THREE.BackSide, depthWrite: false,
    }));
  }

  /** What surfaces reflect: softboxes, sky and floor, seen from the sculpture. */
  #buildSurroundings() {
    const { THREE } = this, around = new THREE.Scene();
    around.add(this.#sky(90));
    for (const floor of this.floors) around.add(floor);
    for (const box of facts.lights.boxes) {
      const material = new THREE.MeshBasicMaterial({ color: new THREE.Color(...box.radiance) });
      const quad = new THREE.Mesh(new THREE.PlaneGeometry(box.width, box.height), material);
      quad.position.set(...box.position);
      quad.lookAt(...box.target);
      around.add(quad);
    }
    const generator = new THREE.PMREMGenerator(this.renderer), position = new THREE.Vector3(0, 1, 0);
    this.scene.environment = generator.fromScene(around, 0, 0.01, 100, { size: 512, position }).texture;
    generator.dispose();
  }

  // The sculptures.

  async #sculpture(part) {
    const { THREE } = this, count = part.vertices;
    const [faces, positions, normals] = await Promise.all([part.faces, part.positions, part.normals].map(bytesOf));
    const geometry = new THREE.BufferGeometry();
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(summed(faces, 3 * part.triangles, Int32Array)[0].buffer), 1));
    const attributes = (all, normalized) => all.map((rows) => new THREE.InterleavedBufferAttribute(new THREE.InterleavedBuffer(rows, 4), 3, 0, normalized));
    if (part.colours !== null) {
      const colours = new Uint16Array((await bytesOf(part.colours)).buffer);
      geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3, true));
    }
    if (part.texture !== null) {
      geometry.setAttribute("uv", new THREE.BufferAttribute(new Float32Array((await bytesOf(part.texture)).buffer), 2));
    }
    const materials = [];
    for (const look of part.materials) materials.push(this.#moving(this.#lit(await this.#material(look), part.closed), part.closed));
    for (const [start, indices, number] of part.groups) geometry.addGroup(start, indices, number);
    const mesh = new THREE.Mesh(geometry, part.groups.length ? materials : materials[0]);
    mesh.customDepthMaterial = this.#moving(new THREE.MeshDepthMaterial({ depthPacking: THREE.RGBADepthPacking, side: THREE.DoubleSide }));
    mesh.customDepthMaterial.alphaHash = materials.some((each) => each.transparent); // shadows of fractions
    Object.assign(mesh, { castShadow: true, receiveShadow: true, frustumCulled: false });
    mesh.position.set(...part.centre);
    mesh.scale.setScalar(part.step);
    this.scene.add(mesh);
    return {
      mesh, geometry, numbers: part.numbers,
      positions: attributes(poses(positions, count, 3), false),
      normals: attributes(poses(normals, count, 2).map((rows) => unfold(rows, part.fold)), true),
    };
  }

  /** A picture that covers a surface, and what shows beyond its sides; for black it is the border. */
  async #picture([type, number, across, up], colorSpace) {
    const { THREE } = this;
    const wraps = { repeat: THREE.RepeatWrapping, mirror: THREE.MirroredRepeatWrapping };
    const [wrapS, wrapT] = [across, up].map((mode) => wraps[mode] ?? THREE.ClampToEdgeWrapping);
    if (!this.images.has(number)) {
      const content = new Blob([await bytesOf(number)], { type });
      const asStored = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
      this.images.set(number, await createImageBitmap(content, asStored));
    }
    const anisotropy = this.renderer.capabilities.getMaxAnisotropy();
    return Object.assign(new THREE.Texture(this.images.get(number)), { wrapS, wrapT, flipY: false, colorSpace, anisotropy, needsUpdate: true });
  }

  async #material(look) {
    const { THREE } = this;
    const picture = async (about, space) => about && this.#picture(about, space);
    const map = await picture(look.map, THREE.SRGBColorSpace), numbers = await picture(look.numbers, THREE.NoColorSpace);
    const normals = await picture(look.normals, THREE.NoColorSpace);
    const material = new THREE.MeshPhysicalMaterial({
      map, roughnessMap: numbers, metalnessMap: numbers, normalMap: normals,
      normalScale: new THREE.Vector2(look.bump, -look.bump), // its green is up, and coordinates go down
      color: new THREE.Color(...look.colour), vertexColors: look.is_coloured, roughness: look.roughness, metalness: look.metallic,
      clearcoat: look.clearcoat, clearcoatRoughness: 0.03, ior: Math.max(look.refraction, 1), specularIntensity: look.is_matt ? 0 : 1,
      side: THREE.DoubleSide, shadowSide: THREE.DoubleSide,
    });
    // Faces of fractions lie over each other from back to front, at least those of both sides.
    const blending = look.cutoff == null ? { transparent: true, alphaTest: 0.01 } : { alphaTest: look.cutoff };
    if (look.is_cut_out) Object.assign(material, { opacity: look.opacity, ...blending });
    if (look.is_clear) Object.assign(material, { transmission: 1, thickness: facts.placements[0][3] });
    if (look.is_smoke) Object.assign(material, { transparent: true, opacity: 2 * look.opacity, depthWrite: false });
    return material;
  }

  /** Takes matt light from lights and sky, and reflections from the surroundings alone: these hold the lights. */
  #lit(material, closed) {
    const { THREE } = this;
    // Slivers may be turned over by rounding: where nobody sees the inside, normals stay as they are.
    const normal = THREE.ShaderChunk.normal_fragment_begin.replace("gl_FrontFacing ? 1.0 : - 1.0", "1.0");
    const direct = THREE.ShaderChunk.lights_physical_pars_fragment
      .replace("reflectedLight.directSpecular += irradiance * BRDF_GGX(", "reflectedLight.directSpecular += 0.0 * BRDF_GGX(")
      .replace("clearcoatSpecularDirect += ccIrradiance * ", "clearcoatSpecularDirect += 0.0 * ");
    const around = THREE.ShaderChunk.lights_fragment_maps.replace("iblIrradiance += getIBLIrradiance( geometryNormal );", "");
    // Normal maps are made for unit tangents along the texture's rows, however it is stretched.
    const tangents = THREE.ShaderChunk.normalmap_pars_fragment.replace(/float det = max[^]*?return mat3[^;]*;/, `
      vec3 right = normalize(cross(B, N) + 1e-20), up = cross(N, right);
      return mat3(dot(right, T) < 0.0 ? -right : right, dot(up, B) < 0.0 ? -up : up, N);`);
    material.onBeforeCompile = (shader) => {
      shader.fragmentShader = shader.fragmentShader
        .replace("#include <normalmap_pars_fragment>", tangents)
        .replace("#include <lights_physical_pars_fragment>", direct)
        .replace("#include <lights_fragment_maps>", around);
      if (closed) shader.fragmentShader = shader.fragmentShader.replace("#include <normal_fragment_begin>", normal);
    };
    return material;
  }

  /** Blends positions and normals with those of the next keyframe. */
  #moving(material, closed) {
    const before = material.onBeforeCompile;
    material.onBeforeCompile = (shader, renderer) => {
      before.call(material, shader, renderer);
      shader.uniforms.blend = this.blend;
      shader.vertexShader = `uniform float blend; attribute vec3 nextPosition; attribute vec3 nextNormal;\n${shader.vertexShader}`
        .replace("#include <beginnormal_vertex>", "vec3 objectNormal = normalize(mix(normal, nextNormal, blend));")
        .replace("#include <begin_vertex>", `vec3 transformed = mix(position, nextPosition, blend);
          #ifdef USE_ALPHAHASH
            vPosition = position;
          #endif`);
    };
    material.customProgramCacheKey = () => `moving ${material.type} ${closed}`;
    return material;
  }

  // Time.

  /** Show a frame, also between two whole ones. */
  show(number) {
    this.number = number;
    this.#pose(number);
    this.stale = true;
  }

  /** Move sculptures, lights and, if it follows, the shot's camera to a frame. */
  #pose(number) {
    this.posed = number;
    for (const { geometry, numbers, positions, normals, mesh } of this.sculptures) {
      const [k, next, share] = poseAt(numbers, number);
      geometry.setAttribute("position", positions[k]);
      geometry.setAttribute("normal", normals[k]);
      geometry.setAttribute("nextPosition", positions[next]);
      geometry.setAttribute("nextNormal", normals[next]);
      mesh.onBeforeRender = mesh.onBeforeShadow = () => (this.blend.value = share);
      this.blend.value = share;
    }
    const [x, y, z, size, turn] = mixed(facts.placements, number);
    this.set.position.set(x, y, z);
    this.set.scale.setScalar(size);
    this.set.rotation.y = turn;
    this.scene.environmentRotation.y = turn;
    this.set.updateMatrixWorld(true);
    this.#aimLights(size);
    if (this.follows) {
      this.aim(number);
      this.orbit.point(this.camera);
    }
    this.renderer.shadowMap.needsUpdate = true;
  }

  #aimLights(size) {
    for (const light of this.spots) {
      const { position, radius } = light.userData, distance = Math.hypot(position[0], position[1] - 1, position[2]), { camera } = light.shadow;
      light.intensity = size ** 2;
      Object.assign(camera, { near: Math.max(distance - 4, 0.1) * size, far: (distance + 6) * size });
      light.shadow.focus = Math.atan(REACH / distance) / light.angle;
      const width = (radius * distance) / (2 * REACH); // of the light, in shares of a map at a distance of 1
      light.shadow.radius = (width * size * (camera.far - camera.near)) / (camera.far * camera.near);
      light.shadow.intensity = Math.min((width * TALL) / (distance * (distance + TALL / 2)), 0.2);
    }
    const middle = this.set.localToWorld(new this.THREE.Vector3(0, 1, 0));
    for (const light of this.suns) {
      const { direction, spread } = light.userData, { camera } = light.shadow, reach = REACH * size;
      light.position.copy(direction).multiplyScalar(-10 * size).add(middle);
      light.target.position.copy(middle);
      Object.assign(camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.1 * size, far: 20 * size });
      light.shadow.radius = (spread * 19.9) / (2 * REACH);
      light.shadow.intensity = Math.min((spread * TALL) / (2 * REACH), 0.2);
    }
    for (const { shadow } of [...this.spots, ...this.suns]) {
      shadow.normalBias = 0.035 * size;
      shadow.camera.updateProjectionMatrix();
    }
  }

  // Cameras.

  aim(number = this.number) {
    const [x, y, z, a, b, c, up, over, away, angle] = mixed(facts.cameras, number);
    this.#fit(angle);
    this.orbit.view = { position: [x, y, z], target: [a, b, c], up: [up, over, away] };
  }

  /** All of the shot's picture is seen, whatever the shape of the window. */
  #fit(angle) {
    this.angle = angle;
    this.widen((2 * Math.tan(angle / 2)) / Math.min(facts.aspect, this.camera.aspect));
  }

  #standBack() {
    const [x, y, z, size] = facts.placements[0];
    this.#fit(0.6);
    this.orbit.view = { position: [x, y + 1.4 * size, z + 6 * size], target: [x, y + size, z], up: [0, 1, 0] };
    this.look();
  }

  // Drawing.

  resize() {
    super.resize();
    this.#fit(this.angle);
    const size = this.renderer.getDrawingBufferSize(new this.THREE.Vector2());
    for (const target of [this.light, this.beginning]) target.setSize(size.x, size.y);
  }

  /** What is seen has changed; it is drawn soon. */
  render() { this.stale = true; }

  draw() {
    if (!this.stale) return;
    this.stale = false;
    // As in the movie: the last frames of a dissolve are mixed with the first, by display values.
    const into = this.number - facts.numbers.at(-1) + facts.dissolve;
    this.weight.value = facts.dissolve ? Math.max(into / (facts.dissolve + 1), 0) : 0;
    if (this.weight.value > 0) this.#renderTo(this.beginning, facts.numbers[0] + into - 1);
    this.#renderTo(this.light, this.number);
    this.renderer.setRenderTarget(null);
    this.renderer.render(this.screen, this.flat);
  }

  #renderTo(target, number) {
    if (this.posed !== number) this.#pose(number);
    this.camera.near = 0.05 * this.orbit.distance; // depths stay precise
    this.camera.far = 1200 * this.set.scale.x;
    this.camera.updateProjectionMatrix();
    this.renderer.setRenderTarget(target);
    this.renderer.render(this.scene, this.camera);
  }
}
