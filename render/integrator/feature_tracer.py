"""Tracers of auxiliary features and of copies, in every pixel, by the rays of the path tracer's light.

Albedo, normal, position, depth and matte are those of the first surface that the lens sees. Where it is a
mirror or clear glass, the denoiser needs the albedo and normal of what that shows: `denoise_albedo` and
`denoise_normal` follow the path through smooth surfaces to the first rough one, as the documentation of Open
Image Denoise advises. The albedo of a metal is its reflectance along the normal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.aligned_array import components
from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.integrator.cut_outs import UnseenLights
from flowsculpt.render.integrator.path_tracer import camera_vertex, film_pixels
from flowsculpt.render.integrator.sampler import DIRECTION, LOBE, OwenSampler
from flowsculpt.render.scene.aovs import COPY

MAX_FOLLOWED = 8
"""Most smooth surfaces that a path passes; beyond, the albedo is what they let through."""

MAX_ROUGHNESS = 0.1
"""GGX roughness up to which a metal counts as a mirror."""

_MIN_PDF = 1.0 / (4.0 * math.pi * MAX_ROUGHNESS**2)
"""Density of the mirrored direction, seen along the normal, from which on a metal counts as a mirror."""


@dataclass(frozen=True, eq=False)
class FeatureTracer:
    """A tracer of auxiliary features for one scene.

    unseen        lights that the lens does not see itself
    subjects      pointers to the shapes of subjects, whose coverage is the matte
    wireframes    pointers to the shapes of their lines, which count for the matte too
    clear_colours albedo of each of `subjects` that is clear, or None
    attributes    names of the vertex attributes (V, 3) of subjects that become features
    follows       True if paths are followed through smooth surfaces
    cut_outs      as of `PathTracer`
    """

    continues_sequence: ClassVar[bool] = True
    """True if batches continue one sequence of samples, and take the seed of the picture's beauty."""

    scene: Any
    unseen: UnseenLights
    subjects: Sequence[Any]
    wireframes: Sequence[Any]
    clear_colours: Sequence[Triple | None]
    attributes: Sequence[str]
    follows: bool
    cut_outs: Any = None

    @cached_property
    def has_specular(self) -> bool:
        """True if a surface of the scene, not counting emitters, reflects nothing diffusely."""
        bsdfs = [shape.bsdf() for shape in self.scene.shapes() if not shape.is_emitter()]
        return any(not mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse) for bsdf in bsdfs)

    def render(
        self, samples: int, first: int, seed: int, pixels: NDArray[np.integer[Any]] | None = None
    ) -> dict[str, NDArray[np.float32]]:
        """Return features as means over samples: (H, W, channels), or with `pixels` (pixels, channels).

        first   samples of the same pixels and seed that were taken before
        pixels  as of `PathTracer.render`

        albedo, normal, position, depth  of the first surface, 0 where there is none
        matte                            coverage by the subjects and their wireframes
        denoise_albedo, denoise_normal   of the first rough surface, in scenes with smooth ones
        names of `attributes`            those of the subjects, 0 elsewhere
        """
        number, corner, size, shape = film_pixels(self.scene, pixels)
        sampler = OwenSampler(number, first, samples, seed)
        sums = _sum_features(self, sampler, corner, size, self.follows and self.has_specular)
        dr.eval(sums)
        count = np.float32(samples)
        features = {name: _picture(values, shape) / count for name, values in sums.items()}
        dr.flush_malloc_cache()
        return features


def _picture(values: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return values (pixels,) or (3, pixels) as (*shape, channels)."""
    channels = components(values if dr.depth_v(values) > 1 else [values])
    return np.ascontiguousarray(channels.T).reshape(*shape, -1)


@dr.syntax
def _sum_features(
    tracer: FeatureTracer, sampler: OwenSampler, corner: Any, size: Any, is_followed: bool
) -> dict[str, Any]:
    """Return the sums of features over all samples, (3, pixels) or (pixels,) each, by name."""
    sample, sums = mi.UInt32(0), _zeros(tracer, is_followed)
    while dr.hint(sample < sampler.count, label="features", exclude=[tracer, sampler]):
        sampler.sample = sample
        sums = _added(sums, _features(tracer, sampler, corner, size, is_followed))
        sample += 1
    return sums


def _added(sums: dict[str, Any], features: dict[str, Any]) -> dict[str, Any]:
    """Return the sums with the features of one more sample."""
    return {name: total + type(total)(features[name]) for name, total in sums.items()}


def _zeros(tracer: FeatureTracer, is_followed: bool) -> dict[str, Any]:
    vectors = ("albedo", "normal", "position", *tracer.attributes)
    followed = ("denoise_albedo", "denoise_normal") if is_followed else ()
    zeros: dict[str, Any] = {name: mi.Vector3f(0.0) for name in (*vectors, *followed)}
    return zeros | {"depth": mi.Float(0.0), "matte": mi.Float(0.0)}


def _features(
    tracer: FeatureTracer, sampler: OwenSampler, corner: Any, size: Any, is_followed: bool
) -> dict[str, Any]:
    """Return the features of one sample of each pixel, by name."""
    si, _ = camera_vertex(tracer, sampler, corner, size)
    hit = si.is_valid()
    albedo, is_smooth = _albedo(tracer, si, hit)
    normal = dr.select(hit, si.sh_frame.n, 0.0)
    is_body, is_wire = (hit & _is_on(si, shapes) for shapes in (tracer.subjects, tracer.wireframes))
    features = {
        "albedo": dr.select(hit, albedo, 0.0),
        "normal": normal,
        "position": dr.select(hit, si.p, 0.0),
        "depth": dr.select(hit, si.t, 0.0),
        "matte": dr.select(is_body | is_wire, 1.0, 0.0),
    }
    for name in tracer.attributes:
        value = si.shape.eval_attribute_3(f"vertex_{name}", si, is_body)
        features[name] = dr.select(is_body, value, 0.0)
    if is_followed:
        followed = _follow(tracer, sampler, si, hit & is_smooth)
        features["denoise_albedo"] = dr.select(is_smooth, followed[0], features["albedo"])
        features["denoise_normal"] = dr.select(is_smooth, followed[1], normal)
    return features


@dr.syntax
def _follow(tracer: FeatureTracer, sampler: OwenSampler, si: Any, active: Any) -> tuple[Any, Any]:
    """Return the albedo and normal of the first rough surface that smooth ones show.

    The albedo is multiplied by what they reflect and let through. An emitter or the sky of radiance L has the
    albedo L / (1 + L), and smooth surfaces that are not left 1. Their normal is 0.
    """
    throughput, vertex = mi.Color3f(1.0), mi.UInt32(0)
    result, normal = mi.Color3f(0.0), mi.Vector3f(0.0)
    while dr.hint(active, max_iterations=MAX_FOLLOWED, label="mirrors", exclude=[tracer, sampler]):
        lobe, direction = sampler.vertex_1d(vertex, LOBE), sampler.vertex_2d(vertex, DIRECTION)
        sampled, weight = si.bsdf().sample(mi.BSDFContext(), si, lobe, direction, active)
        throughput *= weight
        surfaces = tracer.scene if tracer.cut_outs is None else tracer.cut_outs
        si = surfaces.ray_intersect(si.spawn_ray(si.to_world(sampled.wo)), active)
        hit = active & si.is_valid()
        is_emitter = hit & (si.shape.emitter() != None)  # noqa: E711 an array of pointers
        albedo, is_smooth = _albedo(tracer, si, hit & ~is_emitter)
        vertex += 1
        is_followed = hit & is_smooth & ~is_emitter & (vertex < MAX_FOLLOWED)
        is_rough = hit & ~is_emitter & ~is_smooth
        ends = active & ~is_followed
        leaves = active & (is_emitter | ~si.is_valid())
        radiance = dr.maximum(si.emitter(tracer.scene).eval(si, leaves), 0.0)
        albedo = dr.select(leaves, radiance / (1.0 + radiance), dr.select(is_rough, albedo, 1.0))
        result = dr.select(ends, throughput * albedo, result)
        normal = dr.select(ends & is_rough, si.sh_frame.n, normal)
        active = is_followed
    return dr.clip(result, 0.0, 1.0), normal


def _albedo(tracer: FeatureTracer, si: Any, active: Any) -> tuple[Any, Any]:
    """Return the albedo at a surface interaction, and whether the surface is smooth."""
    bsdf = si.bsdf()
    flags = bsdf.flags()
    is_diffuse = mi.has_flag(flags, mi.BSDFFlags.Diffuse)
    albedo = bsdf.eval_diffuse_reflectance(si, active & is_diffuse)
    is_smooth = dr.mask_t(active)(False)
    if tracer.has_specular:
        facing = dr.copy(si)
        facing.wi = mi.Vector3f(0.0, 0.0, 1.0)
        middle = mi.Point2f(0.5)
        sampled, weight = bsdf.sample(mi.BSDFContext(), facing, mi.Float(0.0), middle, active & ~is_diffuse)
        albedo = dr.select(is_diffuse, albedo, weight)
        is_delta = mi.has_flag(sampled.sampled_type, mi.BSDFFlags.Delta)
        is_mirror = ~mi.has_flag(flags, mi.BSDFFlags.Transmission) & (sampled.pdf > _MIN_PDF)
        is_smooth = ~is_diffuse & (is_delta | is_mirror)
    for shape, colour in zip(tracer.subjects, tracer.clear_colours, strict=True):
        if colour is not None:
            albedo = dr.select(si.shape == shape, mi.Color3f(colour), albedo)
    return dr.clip(albedo, 0.0, 1.0), is_smooth


def _is_on(si: Any, shapes: Sequence[Any]) -> Any:
    """Tell where a surface interaction is on one of the shapes."""
    found = mi.Bool(False)
    for shape in shapes:
        found |= si.shape == shape
    return found


@dataclass(frozen=True, eq=False)
class CopyTracer:
    """A tracer of the copies that the lens sees in one scene.

    unseen    lights that the lens does not see itself
    shapes    pointers to the shapes of subjects with copies, whose vertices have the attribute COPY
    cut_outs  as of `PathTracer`
    """

    scene: Any
    unseen: UnseenLights
    shapes: Sequence[Any]
    cut_outs: Any = None

    def render(
        self, samples: int, first: int, seed: int, pixels: NDArray[np.integer[Any]] | None = None
    ) -> NDArray[np.int32]:
        """Return the number of the copy (pixels, samples) that each sample sees, 0 where it sees none.

        The arguments are those of `PathTracer.render`, and so are the rays.
        """
        number, corner, size, _ = film_pixels(self.scene, pixels)
        sampler = OwenSampler(number, first, samples, seed)
        seen = []
        for sample in range(samples):
            sampler.sample = dr.opaque(mi.UInt32, sample)  # one compiled kernel for all samples
            seen.append(np.array(self._copy(sampler, corner, size), dtype=np.int32))
        dr.flush_malloc_cache()
        return np.stack(seen, axis=1)

    def _copy(self, sampler: OwenSampler, corner: Any, size: Any) -> Any:
        si, _ = camera_vertex(self, sampler, corner, size)
        is_on = si.is_valid() & _is_on(si, self.shapes)
        value = si.shape.eval_attribute_1(f"vertex_{COPY}", si, is_on)
        return dr.select(is_on, mi.UInt32(dr.round(value)), 0)
