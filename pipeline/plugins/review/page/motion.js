// What the 3-D view shows: a frame as it was simulated, or all frames as one mesh.

/** Matt grey, and the lines of triangles. */
function clayMaterials(THREE) {
  const clay = new THREE.MeshStandardMaterial({
    color: 0xb4b4b4, roughness: 0.72, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
  });
  return [clay, new THREE.MeshBasicMaterial({ color: 0x111111, wireframe: true, transparent: true, opacity: 0.5 })];
}

/** A simulated frame: its surfaces, and its clouds as balls. */
class StillMeshes {
  constructor(THREE, data, number) {
    Object.assign(this, { THREE, data, number, group: new THREE.Group(), lined: [] });
    if (data.faces) {
      const geometry = this.#placed(data.positions), [clay, wire] = clayMaterials(THREE);
      geometry.setAttribute("normal", new THREE.BufferAttribute(decoded(data.normals, Int8Array), 3, true));
      geometry.setIndex(new THREE.BufferAttribute(decoded(data.faces, data.wide ? Uint32Array : Uint16Array), 1));
      this.lined = [new THREE.Mesh(geometry, wire)];
      this.group.add(new THREE.Mesh(geometry, clay), ...this.lined);
    }
    if (data.points) {
      const geometry = this.#placed(data.centres);
      geometry.setAttribute("radius", new THREE.BufferAttribute(decoded(data.radii, Float32Array), 1));
      this.group.add(new THREE.Points(geometry, ballMaterial(THREE)));
    }
    const kinds = [[data.triangles, "triangles"], [data.points, "points"]].filter(([size]) => size);
    this.what = kinds.map(([size, kind]) => `${count(size)} ${kind}`).join(" and ");
  }

  /** A geometry with positions of 16 bits over the box of the data. */
  #placed(text) {
    const { THREE, data } = this, packed = decoded(text, Uint16Array), positions = new Float32Array(packed.length);
    const steps = data.low.map((low, axis) => (data.high[axis] - low) / 65535);
    for (let i = 0; i < packed.length; i++) positions[i] = data.low[i % 3] + packed[i] * steps[i % 3];
    return new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(positions, 3));
  }

  show() { return this.number; }

  box() { return this.data; }

  dispose() { this.group.traverse((each) => each.geometry?.dispose()); }
}

/** All frames: poses, between which vertices move on straight lines. */
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

  #nearest(frame) { return Math.min(Math.max(frame, this.first), this.last); }

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

  dispose() {}  // kept, for going back to it
}

/** The bounds of positions, with what a morph target adds to them. */
function boxOf(THREE, rest, target, matrix) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < rest.count; i++) {
    for (let axis = 0; axis < 3; axis++) {
      const value = rest.getComponent(i, axis) + (target?.getComponent(i, axis) ?? 0);
      if (value < low[axis]) low[axis] = value;
      if (value > high[axis]) high[axis] = value;
    }
  }
  return new THREE.Box3(new THREE.Vector3(...low), new THREE.Vector3(...high)).applyMatrix4(matrix);
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
