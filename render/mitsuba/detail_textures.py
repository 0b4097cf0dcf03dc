"""Textures of surface detail at every sample of a picture: colours, roughness, and normals of relief.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started. Vertices have their
places as an attribute, and the rows of the matrix from present steps to steps at rest
(`pattern_textures.steps_at_rest`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from flowsculpt.render.mitsuba.pattern_textures import ROWS, fractal_noise, nearest_spot, steps_at_rest
from flowsculpt.render.scene.surface import Surface
from flowsculpt.render.scene.surface_detail import DetailLayer

PLACE = "detail_place"
"""Name of the vertex attribute (V, 3) where detail is evaluated."""

_STEP = 0.06
"""Step by which relief is differentiated, in the least size of a layer."""

_FOOTPRINT = 6e-4
"""Angle of a pixel, radians: a layer fades where its size comes near it."""

_DUST_TINT = 0.6
"""Most of the tint of a layer that a surface takes."""


def with_detail_places(surface: Surface) -> Surface:
    """Return the surface with the vertex attributes that textures of detail read. It needs rest positions."""
    rest = surface.require_rest("look has wear")
    rows = steps_at_rest(surface.vertices.astype(np.float64), rest, surface.faces)
    places = {name: rows[:, k].astype(np.float32) for k, name in enumerate(ROWS)}
    return replace(surface, attributes={**surface.attributes, **places, PLACE: rest.astype(np.float32)})


class DetailColour(mi.Texture):
    """Return a colour, darkened and tinted by layers."""

    def __init__(self, properties: Any, base: Any = None, layers: Sequence[DetailLayer] = ()) -> None:
        super().__init__(properties)
        self.base, self.layers = base, tuple(layers)

    def eval(self, si: Any, active: Any = True) -> Any:
        colour, place = mi.Color3f(self.base.eval(si, active)), _place(si, active)
        for layer in self.layers:
            if not (layer.darkness or layer.tint):
                continue
            value = _value(layer, place, si) * _fade(layer, si)
            if layer.tint is not None:
                share = dr.clip(layer.roughness / 0.45 * value, 0.0, _DUST_TINT)
                colour += share * (mi.Color3f(layer.tint) - colour)
            colour *= dr.clip(1.0 - layer.darkness * value, 0.0, 1.2)
        return dr.clip(colour, 0.0, 1.0)

    def eval_3(self, si: Any, active: Any = True) -> Any:
        return self.eval(si, active)

    def eval_1(self, si: Any, active: Any = True) -> Any:
        return mi.luminance(self.eval(si, active))

    def mean(self) -> Any:
        return mi.Float(0.4)

    def is_spatially_varying(self) -> bool:
        return True

    def to_string(self) -> str:
        return f"{type(self).__name__}[{self.layers}]"


class DetailRoughness(DetailColour):
    """Return the roughness of a base, a number or a texture, with that of layers; rooted where asked for."""

    def __init__(
        self, properties: Any, base: Any = None, layers: Sequence[DetailLayer] = (), is_rooted: bool = False
    ) -> None:
        super().__init__(properties, base, layers)
        self.is_rooted = is_rooted

    def eval_1(self, si: Any, active: Any = True) -> Any:
        place = _place(si, active)
        whole = mi.Float(self.base) if isinstance(self.base, float) else self.base.eval_1(si, active)
        for layer in self.layers:
            if layer.roughness:
                whole += layer.roughness * dr.maximum(_value(layer, place, si), 0.0) * _fade(layer, si)
        whole = dr.clip(whole, 2e-3, 1.0)
        return dr.sqrt(whole) if self.is_rooted else whole

    def eval(self, si: Any, active: Any = True) -> Any:
        return mi.Color3f(self.eval_1(si, active))


class DetailNormals(DetailColour):
    """Return the normals of the relief of layers, as colours from 0 to 1."""

    def eval(self, si: Any, active: Any = True) -> Any:
        place = _place(si, active)
        rows = [mi.Vector3f(si.shape.eval_attribute_3(f"vertex_{name}", si, active)) for name in ROWS]
        steps = []
        for axis in (si.sh_frame.s, si.sh_frame.t):
            at_rest = mi.Vector3f(*(dr.dot(row, axis) for row in rows))
            steps.append((at_rest, dr.norm(at_rest)))
        slopes = [mi.Float(0.0), mi.Float(0.0)]
        for layer in self.layers:
            if not layer.height:
                continue
            height, length = _value(layer, place, si), _STEP * min(layer.scale)
            strength = layer.height * _fade(layer, si) / length
            for k, (at_rest, stretch) in enumerate(steps):
                beyond = place + at_rest * (length / dr.maximum(stretch, 1e-12))
                slopes[k] += (_value(layer, beyond, si) - height) * strength * stretch
        normal = dr.normalize(mi.Vector3f(-slopes[0], -slopes[1], 1.0))
        return mi.Color3f(0.5 * normal + 0.5)


def detailed_colour(base: Any, layers: Sequence[DetailLayer]) -> Any:
    """Return the texture of a colour with layers over it. base: a texture, or its description"""
    return DetailColour(mi.Properties(), _texture(base), layers)


def detailed_roughness(base: Any, layers: Sequence[DetailLayer], is_rooted: bool) -> Any:
    """Return the texture of roughness with that of layers. base: a number, a texture, or its description"""
    shown = base if isinstance(base, float) else _texture(base)
    return DetailRoughness(mi.Properties(), shown, layers, is_rooted)


def detail_normals(layers: Sequence[DetailLayer]) -> Any:
    """Return the texture that a `normalmap` reads: normals of the relief of layers."""
    return DetailNormals(mi.Properties(), None, layers)


def _texture(base: Any) -> Any:
    if isinstance(base, dict) and base["type"] == "rgb":
        return mi.load_dict({"type": "srgb", "color": base["value"]})
    return mi.load_dict(base) if isinstance(base, dict) else base


def _place(si: Any, active: Any) -> Any:
    return mi.Point3f(si.shape.eval_attribute_3(f"vertex_{PLACE}", si, active))


def _fade(layer: DetailLayer, si: Any) -> Any:
    """Return the strength of a layer, 1 near and 0 where a pixel is as large as its detail."""
    away = dr.select(dr.isfinite(si.t), si.t, 0.0)
    near = dr.clip(min(layer.scale) / dr.maximum(2.0 * _FOOTPRINT * away, 1e-9) - 0.5, 0.0, 1.0)
    return near * near * (3.0 - 2.0 * near)


def _value(layer: DetailLayer, place: Any, si: Any) -> Any:
    """Return a layer at places: about 0 to 1, and of noise -1 to 1."""
    p = place / mi.Vector3f(layer.scale)
    if layer.pattern == "noise":
        return 2.0 * fractal_noise(p, layer.octaves, 7).x
    if layer.pattern == "weave":
        x, y, z = (dr.sin(2.0 * math.pi * part) for part in p)
        return 0.5 + 0.5 * dr.clip(x * y + y * z + z * x, -1.0, 1.0)
    if layer.pattern == "grooves":
        return 0.5 + 0.5 * dr.sin(2.0 * math.pi * (p.y + 1.6 * fractal_noise(place / layer.scale[0], 2, 3).x))
    if layer.pattern == "dust":
        specks = dr.clip(1.6 * fractal_noise(p, layer.octaves, 11).x + 0.3, 0.0, 1.0)
        drifts = 0.5 + 1.2 * fractal_noise(place / (18.0 * layer.scale[0]), 3, 5).x
        up = dr.clip(0.25 + 0.75 * si.n.y, 0.0, 1.0)
        return dr.clip((0.35 + specks) * drifts * up * up * 1.5, 0.0, 1.0)
    if layer.pattern == "prints":
        choice, distance = nearest_spot(mi.Point3f(p), mi.UInt32(23))
        rings = 0.5 + 0.5 * dr.sin(46.0 * distance + 5.0 * fractal_noise(3.0 * p, 2, 13).x)
        inside = dr.clip((0.42 - distance) * 9.0, 0.0, 1.0)
        return dr.select(choice < 0.55, inside * (0.25 + 0.75 * rings), 0.0)
    return _lines(p)


def _lines(p: Any) -> Any:
    """Return thin lines in three directions, each there in places: where noise is near 0."""
    total = mi.Float(0.0)
    for k in range(3):
        turned = mi.Vector3f(p.x, p.y, p.z) if k == 0 else mi.Vector3f(p[k], p[(k + 1) % 3], p[(k + 2) % 3])
        field = fractal_noise(turned + 9.7 * k, 1, 31 + k)
        there = dr.clip(3.0 * field.y, 0.0, 1.0)
        total = dr.maximum(total, there * dr.clip(1.0 - dr.abs(field.x) / 0.05, 0.0, 1.0))
    return total
