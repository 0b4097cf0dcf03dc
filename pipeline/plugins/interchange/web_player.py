"""Write a page that plays moving sculptures: one HTML file with three.js in it, which asks for no network.

Meshes are keyframes in whole steps, stored as differences, from frame to frame and from vertex to vertex, in
planes of low and high bytes, which deflate packs well. Light, floor, camera and view are those of the shot:
softboxes cast shadows and are seen in reflections, and light becomes display values by the shot's own view.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flowsculpt.api.files import PageFolder, disk_errors
from flowsculpt.api.frames import Framing
from flowsculpt.api.materials import LightRig, Material
from flowsculpt.api.meshes import Floats
from flowsculpt.api.pictures import Camera
from flowsculpt.api.shots import Shot
from flowsculpt.pipeline.plugins.interchange.animated_gltf import Moving, closes
from flowsculpt.pipeline.plugins.interchange.embedded_pictures import EmbeddedPicture
from flowsculpt.pipeline.plugins.interchange.exported_materials import (
    COMPACT,
    ExportedMaterial,
    exported_materials,
)
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh

PAGE = PageFolder(files("flowsculpt.pipeline.plugins.interchange") / "player")

_TABLE = 33  # colours along each side of the view's table

FOLD = 1023
"""Steps of normals from the middle of the folded octahedron to its corners."""

_FROM_HORIZON = 0.23  # share of a gradient sky's horizon in the light on level ground
_SHADOWS = 6  # the most lights that cast shadows: each is drawn into a texture of its own


def require_three_js() -> str:
    """Return the text of three.js. Raises MissingInputError where set-up has not fetched it."""
    return PAGE.three_js("no page was written")


@dataclass(frozen=True, eq=False)
class WebPage:
    """A page that plays sculptures.

    parts     the sculptures
    framings  camera and stage by frame number
    aspect    width to height of the shot's pictures
    loop      how the shot goes on from its last frame, as `RenderRequest.loop`
    """

    shot: Shot
    parts: Sequence[Moving]
    framings: Mapping[int, Framing]
    aspect: float
    loop: tuple[str, int] | None = None

    def write(self, path: Path) -> None:
        """Write the page. Raises MissingInputError without three.js, MachineError where the disk refuses."""
        blobs = _Blobs()
        script = blobs.add(require_three_js().encode())
        data = {"facts": {**self._facts(blobs), "three": script}, "blobs": blobs.packed}
        text = PAGE.in_one_file(self.shot.heading, {name: json.dumps(part) for name, part in data.items()})
        with disk_errors(path):
            path.write_text(text, encoding="utf-8")

    def _facts(self, blobs: _Blobs) -> dict[str, Any]:
        """Return what the page shows, as JSON data; large arrays are numbers of blobs."""
        picture, numbers = self.shot.picture, self.parts[0].keyframes.drawn.mesh.frames
        view = replace(picture.display, view=picture.view.for_previews()).table()
        step = (len(view.values) - 1) // (_TABLE - 1)
        table = np.ones((_TABLE, _TABLE, _TABLE, 4), np.float32)
        table[..., :3] = view.values[::step, ::step, ::step].transpose(2, 1, 0, 3)  # red varies fastest
        framed = [self.framings[number] for number in numbers]
        return {
            "title": self.shot.heading,
            "rate": float(self.shot.rate.fps),
            "numbers": list(numbers),
            "closes": closes(part.keyframes for part in self.parts),
            "loops": self.loop is not None,
            "dissolve": 0 if self.loop is None else self.loop[1],
            "meets": self._meets,
            "aspect": self.aspect,
            "cameras": [_camera(framing) for framing in framed],
            "placements": [[*f.placement.origin, f.placement.size, f.placement.turn] for f in framed],
            "lights": _lights(self.shot),
            "stage": _stage(self.shot, blobs),
            "view": {
                "table": blobs.add(np.rint(255.0 * np.clip(table, 0.0, 1.0)).astype(np.uint8)),
                "side": _TABLE,
                "toe": view.toe,
                "white": view.white,
                "exposure": picture.lights.exposure,
            },
            "parts": [_sculpture(part, blobs) for part in self.parts],
        }

    @property
    def _meets(self) -> bool:
        """True if vertices go on from the last frame to the first; a shape can return without them."""
        if self.loop is None or self.loop[0] == "dissolve":
            return False
        return all(_goes_on(part.keyframes.drawn.mesh) for part in self.parts)


def _goes_on(mesh: OneMesh) -> bool:
    """Tell whether no vertex moves much further from the last frame to the first than next to them."""
    if len(mesh.frames) < 3:
        return False
    points = [mesh.points_at(mesh.frames[place]) for place in (-2, -1, 0, 1)]
    before, seam, after = (np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(points))
    return bool(seam <= 2.0 * max(before, after))


class _Blobs:
    """Arrays of the page, deflated, in base64."""

    def __init__(self) -> None:
        self.packed: list[str] = []
        self._pictures: dict[EmbeddedPicture, int] = {}

    def picture(self, picture: EmbeddedPicture | None) -> tuple[str, int, str, str] | None:
        """Add a picture, unless it is there; return its media type, its number and its wrap."""
        if picture is None:
            return None
        if picture not in self._pictures:
            self._pictures[picture] = self.add(picture.content)
        return picture.kind, self._pictures[picture], *picture.wrap

    def add(self, content: np.ndarray | bytes) -> int:
        """Add an array, little-endian, or text; return its number."""
        held = content if isinstance(content, bytes) else np.ascontiguousarray(content).tobytes()
        self.packed.append(base64.b64encode(zlib.compress(held, 9)).decode("ascii"))
        return len(self.packed) - 1


def _camera(framing: Framing) -> list[float] | None:
    """Return position, target, up (3 each) and horizontal angle of a camera; None of a wide projection."""
    camera = framing.camera
    if not isinstance(camera, Camera):
        return None
    return [*camera.origin, *camera.target, *camera.up, camera.field_of_view]


def _sculpture(part: Moving, blobs: _Blobs) -> dict[str, Any]:
    keys, drawn = part.keyframes, part.keyframes.drawn
    colours, texture = drawn.colours, drawn.texture
    materials = exported_materials(part.look, COMPACT)
    has_pictures = any(material.has_pictures for material in materials)
    return {
        "name": part.name,
        "numbers": list(keys.numbers),
        "centre": keys.centre.tolist(),
        "step": keys.step,
        "vertices": len(drawn.source),
        "triangles": len(drawn.faces),
        "faces": blobs.add(planes(differences(drawn.faces.reshape(-1, 1)).astype("<i4"))),
        "positions": blobs.add(planes(differences(keys.places).astype("<i2"))),
        "normals": blobs.add(planes(differences(folded(keys.normals)).astype("<i2"))),
        "fold": FOLD,
        "colours": None
        if colours is None
        else blobs.add(np.rint(65535.0 * np.clip(colours, 0.0, 1.0)).astype("<u2")),
        "texture": None
        if texture is None or not has_pictures
        else blobs.add((texture * (1.0, -1.0) + (0.0, 1.0)).astype("<f4")),
        "materials": [_material(each, part.look, colours is not None, blobs) for each in materials],
        "groups": [] if drawn.materials is None else _groups(drawn.materials),
        "closed": drawn.is_closed,
    }


def differences(values: np.ndarray) -> np.ndarray:
    """Return whole numbers (K, W, 3) or (W, 1) as differences along the first and the second axis.

    The last axis stays as it is.
    """
    changed = values
    for axis in range(values.ndim - 1):
        changed = np.diff(changed, axis=axis, prepend=np.zeros_like(changed.take([0], axis=axis)))
    return changed


def planes(values: np.ndarray) -> np.ndarray:
    """Return the bytes of numbers (…, W, C), plane by plane: for each component the lowest bytes first."""
    moved = np.ascontiguousarray(np.moveaxis(values, -1, -2))
    parts = moved.view(np.uint8).reshape(*moved.shape, moved.itemsize)
    return np.ascontiguousarray(np.moveaxis(parts, -1, -2))


def folded(normals: np.ndarray) -> np.ndarray:
    """Return unit normals (…, 3) as whole numbers (…, 2) on an octahedron folded to a square of ±FOLD.

    They are right to 0.12 degrees, 0.04 on average. Bytes are to 0.4, which shows in reflections.
    Source: Cigolle et al., *A survey of efficient representations for independent unit vectors*, 2014.
    """
    length = np.maximum(np.abs(normals).sum(axis=-1, keepdims=True), 1e-9)  # vertices without area have none
    flat = normals.astype(np.float64) / length
    x_y = flat[..., :2]
    lower = (1.0 - np.abs(x_y[..., ::-1])) * np.where(x_y < 0.0, -1.0, 1.0)
    return np.rint(FOLD * np.where(flat[..., 2:] < 0.0, lower, x_y)).astype(np.int32)


def _groups(materials: np.ndarray) -> list[tuple[int, int, int]]:
    """Return runs of faces of one material (F,), ascending: first index, number of indices and material."""
    numbers, first, counts = np.unique(materials, return_index=True, return_counts=True)
    return [(3 * start, 3 * count, n) for n, start, count in np.stack([numbers, first, counts], 1).tolist()]


def _material(part: ExportedMaterial, look: Material, has_colours: bool, blobs: _Blobs) -> dict[str, Any]:
    is_coloured = part.is_coloured and has_colours
    return {
        **part.surface._asdict(),
        "colour": (1.0, 1.0, 1.0) if is_coloured else part.surface.colour,
        "is_coloured": is_coloured,
        "map": blobs.picture(part.colour),
        "numbers": blobs.picture(part.numbers),
        "normals": blobs.picture(part.normals),
        "bump": part.bump,
        "is_cut_out": part.is_cut_out,
        "cutoff": part.cutoff,
        "is_clear": look.model == "glass",
        "is_smoke": look.model == "smoke",
    }


def _stage(shot: Shot, blobs: _Blobs) -> dict[str, Any] | None:
    """Return floor, wall and plinth in stage units, with the light that they send; None without a floor."""
    picture, stage = shot.picture, shot.picture.stage
    if stage.kind == "none" or not picture.look.is_lit:
        return None
    parts = [(stage.backdrop(), stage.reflectances(fades=True))]
    if (plinth := stage.plinth()) is not None:
        parts.append((plinth, np.tile(np.array(stage.plinth_colour, np.float32), (len(plinth[0]), 1))))
    meshes = []
    for (vertices, normals, faces), colours in parts:
        sent = colours * irradiance(picture.lights, vertices, normals) / math.pi
        if stage.horizon_fade:
            there = stage.opacity_at(vertices)[:, None]
            colours, sent = np.hstack([colours, there]), np.hstack([sent, there])
        floats = [blobs.add(array.astype("<f4")) for array in (vertices, normals, colours, sent)]
        meshes.append([*floats, blobs.add(faces.astype("<u4"))])
    return {"meshes": meshes, "roughness": stage.roughness, "catches": stage.shadow_catcher}


class _Emitter(NamedTuple):
    """A softbox, or a part of one, as a point that shines like it.

    power  radiance times area, linear Rec.709
    """

    position: Floats
    towards: Floats
    power: Floats


def _emitters(lights: LightRig, index: int, across: int) -> list[_Emitter]:
    """Return a softbox, by its index, as across × across points."""
    box = lights.softboxes[index]
    position, target = np.array(box.position), np.array(box.target)
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(
        forward, (0.0, 1.0, 0.0) if math.hypot(forward[0], forward[2]) > 1e-3 else (0.0, 0.0, -1.0)
    )
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    power = np.array(box.radiance) * box.width * box.height / across**2
    offsets = (np.arange(across) + 0.5) / across - 0.5
    return [
        _Emitter(position + u * box.width * right + v * box.height * up, forward, power)
        for u in offsets
        for v in offsets
    ]


def irradiance(lights: LightRig, points: np.ndarray, normals: np.ndarray) -> Floats:
    """Return the light (N, 3) that falls on points (N, 3) of the stage with normals (N, 3), unshadowed.

    Softboxes are points in their middles; of skies the light is exact where a normal is vertical.
    """
    rig, up = lights.without_maps(), 0.5 + 0.5 * normals[:, 1:2]
    far = up * np.array(rig.sky.zenith) + (1.0 - up) * np.array(rig.sky.nadir)
    falling = math.pi * (_FROM_HORIZON * np.array(rig.sky.horizon) + (1.0 - _FROM_HORIZON) * far)
    for index in range(len(rig.softboxes)):
        for each in _emitters(rig, index, 2):
            away = each.position - points
            distance = np.linalg.norm(away, axis=1, keepdims=True)
            away = away / distance
            facing = np.maximum(np.einsum("ij,ij->i", away, normals), 0.0)[:, None]
            sent = np.maximum(-(away @ each.towards), 0.0)[:, None]
            falling += each.power * facing * sent / distance**2
    for sun in rig.suns:
        facing = np.maximum(-(normals @ np.array(sun.direction)), 0.0)[:, None]
        falling += np.array(sun.irradiance) * facing
    return np.asarray(falling)


def _lights(shot: Shot) -> dict[str, Any]:
    """Return softboxes, suns and sky in stage units, and the points that cast shadows.

    The strongest softbox is four points, each as wide as a quarter of it: the wider a light, the less true is
    a soft shadow from one depth map.
    """
    lights, stage = shot.picture.lights, shot.picture.stage
    rig = lights.without_maps()
    middle, up = np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    strength = {}
    for index, box in enumerate(rig.softboxes):
        away = np.array([box.position]) - middle
        alone = irradiance(LightRig((box,)), middle, away / np.linalg.norm(away))
        strength[index] = float(alone.sum())
    ranked = sorted(strength, key=lambda index: -strength[index])
    left = _SHADOWS - 3 if len(ranked) else 0
    spots = []
    for rank, index in enumerate(ranked):
        box, across = rig.softboxes[index], 2 if rank == 0 else 1
        radius = math.sqrt(box.width * box.height / math.pi) / across  # of a disc as large
        for each in _emitters(rig, index, across):
            spot = {"position": each.position.tolist(), "target": list(box.target), "radius": radius}
            spots.append({**spot, "power": each.power.tolist(), "casts": rank < left})
    ground = irradiance(lights, np.zeros((1, 3)), up)[0] * np.array(stage.colour) / math.pi
    return {
        "boxes": [asdict(box) for box in rig.softboxes],
        "suns": [asdict(sun) for sun in rig.suns],
        "sky": asdict(rig.sky),
        "shows_sky": lights.shows_sky,
        "spots": spots,
        "ground": (np.zeros(3) if stage.kind == "none" else ground).tolist(),
    }
