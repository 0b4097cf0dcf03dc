"""`python -m examples.walker`: models and animates the walking figure of B200_walker, and writes its glTF.

The figure is made of cones with round ends that are blended, and meshed, as `people.person` is. Its bones are
the middles of the limbs; a vertex follows the bones near it. It walks in place, facing along z, one unit tall
and with its soles at y = 0: in SECONDS each foot stands for DUTY of the time, and goes backwards by STRIDE
meanwhile. So what the figure passes comes towards it by STRIDE / (DUTY × SECONDS) units a second. Writes
`shots/models/B200_walker.glb`.
"""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flowsculpt.api.meshes import Floats
from flowsculpt.pipeline.plugins.people.person import distance, surface_net
from flowsculpt.render.base.atomic_write import atomic_write

FILE = Path(__file__).parents[1] / "shots" / "models" / "B200_walker.glb"

SECONDS, KEYS = 1.25, 30
"""The length of two steps, and the number of keys in them."""

STRIDE, DUTY = 0.36, 0.6
"""Units that a foot goes backwards on the floor, and the share of the time that it is there."""

CELL = 1 / 80
"""Side of the grid's cells."""

SOLE = 0.04
"""Height of the ankles of a standing figure."""

BALL, HEEL = (0.105, SOLE + 0.006), (-0.035, SOLE + 0.006)
"""How far the ball and the heel of a foot are before the ankle, and how far below it as it walks."""

_THIGH, _SHIN = 0.225, 0.205


class Bone(NamedTuple):
    """A bone of the figure at rest.

    parent  name of the bone that it hangs on
    ends    its two ends (2, 3)
    """

    parent: str
    ends: Floats


def _bones() -> dict[str, Bone]:
    """Return the bones of the standing figure by name, parents first."""
    hip, waist, chest = (np.array([0.0, y, 0.0]) for y in (0.47, 0.55, 0.70))
    bones = {
        "pelvis": Bone("", np.array([hip, waist])),
        "spine": Bone("pelvis", np.array([waist, chest])),
        "head": Bone("spine", np.array([[0.0, 0.785, 0.004], [0.0, 0.896, 0.016]])),
    }
    for side, name in ((1.0, "left"), (-1.0, "right")):
        top = np.array([side * 0.082, SOLE + _THIGH + _SHIN, 0.0])
        knee, ankle = (np.array([side * 0.082, y, 0.0]) for y in (SOLE + _SHIN, SOLE))
        shoulder = np.array([side * 0.135, 0.70, 0.0])
        elbow, hand = np.array([side * 0.22, 0.565, 0.0]), np.array([side * 0.29, 0.425, 0.015])
        toes = np.array([side * 0.088, SOLE - 0.006, 0.085])
        bones |= {
            f"{name} thigh": Bone("pelvis", np.array([top, knee])),
            f"{name} shin": Bone(f"{name} thigh", np.array([knee, ankle])),
            f"{name} foot": Bone(f"{name} shin", np.array([ankle, toes])),
            f"{name} arm": Bone("spine", np.array([shoulder, elbow])),
            f"{name} forearm": Bone(f"{name} arm", np.array([elbow, hand])),
        }
    return bones


_RADII = {
    "spine": (0.098, 0.086),
    "head": (0.060, 0.104),
    "thigh": (0.068, 0.052),
    "shin": (0.052, 0.044),
    "foot": (0.038, 0.042),
    "arm": (0.050, 0.042),
    "forearm": (0.040, 0.054),
}
"""Radii at both ends of limbs; the pelvis is the lower end of the spine."""


def _figure(bones: dict[str, Bone]) -> tuple[Floats, np.ndarray]:
    """Return vertices (V, 3) and triangles (F, 3) of the standing figure, its soles flat."""
    limbs = []
    for name, bone in bones.items():
        if name != "pelvis":
            limbs.append(np.array([[*bone.ends.ravel(), *_RADII[name.split()[-1]]]]))
    limbs.append(np.array([[*bones["pelvis"].ends[0], *bones["spine"].ends[0], 0.088, 0.094]]))

    def field(points: Floats) -> Floats:
        return np.asarray(np.maximum(distance(points, limbs), -points[:, 1]))

    return surface_net(field, np.array([-0.4, -0.05, -0.25]), np.array([0.4, 1.08, 0.25]), CELL)


def _weights(points: Floats, bones: dict[str, Bone]) -> tuple[np.ndarray, np.ndarray]:
    """Return four bones for each vertex, uint8 (V, 4), and their weights, uint8 (V, 4), in 255ths."""
    away = np.empty((len(points), len(bones)))
    for column, (name, bone) in enumerate(bones.items()):
        start, along = bone.ends[0], bone.ends[1] - bone.ends[0]
        share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0)
        away[:, column] = np.linalg.norm(points - start - share[:, None] * along, axis=1)
        if name.split()[0] in ("left", "right"):  # a leg never pulls at the other one
            is_left = name.startswith("left")
            away[:, column] += 5.0 * np.clip((-points[:, 0] if is_left else points[:, 0]) - 0.012, 0.0, None)
    nearest = away.min(axis=1, keepdims=True)
    weights = np.exp(-(((away - nearest) / 0.026) ** 1.0))
    order = np.argsort(-weights, axis=1)[:, :4]
    found = np.take_along_axis(weights, order, axis=1)
    found = np.floor(255.0 * found / found.sum(axis=1, keepdims=True))
    found[:, 0] += 255.0 - found.sum(axis=1)
    return order.astype(np.uint8), found.astype(np.uint8)


def _foot(phase: float) -> tuple[float, float, float]:
    """Return where an ankle is along z and above the floor, and how far its toes are up, radians."""
    lift = 0.0
    if phase < DUTY:
        share = phase / DUTY
        heel, toe = max(0.0, 1.0 - share / 0.16), max(0.0, (share - 0.62) / 0.38)
        along, pitch = 0.5 - share, 0.30 * heel**2 - 0.62 * toe**2
    else:
        share = (phase - DUTY) / (1.0 - DUTY)
        along = share - math.sin(2.0 * math.pi * share) / (2.0 * math.pi) - 0.5
        pitch = 0.30 * share**2 - 0.62 * (1.0 - share) ** 2
        lift = 0.075 * math.sin(math.pi * share) ** 1.4
    before, below = BALL if pitch < 0.0 else HEEL  # the foot rolls on its ball or its heel
    forward = before * (1.0 - math.cos(pitch)) - below * math.sin(pitch)
    up = below * math.cos(pitch) - before * math.sin(pitch)
    return STRIDE * along + forward, up + lift, pitch


def _turn(axis: str, angle: float) -> Floats:
    """Return a unit quaternion (4,), x, y, z, w."""
    found = np.zeros(4)
    found["xyz".index(axis)], found[3] = math.sin(0.5 * angle), math.cos(0.5 * angle)
    return found


def _product(a: Floats, b: Floats) -> Floats:
    """Return the turn b, followed by a."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*vector, a[3] * b[3] - a[:3] @ b[:3]])


def _wave(phase: float) -> float:
    return math.cos(2.0 * math.pi * phase)


def _pose(phase: float) -> tuple[dict[str, Floats], Floats]:
    """Return turns of bones against their parents by name, and the shift of the pelvis (3,)."""
    sway, bob = _wave(phase - 0.3), _wave(2.0 * phase - 0.64)
    shift = np.array([0.016 * sway, -0.024 + 0.012 * bob, 0.0])
    turns = {
        "pelvis": _product(_turn("y", 0.16 * _wave(phase)), _turn("z", -0.05 * sway)),
        "spine": _product(_turn("y", -0.36 * _wave(phase - 0.02)), _turn("x", 0.07)),
        "head": _product(_turn("y", 0.18 * _wave(phase - 0.04)), _turn("x", -0.05 + 0.03 * bob)),
    }
    for offset, name in ((0.0, "left"), (0.5, "right")):
        at = (phase + offset) % 1.0
        forward, height, pitch = _foot(at)
        drop, reach = SOLE + _THIGH + _SHIN + shift[1] - height, forward - shift[2]
        length = min(math.hypot(drop, reach), 0.9985 * (_THIGH + _SHIN))
        hip = math.acos((_THIGH**2 + length**2 - _SHIN**2) / (2.0 * _THIGH * length))
        knee = math.pi - math.acos((_THIGH**2 + _SHIN**2 - length**2) / (2.0 * _THIGH * _SHIN))
        thigh = math.atan2(reach, drop) + hip
        turns[f"{name} thigh"] = _turn("x", -thigh)
        turns[f"{name} shin"] = _turn("x", knee)
        turns[f"{name} foot"] = _turn("x", thigh - knee - pitch)
        turns[f"{name} arm"] = _turn("x", 0.50 * _wave(at - 0.04))
        turns[f"{name} forearm"] = _turn("x", -0.42 + 0.26 * _wave(at - 0.12))
    unturned = turns["pelvis"] * np.array([-1.0, -1.0, -1.0, 1.0])
    for name in ("left thigh", "right thigh"):  # legs keep to their planes
        turns[name] = _product(unturned, turns[name])
    return turns, shift


class _Buffer:
    """Collects arrays of a glTF: its bytes, and their views and accessors."""

    def __init__(self) -> None:
        self.content = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, object]] = []

    def add(self, values: np.ndarray, kind: str, target: int | None = None, is_share: bool = False) -> int:
        """Add an array (N, …), in 255ths if it is one of shares; return the number of its accessor."""
        codes = {"uint8": 5121, "uint16": 5123, "float32": 5126}
        self.content += bytes(-len(self.content) % 4)
        view = {"buffer": 0, "byteOffset": len(self.content), "byteLength": values.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        self.content += np.ascontiguousarray(values).tobytes()
        rows = values.reshape(len(values), -1)
        accessor: dict[str, object] = {
            "bufferView": len(self.views) - 1,
            "componentType": codes[values.dtype.name],
        }
        accessor |= {"count": len(values), "type": kind, **({"normalized": True} if is_share else {})}
        if kind in ("VEC3", "SCALAR"):
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def walker() -> bytes:
    """Return the GLB of the walking figure."""
    bones = _bones()
    points, faces = _figure(bones)
    joints, weights = _weights(points, bones)
    names, buffer = list(bones), _Buffer()
    attributes = {
        "POSITION": buffer.add(points.astype(np.float32), "VEC3", 34962),
        "JOINTS_0": buffer.add(joints, "VEC4", 34962),
        "WEIGHTS_0": buffer.add(weights, "VEC4", 34962, is_share=True),
    }
    indices = buffer.add(faces.astype(np.uint16).ravel(), "SCALAR", 34963)
    starts = {name: bone.ends[0] for name, bone in bones.items()}
    inverse = np.tile(np.eye(4, dtype=np.float32), (len(bones), 1, 1))
    inverse[:, 3, :3] = [-starts[name] for name in names]
    bind = buffer.add(inverse.reshape(-1, 16), "MAT4")
    nodes: list[dict[str, object]] = []
    for name, bone in bones.items():
        children = [k for k, other in enumerate(names) if bones[other].parent == name]
        place = starts[name] - (starts[bone.parent] if bone.parent else 0.0)
        node: dict[str, object] = {"name": name, "translation": place.tolist()}
        nodes.append({**node, "children": children} if children else node)
    nodes.append({"name": "walker", "mesh": 0, "skin": 0})
    times = SECONDS * np.arange(KEYS + 1) / KEYS
    poses = [_pose(k / KEYS) for k in range(KEYS + 1)]
    clock = buffer.add(times.astype(np.float32), "SCALAR")
    shifts = np.array([starts["pelvis"] + shift for _, shift in poses], np.float32)
    tracks = [(0, "translation", buffer.add(shifts, "VEC3"))]
    for number, name in enumerate(names):
        turns = np.array([turns[name] for turns, _ in poses])
        for before, after in pairwise(range(len(turns))):
            if turns[before] @ turns[after] < 0.0:
                turns[after] *= -1.0
        tracks.append((number, "rotation", buffer.add(turns.astype(np.float32), "VEC4")))
    animation = {
        "name": "Walk",
        "samplers": [{"input": clock, "output": output} for _, _, output in tracks],
        "channels": [
            {"sampler": k, "target": {"node": node, "path": path}} for k, (node, path, _) in enumerate(tracks)
        ],
    }
    document = {
        "asset": {"version": "2.0", "generator": "flowsculpt, examples/walker.py"},
        "scene": 0,
        "scenes": [{"nodes": [0, len(bones)]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": attributes, "indices": indices}]}],
        "skins": [{"joints": list(range(len(bones))), "inverseBindMatrices": bind, "skeleton": 0}],
        "animations": [animation],
        "buffers": [{"byteLength": len(buffer.content)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    content = bytes(buffer.content) + bytes(-len(buffer.content) % 4)
    size = 12 + 8 + len(text) + 8 + len(content)
    header = b"glTF" + np.array([2, size, len(text)], "<u4").tobytes() + b"JSON"
    return header + text + np.array([len(content)], "<u4").tobytes() + b"BIN\0" + content


def main() -> None:
    with atomic_write(FILE) as draft:
        draft.write_bytes(walker())
    print(f"wrote {FILE.name}, {FILE.stat().st_size // 1024} KB")


if __name__ == "__main__":
    main()
