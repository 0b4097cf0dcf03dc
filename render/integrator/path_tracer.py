"""The path tracer: sums of the samples of each pixel, in code that Dr.Jit compiles.

It computes the same light as Mitsuba's `path` with less noise: random numbers continue one sequence from
batch to batch (`flowsculpt.render.integrator.sampler`), emitters are chosen by their irradiance
(`flowsculpt.render.integrator.light_sampler`), and at the first vertices all of them are sampled
(`flowsculpt.render.integrator.path`). The samples of a pixel are taken one after the other, so that sums have
a fixed order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.aligned_array import aligned, aligned_columns
from flowsculpt.render.integrator.cut_outs import UnseenLights
from flowsculpt.render.integrator.light_sampler import LightSampler
from flowsculpt.render.integrator.path import camera_vertex, trace
from flowsculpt.render.integrator.sampler import OwenSampler
from flowsculpt.render.integrator.scene_emitters import EmitterGroups
from flowsculpt.render.integrator.subsurface_paths import SubsurfaceWalk, SubsurfaceWalks


@dataclass(frozen=True, eq=False)
class ShadowCatcher:
    """A shape that is invisible itself, while shadows on it show.

    shape  pointer to it
    empty  path tracer of a scene with this shape and the emitters alone
    """

    shape: Any
    empty: PathTracer


@dataclass(frozen=True, eq=False)
class PathTracer:
    """A path tracer for one scene.

    max_depth      vertices of a path, the emitter's included
    unseen         lights that the lens does not see itself
    groups         light groups, each with its own sum; by default one of all emitters
    objects        shapes whose coverage of the pixel is measured
    catcher        a shape that is invisible itself, while shadows on it show; or None
    subsurface     random walks below the surfaces of subjects, or None
    caustic_sun    a `photons.CausticSun`, or None
    guide          directions of caustics at matt surfaces: a `caustic_guide.CausticGuide`, or None
    caustics       light that paths leave to photons: a `caustic_picture.CausticPicture`, or None
    occluders      a scene of all that can hide emitters; None is `surfaces`
    cut_outs       a `cut_outs.CutOuts` of the scene, or None where no surface has holes
    """

    scene: Any
    light_sampler: LightSampler
    max_depth: int
    unseen: UnseenLights
    groups: EmitterGroups = field(default_factory=EmitterGroups)
    objects: Sequence[Any] = ()
    catcher: ShadowCatcher | None = None
    subsurface: SubsurfaceWalk | SubsurfaceWalks | None = None
    caustic_sun: Any = None
    guide: Any = None
    caustics: Any = None
    occluders: Any = None
    cut_outs: Any = None

    @property
    def surfaces(self) -> Any:
        """The scene or cut-out search that rays are intersected with."""
        return self.scene if self.cut_outs is None else self.cut_outs

    @property
    def coverage_channels(self) -> int:
        """The channels of alpha, the coverage of the objects, and light on the shadow catcher."""
        return 1 + len(self.objects) + (2 if self.catcher else 0)

    def render(
        self, samples: int, first: int, seed: int, pixels: NDArray[np.integer[Any]] | None = None
    ) -> NDArray[np.float64]:
        """Return radiance, luminance and its square, alpha and the coverage of each object, as means over
        samples.

        first   samples of the same pixels and seed that were taken before
        pixels  numbers of the pixels to sample, row by row from the upper left of the rendered part; None is
                all of them

        The result is (H, W, channels), or with `pixels` (pixels, channels). With light groups, three channels
        for each stand before alpha: its radiance. The samples of a pixel do not depend on which others are
        rendered.
        """
        number, corner, size, shape = film_pixels(self.scene, pixels)
        sums = _sum_samples(self, OwenSampler(number, first, samples, seed), corner, size)
        dr.eval(sums)
        picture = np.empty((dr.width(number), len(sums)))
        for channel, values in enumerate(sums):
            picture[:, channel] = np.array(values)
        picture /= samples
        if self.caustics is not None:
            self._add_caustics(picture, pixels)
        del sums
        dr.flush_malloc_cache()
        return picture.reshape(*shape, -1)

    def _add_caustics(self, picture: NDArray[np.float64], pixels: NDArray[np.integer[Any]] | None) -> None:
        """Add the light of photons to means (pixels, channels) over paths, as if each path had found it."""
        radiance = self.caustics.radiance
        groups = radiance.reshape(-1, radiance.shape[-1])
        groups = groups if pixels is None else groups[pixels]
        light = groups.reshape(len(groups), -1, 3).sum(axis=1)
        luminance = np.array(mi.luminance(mi.Color3f(*aligned_columns(light))), dtype=np.float64)
        picture[:, :3] += light
        picture[:, 4] += luminance * (2.0 * picture[:, 3] + luminance)
        picture[:, 3] += luminance
        if self.groups.are_wanted:
            picture[:, 5 : 5 + groups.shape[1]] += groups


def film_pixels(scene: Any, pixels: NDArray[np.integer[Any]] | None) -> tuple[Any, Any, Any, tuple[int, ...]]:
    """Return numbers of pixels in the whole picture, their upper left corners in the rendered part, its size,
    and the shape of results: (H, W) or, with `pixels`, (pixels,).

    scene   Mitsuba's
    pixels  as of `PathTracer.render`
    """
    film = scene.sensors()[0].film()
    (width, height), (left, top) = film.crop_size(), film.crop_offset()
    shape = (int(height), int(width)) if pixels is None else pixels.shape
    numbers = np.arange(int(width) * int(height)) if pixels is None else pixels
    index = mi.UInt32(aligned(numbers, np.uint32))
    row = index // dr.opaque(mi.UInt32, int(width))
    column = index - row * int(width)
    number = (row + int(top)) * int(film.size()[0]) + column + int(left)
    return number, mi.Point2f(column, row), mi.Point2f(mi.ScalarPoint2f(film.crop_size())), shape


@dr.syntax
def _sum_samples(tracer: PathTracer, sampler: OwenSampler, corner: Any, size: Any) -> Any:
    """Return the sums over all samples, (pixels,) each.

    Radiance (3), luminance and its square, the radiance (3) of each light group, alpha, the coverage of each
    object, and the luminance on the shadow catcher with and without what casts shadows. Light that is not
    finite counts as black.
    """
    sample = mi.UInt32(0)
    radiance, luminance, square = mi.Color3f(0.0), mi.Float(0.0), mi.Float(0.0)
    groups = tracer.groups.zeros() if tracer.groups.are_wanted else []
    coverage = [mi.Float(0.0)] * tracer.coverage_channels
    while dr.hint(sample < sampler.count, label="samples", exclude=[tracer, sampler, corner, size]):
        sampler.sample = sample
        si, throughput = camera_vertex(tracer, sampler, corner, size)
        parts, caught = _beside_catcher(tracer, sampler, si, throughput)
        coverage = _plus(coverage, [*_seen(tracer, si), *caught])
        light = sum(parts[1:], parts[0])
        groups = _plus(groups, parts)
        y = mi.luminance(light)
        radiance += light
        luminance += y
        square += y * y
        sample += 1
    return [*radiance, luminance, square, *(channel for group in groups for channel in group), *coverage]


def _finite(parts: list[Any]) -> list[Any]:
    """Return parts, black where not finite. `dr.minimum` and `clip` pass NaN on: its sources are mended."""
    is_finite = dr.isfinite(mi.luminance(sum(parts[1:], parts[0])))
    return [dr.select(is_finite, part, 0.0) for part in parts]


def _plus(totals: list[Any], parts: list[Any]) -> list[Any]:
    return [total + part for total, part in zip(totals, parts, strict=False)]


def _seen(tracer: PathTracer, si: Any) -> list[Any]:
    """Return 1 or 0 for alpha and each object, by what the lens sees. A visible sky is opaque."""
    hit = si.is_valid() if tracer.unseen.sky else mi.Bool(True)
    if tracer.catcher is not None:
        hit &= ~_is_on(si, tracer.catcher.shape)
    objects = (dr.select(_is_on(si, shape), 1.0, 0.0) for shape in tracer.objects)
    return [dr.select(hit, 1.0, 0.0), *objects]


def _is_on(si: Any, shape: Any) -> Any:
    return si.is_valid() & (si.shape == shape)


def _beside_catcher(
    tracer: PathTracer, sampler: OwenSampler, si: Any, throughput: Any
) -> tuple[list[Any], list[Any]]:
    """Return the radiance by light group, 0 on the shadow catcher, and the luminance on the catcher with and
    without what casts shadows.

    Both paths on the catcher have the same random numbers: light that no shadow changes is the same to the
    last bit. Light that the subject adds, such as a caustic, is left out, sample by sample.
    """
    parts = _finite(trace(tracer, sampler, dr.copy(si), dr.copy(throughput)))  # tracing moves them along
    if tracer.catcher is None:
        return parts, []
    is_on = _is_on(si, tracer.catcher.shape)
    lit = dr.select(is_on, mi.luminance(sum(parts[1:], parts[0])), 0.0)
    bare = dr.copy(si)
    bare.t = dr.select(is_on, si.t, dr.inf)
    without = _finite(trace(tracer.catcher.empty, sampler, bare, dr.copy(throughput)))
    seen = [dr.select(is_on, 0.0, part) for part in parts]
    unshadowed = mi.luminance(sum(without[1:], without[0]))
    return seen, [dr.minimum(lit, unshadowed), unshadowed]
