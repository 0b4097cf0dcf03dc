"""Denoise the frames of a film: raw frames with features and exact motion in, light without noise out.

`FilmDenoiser.light` is the one function behind which denoising over time sits. Today each frame is denoised
by itself, and then averaged with its reprojected neighbours (`temporal_denoise`). A denoiser that takes
neighbours and motion itself can take its place: all that it needs is in `RawFrame`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from render.post.denoise import denoise_light, denoiser_features
from render.post.temporal_denoise import DenoisedFrame, Floats, removed_noise, temporal_denoise
from render.scene.aovs import RenderedFrame
from render.scene.camera import Camera
from render.scene.light_groups import groups_in
from render.scene.stage import StagePlacement


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
            return self._single_light(self.read(number).layers)
        self._denoised = {n: self._denoised.get(n) or self._single(n) for n in numbers}
        return temporal_denoise(self._denoised, number, self.size, self.corner)

    def _single(self, number: int) -> DenoisedFrame:
        """Return a frame denoised by itself, with what reprojection needs of it."""
        raw = self.read(number)
        light = self._single_light(raw.layers)
        noise = removed_noise(raw.layers["beauty"], light[..., :3])
        known = {name: raw.layers[name] for name in ("position", "normal", "matte", "before", "after")}
        return DenoisedFrame(light, noise, **known, camera=raw.camera, placement=raw.placement)

    def _single_light(self, layers: RenderedFrame) -> Floats:
        """Return the light of a frame, denoised by itself: each light group, and the beauty as their sum."""
        groups = [*groups_in(layers.arrays).values()]
        parts = groups or [layers["beauty"]]
        if self.effort != "off":
            features = denoiser_features(layers, self.effort)
            parts = [denoise_light(part, features, self.effort) for part in parts]
        return np.concatenate([np.sum(parts, axis=0), *parts], axis=2) if groups else parts[0]
