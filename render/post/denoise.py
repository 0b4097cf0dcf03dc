"""Denoise frames with Intel's Open Image Denoise, guided by albedo and normals, one alone or those of a film.

`FilmDenoiser.light` is the one function behind which denoising over time sits: raw frames with features and
exact motion in, light without noise out. Today each frame is denoised by itself, and then averaged with its
reprojected neighbours (`temporal_denoise`). A denoiser that takes neighbours and motion itself can take its
place: all that it needs is in `RawFrame`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.base.work_clock import free_memory
from flowsculpt.render.mitsuba.engine import available_cores
from flowsculpt.render.post.temporal_denoise import DenoisedFrame, removed_noise, temporal_denoise
from flowsculpt.render.scene.aovs import DENOISER, RenderedFrame
from flowsculpt.render.scene.render_camera import Camera, Projection
from flowsculpt.render.scene.scene_lights import groups_in, light_layers
from flowsculpt.render.scene.scene_stage import StagePlacement

Pixels = NDArray[np.float32]

LEAST_MB, MOST_MB = 500, 900
"""Working memory of the denoiser. Larger pictures are denoised in parts that overlap, to the same bits: with
the most, 1920 × 1080 pixels take a third less CPU time than with the least, and 400 MB more."""

SHARE_MB = 2000.0
"""Free memory, over the cores that may denoise at once, from which a process takes the most."""


@dataclass(frozen=True)
class Features:
    """Features of a frame without noise, (H, W, 3) each."""

    albedo: Pixels
    normal: Pixels


def denoise(frame: RenderedFrame, effort: str = "high") -> Pixels:
    """Return the denoised beauty, float32 (H, W, 3), of a frame with the AOVs beauty, albedo and normal.

    effort  a Quality's `denoise`: "balanced" takes half the time of "high" and looks alike at small sizes

    Raises MachineError where the denoiser cannot run.
    """
    return denoise_light(frame["beauty"], denoiser_features(frame, effort), effort)


def denoiser_features(frame: RenderedFrame, effort: str = "high") -> Features:
    """Return the features of a frame that guide the denoiser of its light.

    Mirrors and glass show other surfaces, whose features are followed (`denoise_albedo`). Features of a
    pinhole camera are noisy only at edges, and as they are they keep creases crisp. A lens, several motion
    samples, mirrors that are not quite smooth and glass, which mirrors and refracts by chance, make noise. It
    is filtered first: the denoiser would take it for a pattern of the surface. So are the features of smoke,
    whose samples are not those of the light: at edges the two differ.
    Raises MachineError where the denoiser cannot run.
    """
    is_followed = "denoise_albedo" in frame.arrays
    albedo = frame["denoise_albedo" if is_followed else "albedo"]
    normal = frame["denoise_normal" if is_followed else "normal"]
    # A frame that was read has its file's header as facts, where `shutter` is None without motion blur.
    facts = frame.facts
    is_noisy = facts.get("lens_radius", 0.0) > 0.0 or facts.get("motion_samples", 1) > 1
    if is_noisy or is_followed or facts.get("features_apart", False):
        albedo = np.clip(_filtered("albedo", effort, albedo=_finite(albedo)), 0.0, 1.0)
        normal = np.clip(_filtered("normal", effort, normal=_finite(normal)), -1.0, 1.0)
    return Features(albedo, normal)


def denoise_light(light: Pixels, features: Features, effort: str = "high") -> Pixels:
    """Return light (H, W, 3) of a frame without noise: its beauty, or one of its light groups.

    Values that are not finite count as 0. Black stays black: in it the denoiser would see the features.
    Raises MachineError where the denoiser cannot run.
    """
    colour = np.maximum(_finite(light), np.float32(0.0))
    if not colour.any():
        return colour
    return _filtered("color", effort, color=colour, albedo=features.albedo, normal=features.normal)


def _finite(picture: Pixels) -> Pixels:
    return np.nan_to_num(picture, posinf=0.0, neginf=0.0)


BLOCK = 16
"""The denoiser takes pictures whose height and width are multiples of this. Others are mirrored below and to
the right up to the next multiple; what the denoiser adds there itself makes the last row up to a tenth too
dark or too bright."""


def _filtered(kind: str, effort: str, **images: Pixels) -> Pixels:
    """Return the image `kind` of `images` (H, W, 3) without noise; the others guide the filter."""
    import pyoidn  # slow to import, and many processes denoise nothing

    height, width = images[kind].shape[:2]
    beyond = [(0, min(-side % BLOCK, side - 1)) for side in (height, width)]
    given = {
        name: np.ascontiguousarray(np.pad(image, [*beyond, (0, 0)], mode="reflect"), dtype=np.float32)
        for name, image in images.items()
    }
    given[pyoidn.OIDN_IMAGE_OUTPUT] = clean = np.empty_like(given[kind])
    filter_ = _filter(kind)
    for name, image in given.items():
        filter_.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
    filter_.set_quality(getattr(pyoidn, f"OIDN_QUALITY_{effort.upper()}"))
    filter_.commit()
    filter_.execute()
    if (reason := _device().get_error()) is not None:
        raise MachineError(f"the denoiser cannot run: {reason}; render with denoise: off")
    return np.ascontiguousarray(clean[:height, :width])


@cache
def _device() -> Any:
    """Return the denoiser's device, one for the process: its filters share their working memory."""
    import pyoidn

    device = pyoidn.Device()
    device.commit()
    return device


@cache
def _filter(kind: str) -> Any:
    """Return the filter of one kind of image. Kept from frame to frame, it saves a tenth of its time."""
    import pyoidn

    filter_ = pyoidn.Filter(_device())
    filter_.set_bool("hdr", kind == "color")
    filter_.set_bool("cleanAux", kind == "color")
    is_spare = free_memory() > SHARE_MB * available_cores()
    filter_.set_int("maxMemoryMB", MOST_MB if is_spare else LEAST_MB)
    return filter_


SEAM = 64
"""Columns that a spherical picture is denoised with beyond each edge, from the other edge. Where light is all
noise, the step across the seam is then like that between other columns; without them, 8 times as large."""


@dataclass(frozen=True, eq=False)
class RawFrame:
    """A frame with noise, and what makes its motion exact.

    layers  beauty, light groups, features and position; with neighbours also `before` and `after`, the
            offsets of the subject's points
    """

    layers: RenderedFrame
    camera: Camera
    placement: StagePlacement


class SharedLight(Protocol):
    """Light (H, W, channels) of denoised frames that several processes need, by the numbers of frames."""

    def get(self, number: int) -> Pixels | None:
        """Return the light of a frame that another process has denoised, or None."""

    def put(self, number: int, light: Pixels) -> None:
        """Let others have the light of a frame."""


@dataclass(eq=False)
class FilmDenoiser:
    """A denoiser of the frames of one film. Frames that several others need are denoised once.

    read    returns a frame by its number
    effort  a Quality's `denoise`; "off" leaves the noise of frames without neighbours
    size    width and height of the whole picture, pixels; None if frames are no crops
    corner  the crop's upper left corner
    shared  light that other processes have denoised, or need; None without any
    """

    read: Callable[[int], RawFrame]
    effort: str = "high"
    size: tuple[int, int] | None = None
    corner: tuple[int, int] = (0, 0)
    shared: SharedLight | None = None
    _denoised: dict[int, DenoisedFrame] = field(default_factory=dict)
    _latest: tuple[int, int] = (0, 0)
    """The last number of which `light` was asked, and the first of its window."""

    def light(self, number: int, window: Iterable[int]) -> Pixels:
        """Return the light of frame `number` without noise: the beauty, and its light groups if it has any.

        window  numbers of the frame and its neighbours, without a gap

        float32 (H, W, 3 + 3 groups); the groups, in the order of `groups_in`, sum to the beauty.
        Raises MachineError where the denoiser cannot run.
        """
        numbers = [*window]
        if len(numbers) == 1:
            return self._single_light(self.read(number))
        is_later = number >= self._latest[0] and numbers[0] >= self._latest[1]
        self._latest = number, numbers[0]
        self._denoised = {n: frame for n, frame in self._denoised.items() if is_later and n in numbers}
        for n in numbers:
            if n not in self._denoised:
                self._denoised[n] = self._single(n)
            if n < number:  # this and later windows do not ask for the rest, 80 MB at 1080p
                rest = ("before",) if n == numbers[0] else ()
                self._denoised[n] = self._denoised[n].without("noise", "normal", "after", *rest)
        return temporal_denoise(self._denoised, number, self.size, self.corner)

    def share(self, number: int) -> None:
        """Denoise a frame that others need, before `light` needs it, and let them have its light.

        Raises MachineError where the denoiser cannot run.
        """
        if self.shared is not None and self.shared.get(number) is None:
            self.shared.put(number, self._single_light(self.read(number)))

    def _single(self, number: int) -> DenoisedFrame:
        """Return a frame denoised by itself, with what reprojection needs of it, halves as in files."""
        raw = self.read(number)
        camera, placement, position = raw.camera, raw.placement, raw.layers["position"]
        names = ("normal", "matte", "before", "after")
        halves = {name: raw.layers[name].astype(np.float16) for name in names}
        raw = RawFrame(_denoised_layers(raw.layers), camera, placement)  # frees the rest, of 100 MB at 1080p
        light = None if self.shared is None else self.shared.get(number)
        if light is None:
            light = self._single_light(raw)
            if self.shared is not None:
                self.shared.put(number, light)
        noise = removed_noise(raw.layers["beauty"], light[..., :3])
        return DenoisedFrame(light, noise, position, **halves, camera=camera, placement=placement)

    def _single_light(self, raw: RawFrame) -> Pixels:
        """Return the light of a frame, denoised by itself, without a seam where its picture wraps."""
        if self.effort == "off" or not raw.camera.projection.is_wide:
            return self._light(raw.layers)
        width = raw.layers.size[0]
        parts = [
            self._light(_columns(raw.layers, columns))[:, kept]
            for columns, kept in denoised_columns(raw.camera.projection, width)
        ]
        return np.concatenate(parts, axis=1)

    def _light(self, layers: RenderedFrame) -> Pixels:
        """Return the denoised light of a frame: each light group, and the beauty as their sum."""
        groups = [*groups_in(layers.arrays).values()]
        parts = groups or [layers["beauty"]]
        if self.effort != "off":
            features = denoiser_features(layers, self.effort)
            parts = [denoise_light(part, features, self.effort) for part in parts]
        return np.concatenate([np.sum(parts, axis=0), *parts], axis=2) if groups else parts[0]


def _denoised_layers(layers: RenderedFrame) -> RenderedFrame:
    """Return the layers of a frame that are denoised, and those that guide the denoiser."""
    names = {"beauty", "albedo", "normal", *DENOISER, *light_layers(layers.arrays)} & layers.arrays.keys()
    return RenderedFrame({name: layers[name] for name in names}, layers.facts)


def denoised_columns(projection: Projection, width: int) -> list[tuple[NDArray[np.intp], slice]]:
    """Return the columns of a picture that are denoised together, and which of them are kept.

    A spherical picture continues beyond its edges; of a stereo picture, each eye's half stands alone.
    """
    if projection.wraps:
        seam = min(SEAM, width)
        return [(np.arange(-seam, width + seam) % width, slice(seam, seam + width))]
    if projection.is_stereo:
        return [(columns, slice(None)) for columns in np.array_split(np.arange(width), 2)]
    return [(np.arange(width), slice(None))]


def _columns(layers: RenderedFrame, columns: NDArray[np.intp]) -> RenderedFrame:
    """Return columns of a frame."""
    arrays = {name: np.ascontiguousarray(array[:, columns]) for name, array in layers.arrays.items()}
    return RenderedFrame(arrays, layers.facts)
