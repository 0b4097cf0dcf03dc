"""From raw pictures to finished ones: noise removed within each, and over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.errors import FrameError
from pipeline.production.request.keys import PictureKeys
from pipeline.production.stages import FINISH
from pipeline.production.tasks.finished_frames import FinishedFrames
from pipeline.production.tasks.job import Context
from render.post.film_denoiser import FilmDenoiser, RawFrame
from render.scene.aovs import DENOISER, Pixels, RenderedFrame
from render.scene.light_groups import groups_in, light_layers, with_beauty

if TYPE_CHECKING:
    from pipeline.production.render_inputs.framing import Framing


def finish(context: Context) -> bool:
    """Finish the pictures of a batch: noise removed, with alpha and the layers that the shot asks for.

    Pictures that could not be rendered are left out; their failure is reported already.
    """
    request = context.request
    keys = context.picture_keys(request)
    framings: Mapping[int, Framing] = request.framings(context.store) or {}
    denoiser, output = _Denoiser(context, keys, framings), FinishedFrames(request, framings)

    def work(number: int) -> bool:
        def write(path: Path) -> None:
            layers, header = denoiser.finished(number)
            output.write(path, number, layers, {**header, "key": keys[number].frame})

        return context.make("frame", keys[number].frame, request.place("frame", number), write)

    lost = context.failed("render")
    ready = [n for n in context.job.frames if not lost & {*keys[n].window}]
    well = context.for_each(ready, work)
    for number in {*context.job.frames} - {*ready} - lost:
        others = ", ".join(str(n) for n in sorted(lost & {*keys[number].window}))
        context.fail(FrameError(f"frame {number} averages frame {others}, which failed"), number)
    return well and len(ready) == len(context.job.frames)


@dataclass(eq=False)
class _Denoiser:
    """Denoises the raw pictures of a batch, each read once.

    kept  of pictures read as neighbours, by number: the layers that finished ones need, and the header
    """

    context: Context
    keys: PictureKeys
    framings: Mapping[int, Framing]
    kept: dict[int, tuple[RenderedFrame, dict[str, Any]]] = field(default_factory=dict)

    def finished(self, number: int) -> tuple[RenderedFrame, dict[str, Any]]:
        """Return a picture with its beauty free of noise, and its header: the raw one's, and the stage's."""
        window = self.keys[number].window
        light = self._denoiser.light(number, window)
        layers, raw = self.kept.get(number) or self._read(number)
        self.kept = {n: kept for n, kept in self.kept.items() if n in window and n > number}
        stages = {**raw.get("stages", {}), FINISH.name: FINISH.recipe}
        header = {**raw, "raw_key": self.keys[number].raw, "stages": stages}
        if len(window) > 1:
            header = {**header, "temporal_neighbours": [n for n in window if n != number]}
        light = np.where(layers["alpha"][..., None] > 0.0, light, np.float32(0.0))
        denoised = _layers_of(light, groups_in(layers.arrays))
        return RenderedFrame({**layers.arrays, **denoised}, layers.facts), header

    def _read(self, number: int) -> tuple[RenderedFrame, dict[str, Any]]:
        layers, header = self.context.read_picture(self.context.request, "raw", number, self.keys[number].raw)
        if "shadow" not in layers.arrays:
            return layers, header
        # Features of the shadow catcher, which is not seen, would blur the subject's outline.
        names = {"albedo", "normal", *DENOISER} & layers.arrays.keys()
        seen = {name: layers[name] * layers["alpha"][..., None] for name in names}
        return RenderedFrame({**layers.arrays, **seen}, layers.facts), header

    @cached_property
    def _denoiser(self) -> FilmDenoiser:
        quality = self.context.request.quality
        corner = quality.crop[:2] if quality.crop else (0, 0)
        return FilmDenoiser(self._raw, quality.denoise, (quality.width, quality.height), corner)

    def _raw(self, number: int) -> RawFrame:
        framing, (layers, header) = self.framings[number], self._read(number)
        self.kept[number] = self._kept_of(layers), header
        return RawFrame(layers, framing.camera, framing.placement)

    def _kept_of(self, layers: RenderedFrame) -> RenderedFrame:
        """Return the layers of a raw picture that its finished frame needs."""
        if self.context.request.summary.layers is not None:
            return layers
        names = {"alpha", "shadow", *light_layers(layers.arrays)} & layers.arrays.keys()
        return RenderedFrame({name: layers[name] for name in names}, layers.facts)


def _layers_of(light: Pixels, groups: Iterable[str]) -> dict[str, Pixels]:
    """Return the layers in the channels of `FilmDenoiser.light`."""
    parts = (light[..., first : first + 3] for first in range(3, light.shape[2], 3))
    layers = dict(zip(groups, parts, strict=True))
    return with_beauty(layers) if layers else {"beauty": light}
