"""`python -m benchmarks.animated_files FILE …`: animations of glTF and FBX files against three.js.

three.js 0.187 from npm evaluates each animation of each file at five times, in node and without pictures. Its
quaternions are made of unit length first, as glTF requires (quantized ones are not quite), and turn on arcs,
as glTF says, where three.js takes chords between keys less than 3.6° apart. The path of each vertex through
the five times is compared with the nearest of the other: `error` is the largest distance, and `moves` how far
a vertex goes, both over the diagonal of the first time. Of FBX the times are frames, where keys are, since
three.js goes from key to key on straight lines. Prints a table; writes `benchmarks/out/animated_files.json`.
"""

from __future__ import annotations

import base64
import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from benchmarks.report import Row, keep, show
from flowsculpt import FlowsculptError
from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.mesh.mesh_formats import MovingSurface, ScenePart
from flowsculpt.pipeline.mesh.read import ModelFile

THREE = "three@0.187.0"

PLACE = Path(sys.prefix) / "node_three"

SHARES = (0.0, 0.23, 0.5, 0.77, 1.0)
"""Times that are compared, over the length of an animation."""

_EVALUATE = """
globalThis.self = globalThis.window = globalThis;
globalThis.ProgressEvent ??= class extends Event {};
globalThis.document = {createElementNS: () => ({addEventListener() {}, removeEventListener() {}, style: {}})};
console.warn = console.error = console.log = () => {};
const THREE = await import('three');
const {GLTFLoader} = await import('three/addons/loaders/GLTFLoader.js');
const {FBXLoader} = await import('three/addons/loaders/FBXLoader.js');
const {MeshoptDecoder} = await import('three/addons/libs/meshopt_decoder.module.js');
const fs = await import('fs');
const chunks = [];
for await (const chunk of process.stdin) chunks.push(chunk);
const job = JSON.parse(Buffer.concat(chunks).toString());
let scene, clips;
if (job.gltf) {
  await MeshoptDecoder.ready;
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
  const loaded = await loader.parseAsync(JSON.stringify(job.gltf), '');
  [scene, clips] = [loaded.scene, loaded.animations];
} else {
  const file = fs.readFileSync(job.fbx);
  scene = new FBXLoader().parse(file.buffer.slice(file.byteOffset, file.byteOffset + file.length), '');
  clips = scene.animations;
}
scene.traverse(each => each.quaternion.normalize());
THREE.Quaternion.slerpFlat = (to, at, one, i, other, j, t) => {  // three.js takes chords below 3.6 degrees
  const dot = [0, 1, 2, 3].reduce((sum, k) => sum + one[i + k] * other[j + k], 0), sign = dot < 0 ? -1 : 1;
  const angle = Math.acos(Math.min(Math.abs(dot), 1)), small = angle < 1e-6;
  const a = small ? 1 - t : Math.sin((1 - t) * angle) / Math.sin(angle);
  const b = small ? t : Math.sin(t * angle) / Math.sin(angle);
  for (let k = 0; k < 4; k++) to[at + k] = a * one[i + k] + b * sign * other[j + k];
};
for (const track of clips.flatMap(clip => clip.tracks)) {
  const isCubic = track.createInterpolant.isInterpolantFactoryMethodGLTFCubicSpline;
  if (isCubic || !(track instanceof THREE.QuaternionKeyframeTrack)) continue;
  const values = Float32Array.from(track.values);  // which may be whole numbers
  for (let k = 0; k < values.length; k += 4)
    new THREE.Quaternion().fromArray(values, k).normalize().toArray(values, k);
  track.values = values;
}
const mixer = new THREE.AnimationMixer(scene);
for (const clip of clips.filter((c, k) => job.clip === null || job.clip === k || job.clip === c.name)) {
  const action = mixer.clipAction(clip);
  action.setLoop(THREE.LoopOnce);
  action.clampWhenFinished = true;
  action.play();
}
const point = new THREE.Vector3();
const answer = job.times.map(time => {
  mixer.setTime(time);
  scene.updateMatrixWorld(true);
  const corners = [];
  scene.traverse(mesh => {
    if (!mesh.isMesh) return;
    const index = mesh.geometry.index, count = (index ?? mesh.geometry.attributes.position).count;
    if (mesh.isSkinnedMesh) mesh.skeleton.update();
    for (let k = 0; k < count; k++) {
      mesh.getVertexPosition(index ? index.getX(k) : k, point);
      corners.push(...point.applyMatrix4(mesh.matrixWorld).toArray());
    }
  });
  return corners;
});
process.stdout.write(JSON.stringify([clips.map(clip => clip.name), answer]));
"""


def installed() -> Path:
    """Return the folder of three.js, which npm installs once."""
    if not (PLACE / "node_modules" / "three").exists():
        PLACE.mkdir(exist_ok=True)
        words = ["npm", "install", "--prefix", str(PLACE), "--no-save", "--no-audit", "--no-fund"]
        subprocess.run([*words, "--ignore-scripts", THREE], check=True, capture_output=True)
    return PLACE


def content_of(path: Path) -> dict[str, Any]:
    """Return the JSON of a glTF file with its buffers, and without its pictures and materials."""
    content, binary = path.read_bytes(), b""
    if content[:4] == b"glTF":
        end = 20 + struct.unpack("<I", content[12:16])[0]
        content, binary = content[20:end], content[end + 8 :]
    document: dict[str, Any] = json.loads(content)
    for buffer in document.get("buffers", []):
        address = buffer.get("uri")
        if address is None or not address.startswith("data:"):
            data = binary if address is None else (path.parent / unquote(address)).read_bytes()
            buffer["uri"] = f"data:application/octet-stream;base64,{base64.b64encode(data).decode()}"
    for name in ("images", "textures", "materials", "samplers"):
        document.pop(name, None)
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            primitive.pop("material", None)
            primitive.pop("extensions", None)
    return document


def reference(job: dict[str, Any]) -> tuple[list[str], list[Points]]:
    """Return the names of animations, and the corners (C, 3) of triangles at each time, by three.js."""
    words = ["node", "--input-type=module", "-e", _EVALUATE]
    ran = subprocess.run(words, cwd=installed(), input=json.dumps(job).encode(), capture_output=True)
    if ran.returncode:
        raise RuntimeError(ran.stderr.decode()[:1500])
    names, found = json.loads(ran.stdout)
    return names, [np.array(corners).reshape(-1, 3) for corners in found]


def animations_of(path: Path) -> list[tuple[str | None, int | str | None]]:
    """Return animations by their names here and how three.js has them; None for all together."""
    try:
        ModelFile(path).motion().close()
        return [(None, None)]
    except FlowsculptError as error:
        if "several animations" not in str(error):
            raise
    if path.suffix.lower() == ".fbx":
        job = {"fbx": str(path.resolve()), "times": [], "clip": None}
        return [(name, name) for name in reference(job)[0]]
    found: list[tuple[str | None, int | str | None]] = []
    for number, animation in enumerate(content_of(path)["animations"]):
        name = animation.get("name") or f"animation {number}"
        while name in [known for known, _ in found]:
            name += "'"
        found.append((name, number))
    return found


def times_of(moving: MovingSurface) -> list[float]:
    """Return the times that are compared; frames, where the file has a rate."""
    first, last = float(moving.times[0]), float(moving.times[-1])
    times = [first + share * (last - first) for share in SHARES]
    rate = moving.rate
    return times if rate is None else [min(round(time * rate) / rate, last) for time in times]


def paths_of(points: list[Points]) -> AnyArray:
    """Return the different paths (N, 3 T) of points at several times."""
    return np.unique(np.hstack(points).round(12), axis=0)


def nearest(paths: AnyArray, others: AnyArray) -> float:
    """Return how far one of some paths is at most from the nearest of others: where it is farthest."""
    return max(float(_longest(others - path).min()) for path in paths)


def _longest(differences: AnyArray) -> AnyArray:
    """Return the largest length (N,) of the vectors in each row (3 T,)."""
    return np.asarray(np.sqrt((differences.reshape(len(differences), -1, 3) ** 2).sum(axis=2)).max(axis=1))


def compared(path: Path, name: str | None, clip: int | str | None) -> Row:
    """Return the row of an animation."""
    moving = ModelFile(path, ScenePart(animation=name)).motion()
    times = times_of(moving)
    surfaces = [moving.at(time) for time in times]
    moving.close()
    is_fbx = path.suffix.lower() == ".fbx"
    job = {"fbx": str(path.resolve())} if is_fbx else {"gltf": content_of(path)}
    others = paths_of(reference({**job, "times": times, "clip": clip})[1])
    used = np.unique(surfaces[0].corners)
    own = [surface.points[used] for surface in surfaces]
    diagonal = float(np.linalg.norm(np.ptp(own[0], axis=0)))
    paths = paths_of(own)
    return {
        "file": path.name,
        "animation": name or "",
        "vertices": float(len(used)),
        "moves": max(float(np.linalg.norm(points - own[0], axis=1).max()) for points in own) / diagonal,
        "error": max(nearest(paths, others), nearest(others, paths)) / diagonal,
    }


def main() -> None:
    rows: list[Row] = []
    for path in map(Path, sys.argv[1:]):
        try:
            rows += [compared(path, name, clip) for name, clip in animations_of(path)]
        except (FlowsculptError, OSError) as error:
            rows.append({"file": path.name, "refused": str(error).partition(": ")[2]})
    show("Animations against three.js", rows)
    keep("animated_files", rows)


if __name__ == "__main__":
    main()
