"""Our plug-ins for Mitsuba: absorption in clear bodies, brushed metal, subsurface scattering, painted models,
wide cameras.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started; the scalar variant
would call Python for every ray.

Absorption (Beer 1852, Lambert 1760) is a texture: where light reaches the surface from inside, it is
multiplied by exp(−rate · distance), exactly and without noise. The scalar variant uses Mitsuba's medium,
which samples free paths. The texture also gives back light that a rough dielectric loses, since its BSDF
leaves out scattering between microfacets: a GGX interface of roughness 0.3 loses a tenth of it at each
passage (Heitz, Hanika, d'Eon and Dachsbacher, *Multiple-scattering microfacet BSDFs with the Smith model*,
2016). Dividing the BSDF by the light that it keeps from each direction (`kept_light`) gives that light back,
as Blender's Cycles does; the scalar variant leaves the loss.

Brushed metal is an anisotropic conductor whose tangents follow the scratches. Mitsuba's tangents are constant
on each triangle, as in the scalar variant; ours turn to the vertex attribute SCRATCH_TANGENT, which triangles
interpolate, so that highlights show no triangles.

The surface over subsurface scattering is a BSDF that lets light in where the body would reflect it. The path
tracer takes a sample of DiffuseTransmission as the start of a random walk
(`flowsculpt.render.integrator.subsurface_paths`). In the scalar variant, without our path tracer, the body
reflects.

Mitsuba's normal maps take tangents that are constant on each triangle and cannot be mirrored. Ours are turned
to the tangents that vertices have (`flowsculpt.render.mitsuba.texture_coordinates`) before its `normalmap`
reads them.

The sensor of wide cameras is there since Mitsuba has no fisheye and no stereo camera.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.mitsuba.loading import RATE
from flowsculpt.render.mitsuba.texture_coordinates import MIRRORED, SCRATCH_TANGENT, TEXTURE_TANGENT
from flowsculpt.render.scene.materials import Glass
from flowsculpt.render.scene.render_camera import Projection

BRUSHED, SUBSURFACE = "flowsculpt_brushed", "flowsculpt_subsurface"
"""Names of BSDFs: brushed metal around a nested `metal`, subsurface scattering in a nested `body`."""

PAINTED = "flowsculpt_painted"
"""Name of the texture of a model with several materials."""

NORMALS = "flowsculpt_normals"
"""Name of the texture that a `normalmap` reads, around a nested tangent-space `map`."""

WIDE = "flowsculpt_wide"
"""Name of the sensor of wide cameras."""

COSINES = 32
"""Rows of the table of kept light: cosines of the angle to the normal, evenly from 0 to 1."""

_ROW_SAMPLES = 64
"""Samples of a row are the square of this."""

_COAT = 0.04
"""Reflectance of the coat along the normal (Schlick 1994), for the choice between coat and body."""

_GLOSSY, _DIFFUSE = (
    mi.BSDFContext(mi.TransportMode.Radiance, int(flags))
    for flags in (mi.BSDFFlags.Glossy, mi.BSDFFlags.Diffuse)
)


def absorbing_textures(glass: Glass, size: float) -> dict[str, Any]:
    """Return what a dielectric transmits and reflects. size: half the subject's, scene units"""
    rate = glass.absorption.rate if glass.absorption else (0.0, 0.0, 0.0)
    absorbing: dict[str, Any] = {
        "type": "flowsculpt_absorbing",
        "rate": mi.ScalarColor3f([part / size for part in rate]),
    }
    if glass.is_rough:
        gain = 1.0 / kept_light(glass.roughness, glass.refraction)
        absorbing["gain"] = mi.TensorXf(gain)
    return {
        "specular_transmittance": {**absorbing, "tint": mi.ScalarColor3f(glass.colour)},
        "specular_reflectance": {**absorbing, "tint": mi.ScalarColor3f(1.0)},
    }


@lru_cache(maxsize=16)
def kept_light(roughness: float, refraction: float) -> NDArray[np.float32]:
    """Return the fraction of light (2, COSINES) that the interface keeps, from outside and from inside."""
    bsdf = mi.load_dict(
        {"type": "roughdielectric", "alpha": roughness, "int_ior": refraction, "distribution": "ggx"}
    )
    cosines = np.linspace(0.0, 1.0, COSINES)
    cosines[0] = 0.25 / COSINES
    cosine = np.repeat(np.concatenate([cosines, -cosines]), _ROW_SAMPLES**2).astype(np.float32)
    grid = np.meshgrid(*2 * [np.arange(_ROW_SAMPLES)])
    places = (np.stack(grid, axis=-1).reshape(-1, 2) + 0.5) / _ROW_SAMPLES
    x, y = np.tile(places, (2 * COSINES, 1)).T.astype(np.float32)
    si = dr.zeros(mi.SurfaceInteraction3f, len(cosine))
    si.wi = mi.Vector3f(mi.Float(np.sqrt(1.0 - cosine**2)), 0.0, mi.Float(cosine))
    si.sh_frame = mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
    # The lobe is chosen by a number that is even on its own: the golden ratio's multiples.
    lobe = mi.Float((np.arange(len(cosine)) * 0.6180339887498949 % 1.0).astype(np.float32))
    _, weight = bsdf.sample(mi.BSDFContext(mi.TransportMode.Importance), si, lobe, mi.Point2f(x, y))
    return np.array(weight.x).reshape(2, COSINES, -1).mean(axis=2)


class Absorbing(mi.Texture):
    """Return the tint for light from outside, and times the absorption for light from inside.

    Both are multiplied by the gain (2, COSINES) of a rough surface, if there is one.
    """

    def __init__(self, properties: Any) -> None:
        super().__init__(properties)
        self.rate = mi.Color3f(properties["rate"])
        self.tint = mi.Color3f(properties["tint"])
        self.gain = mi.Float(properties["gain"].array) if "gain" in properties else None

    def traverse(self, callback: Any) -> None:
        callback.put(RATE, self.rate, mi.ParamFlags.Differentiable)

    def eval(self, si: Any, active: Any = True) -> Any:
        inside = mi.Frame3f.cos_theta(si.wi) < 0.0
        left = self.tint * dr.select(inside, dr.exp(-self.rate * si.t), 1.0)
        return left if self.gain is None else left * self._gain(mi.Frame3f.cos_theta(si.wi), active)

    def _gain(self, cosine: Any, active: Any) -> Any:
        place = dr.minimum(dr.abs(cosine), 1.0) * (COSINES - 1)
        row = dr.minimum(mi.UInt32(place), COSINES - 2)
        first = row + dr.select(cosine < 0.0, COSINES, 0)
        low, high = (dr.gather(mi.Float, self.gain, first + step, active) for step in (0, 1))
        return dr.lerp(low, high, place - row)

    def is_spatially_varying(self) -> bool:
        return True

    def to_string(self) -> str:
        return f"Absorbing[rate={self.rate}, tint={self.tint}]"


class PaintedTexture(mi.Texture):
    """Return the nested texture of the material of a model's face: one BSDF then shows all its materials.

    A nested texture is named after the vertex attribute that is 1 on its material, and one "otherwise".
    """

    def __init__(self, properties: Any) -> None:
        super().__init__(properties)
        self.parts = {name: properties[name] for name in properties if name != "otherwise"}
        self.otherwise = properties["otherwise"]

    def traverse(self, callback: Any) -> None:
        for name, part in {**self.parts, "otherwise": self.otherwise}.items():
            callback.put(name, part, mi.ParamFlags.Differentiable)

    def _select(self, method: str, si: Any, active: Any) -> Any:
        found = getattr(self.otherwise, method)(si, active)
        for name, part in self.parts.items():
            here = active & (si.shape.eval_attribute_1(f"vertex_{name}", si, active) > 0.5)
            found = dr.select(here, getattr(part, method)(si, here), found)
        return found

    def eval(self, si: Any, active: Any = True) -> Any:
        return self._select("eval", si, active)

    def eval_1(self, si: Any, active: Any = True) -> Any:
        return self._select("eval_1", si, active)

    def eval_3(self, si: Any, active: Any = True) -> Any:
        return self._select("eval_3", si, active)

    def mean(self) -> Any:
        return self.otherwise.mean()

    def is_spatially_varying(self) -> bool:
        return True

    def to_string(self) -> str:
        return f"PaintedTexture[{', '.join(self.parts)}]"


class Normals(mi.Texture):
    """Return the normals of the nested map in the frame of the surface, as colours from 0 to 1."""

    def __init__(self, properties: Any) -> None:
        super().__init__(properties)
        self.map = properties["map"]

    def traverse(self, callback: Any) -> None:
        callback.put("map", self.map, mi.ParamFlags.Differentiable)

    def eval_3(self, si: Any, active: Any = True) -> Any:
        normal = self.map.eval_3(si, active)
        right = si.to_local(mi.Vector3f(si.shape.eval_attribute_3(f"vertex_{TEXTURE_TANGENT}", si, active)))
        length = dr.norm(mi.Vector2f(right.x, right.y))
        x, y = (dr.select(length > 1e-6, part / length, 0.0) for part in (right.x, right.y))
        is_mirrored = si.shape.eval_attribute_1(f"vertex_{MIRRORED}", si, active) > 0.5
        up = dr.select(is_mirrored, -normal.y, normal.y)
        turned = mi.Color3f(normal.x * x - up * y, normal.x * y + up * x, normal.z)
        return 0.5 * turned + 0.5

    def is_spatially_varying(self) -> bool:
        return True

    def to_string(self) -> str:
        return f"Normals[{self.map}]"


class Brushed(mi.BSDF):
    """Evaluate the nested metal with its second tangent along the scratches."""

    def __init__(self, properties: Any) -> None:
        super().__init__(properties)
        self.metal = properties["metal"]
        self.m_components = [self.metal.flags(index) for index in range(self.metal.component_count())]
        self.m_flags = self.metal.flags()

    def traverse(self, callback: Any) -> None:
        callback.put("metal", self.metal, mi.ParamFlags.Differentiable)

    def sample(self, context: Any, si: Any, lobe: Any, direction: Any, active: Any = True) -> tuple[Any, Any]:
        turned, turn = self._turn(si, active)
        sampled, weight = self.metal.sample(context, turned, lobe, direction, active)
        sampled.wo = turn.to_world(sampled.wo)
        return sampled, weight

    def eval(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
        turned, turn = self._turn(si, active)
        return self.metal.eval(context, turned, turn.to_local(wo), active)

    def pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
        turned, turn = self._turn(si, active)
        return self.metal.pdf(context, turned, turn.to_local(wo), active)

    def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        turned, turn = self._turn(si, active)
        return self.metal.eval_pdf(context, turned, turn.to_local(wo), active)

    def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
        return self.metal.eval_diffuse_reflectance(si, active)

    def to_string(self) -> str:
        return f"Brushed[{self.metal}]"

    def _turn(self, si: Any, active: Any) -> tuple[Any, Any]:
        """Return the interaction with `wi` in the frame of the scratches, and that frame in `si`'s."""
        along = si.to_local(mi.Vector3f(si.shape.eval_attribute_3(f"vertex_{SCRATCH_TANGENT}", si, active)))
        length = dr.norm(mi.Vector2f(along.x, along.y))
        is_clear = length > 1e-6
        x, y = dr.select(is_clear, along.x / length, 0.0), dr.select(is_clear, along.y / length, 1.0)
        turn = mi.Frame3f(mi.Vector3f(y, -x, 0.0), mi.Vector3f(x, y, 0.0), mi.Vector3f(0.0, 0.0, 1.0))
        turned = mi.SurfaceInteraction3f(si)
        turned.wi = turn.to_local(si.wi)
        return turned, turn


class SubsurfaceBSDF(mi.BSDF):
    """Reflect by the coat of the nested body. Samples of its diffuse part go inwards."""

    def __init__(self, properties: Any) -> None:
        super().__init__(properties)
        self.body, self.has_coat = properties["body"], properties["has_coat"]
        self.m_components = [self.body.flags(index) for index in range(self.body.component_count())]
        self.m_flags = self.body.flags()

    def traverse(self, callback: Any) -> None:
        callback.put("body", self.body, mi.ParamFlags.Differentiable)

    def sample(self, context: Any, si: Any, lobe: Any, direction: Any, active: Any = True) -> tuple[Any, Any]:
        inside, weight = self.body.sample(_DIFFUSE, si, lobe, direction, active)
        inside.wo = -inside.wo
        inside.sampled_type = mi.UInt32(int(mi.BSDFFlags.DiffuseTransmission))
        if not self.has_coat:
            return inside, weight
        chance = self._coat_chance(si)
        is_coat = active & (lobe < chance)
        coat, coat_weight = self.body.sample(_GLOSSY, si, lobe, direction, is_coat)
        coat.pdf *= chance
        sampled = dr.select(is_coat, coat, inside)
        return sampled, dr.select(is_coat, coat_weight / chance, weight / (1.0 - chance))

    def eval(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.body.eval(_GLOSSY, si, wo, active) if self.has_coat else mi.Color3f(0.0)

    def pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
        if not self.has_coat:
            return mi.Float(0.0)
        return self._coat_chance(si) * self.body.pdf(_GLOSSY, si, wo, active)

    def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        return self.eval(context, si, wo, active), self.pdf(context, si, wo, active)

    def eval_diffuse_reflectance(self, si: Any, active: Any = True) -> Any:
        return self.body.eval_diffuse_reflectance(si, active)

    def to_string(self) -> str:
        return f"SubsurfaceBSDF[{self.body}]"

    def _coat_chance(self, si: Any) -> Any:
        """Return the probability with which the coat is sampled."""
        cosine = dr.clip(mi.Frame3f.cos_theta(si.wi), 0.0, 1.0)
        fresnel = _COAT + (1.0 - _COAT) * (1.0 - cosine) ** 5
        return dr.clip(fresnel / (fresnel + 0.5 * (1.0 - fresnel)), 0.1, 0.9)


class WideSensor(mi.Sensor):
    """Sample rays by the formulas of `Projection.directions`."""

    def __init__(self, properties: Any) -> None:
        super().__init__(properties)
        self.projection = Projection(properties["kind"], properties["angle"])
        self.half_eye_distance = properties["half_eye_distance"]

    def sample_ray(
        self, time: Any, wavelength: Any, position: Any, aperture: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return a ray through a place (0 … 1) of the rendered part, and its weight."""
        film = self.film()
        size = mi.ScalarVector2f(film.size())
        crop, corner = mi.ScalarVector2f(film.crop_size()), mi.ScalarVector2f(film.crop_offset())
        x = (position.x * crop.x + corner.x) / size.x * 2.0 - 1.0
        y = 1.0 - (position.y * crop.y + corner.y) / size.y * 2.0
        direction, eye, shown = self._direction(x, y)
        to_world = self.world_transform()
        origin = to_world @ mi.Point3f(-self.half_eye_distance * eye, 0.0, 0.0)
        ray = mi.Ray3f(origin, to_world @ direction, time)
        ray.maxt[~shown] = 0.0
        return ray, dr.select(shown, mi.Color3f(1.0), 0.0)

    def _direction(self, x: Any, y: Any) -> tuple[Any, Any, Any]:
        """Return the direction left, up and forward, the eye, and whether the picture shows something."""
        if self.projection.kind == "dome":
            radius = dr.sqrt(x * x + y * y)
            sine, away = dr.sincos(0.5 * self.projection.angle * radius)
            scale = sine / dr.maximum(radius, 1e-12)
            return mi.Vector3f(-scale * x, scale * y, away), mi.Float(0.0), radius <= 1.0
        eye = dr.select(x < 0.0, mi.Float(-1.0), 1.0) if self.projection.is_stereo else mi.Float(0.0)
        sine, cosine = dr.sincos(math.pi * x - 0.5 * math.pi * eye)
        up, level = dr.sincos(0.5 * math.pi * y)
        return mi.Vector3f(-level * sine, up, level * cosine), eye, mi.Bool(True)

    def sample_ray_differential(
        self, time: Any, wavelength: Any, position: Any, aperture: Any, active: Any = True
    ) -> tuple[Any, Any]:
        """Return the ray without differentials: no texture of ours is filtered by them."""
        ray, weight = self.sample_ray(time, wavelength, position, aperture, active)
        return mi.RayDifferential3f(ray), weight

    def bbox(self) -> Any:
        return mi.ScalarBoundingBox3f(self.world_transform() @ mi.ScalarPoint3f(0.0))

    def to_string(self) -> str:
        return f"{WIDE}[{self.projection.kind}]"


mi.register_texture("flowsculpt_absorbing", Absorbing)
mi.register_texture(PAINTED, PaintedTexture)
mi.register_texture(NORMALS, Normals)
mi.register_bsdf(BRUSHED, Brushed)
mi.register_bsdf(SUBSURFACE, SubsurfaceBSDF)
mi.register_sensor(WIDE, WideSensor)
