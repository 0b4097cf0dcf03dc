"""Denoise the frames of a film: raw frames with features and exact motion in, light without noise out.

`FilmDenoiser.light` is the one function behind which denoising over time sits. Today each frame is denoised
by itself, and then averaged with its reprojected neighbours (`temporal_denoise`). A denoiser that takes
neighbours and motion itself can take its place: all that it needs is in `RawFrame`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from render.post.denoise import denoise_light, denoiser_features
from render.post.temporal_denoise import DenoisedFrame, Floats, removed_noise, temporal_denoise
from render.scene.aovs import DENOISER, RenderedFrame
from render.scene.render_camera import Camera, Projection
from render.scene.scene_lights import groups_in, light_layers
from render.scene.scene_stage import StagePlacement

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


@dataclass(eq=False)
class FilmDenoiser:
    """A denoiser of the frames of one film. Frames that several others need are denoised once.

    read    returns a frame by its number
    effort  a Quality's `denoise`; "off" leaves the noise of frames without neighbours
    size    width and height of the whole picture, pixels; None if frames are no crops
    corner  the crop's upper left corner
    """

    read: Callable[[int], RawFrame]
    effort: str = "high"
    size: tuple[int, int] | None = None
    corner: tuple[int, int] = (0, 0)
    _denoised: dict[int, DenoisedFrame] = field(default_factory=dict)

    def light(self, number: int, window: Iterable[int]) -> Floats:
        """Return the light of frame `number` without noise: the beauty, and its light groups if it has any.

        window  numbers of the frame and its neighbours, without a gap

        float32 (H, W, 3 + 3 groups); the groups, in the order of `groups_in`, sum to the beauty.
        Raises MachineError where the denoiser cannot run.
        """
        numbers = [*window]
        if len(numbers) == 1:
            return self._single_light(self.read(number))
        self._denoised = {n: frame for n, frame in self._denoised.items() if n in numbers}
        for n in numbers:
            if n not in self._denoised:
                self._denoised[n] = self._single(n)
        return temporal_denoise(self._denoised, number, self.size, self.corner)

    def _single(self, number: int) -> DenoisedFrame:
        """Return a frame denoised by itself, with what reprojection needs of it, halves as in files."""
        raw = self.read(number)
        camera, placement, position = raw.camera, raw.placement, raw.layers["position"]
        halves = {
            name: raw.layers[name].astype(np.float16) for name in ("normal", "matte", "before", "after")
        }
        raw = RawFrame(_denoised_layers(raw.layers), camera, placement)  # frees the rest, of 100 MB at 1080p
        light = self._single_light(raw)
        noise = removed_noise(raw.layers["beauty"], light[..., :3])
        return DenoisedFrame(light, noise, position, **halves, camera=camera, placement=placement)

    def _single_light(self, raw: RawFrame) -> Floats:
        """Return the light of a frame, denoised by itself, without a seam where its picture wraps."""
        if self.effort == "off" or not raw.camera.projection.is_wide:
            return self._light(raw.layers)
        width = raw.layers.size[0]
        parts = [
            self._light(_columns(raw.layers, columns))[:, kept]
            for columns, kept in denoised_columns(raw.camera.projection, width)
        ]
        return np.concatenate(parts, axis=1)

    def _light(self, layers: RenderedFrame) -> Floats:
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
