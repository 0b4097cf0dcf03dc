"""From raw pictures to finished ones: noise removed within each, and over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FrameError
from pipeline.production.request.keys import PictureKeys
from pipeline.production.store import readers
from pipeline.production.tasks.job import Context
from render.post.denoise import denoise
from render.post.image import write_exr
from render.scene.aovs import RenderedFrame

if TYPE_CHECKING:
    from pipeline.production.render_inputs.framing import Framing
    from render.post.temporal_denoise import DenoisedFrame


def finish(context: Context) -> bool:
    """Finish the pictures of a batch: noise removed, the beauty alone, ready for the view.

    Those that could not be rendered are left out; that was told when they were.
    """
    request = context.request
    keys = context.picture_keys(request)
    desk = _Desk(context, keys, request.framings(context.store) or {})

    def work(number: int) -> bool:
        def write(path: Path) -> None:
            light, header = desk.finished(number)
            write_exr(path, light, {**header, "key": keys[number].frame}, dict(request.precision))

        target = request.place("frame", number)
        return context.make("frame", keys[number].frame, target, write)

    lost = context.failed("render")
    ready = [n for n in context.job.frames if not lost & {*keys[n].window}]
    well = context.each(ready, work)
    for number in {*context.job.frames} - {*ready} - lost:
        others = ", ".join(str(n) for n in sorted(lost & {*keys[number].window}))
        context.fail(FrameError(f"frame {number} takes in light of frame {others}, which failed"), number)
    return well and len(ready) == len(context.job.frames)


@dataclass(eq=False)
class _Desk:
    """The raw pictures that a batch needs; those that more than one takes light from are denoised once."""

    context: Context
    keys: PictureKeys
    framings: Mapping[int, Framing]
    _moments: dict[int, DenoisedFrame] = field(default_factory=dict)

    def finished(self, number: int) -> tuple[RenderedFrame, dict[str, Any]]:
        """The beauty of a picture without noise, and the header of the raw one."""
        layers, header = self._read(number)
        window = self.keys[number].window
        if len(window) == 1:
            effort = self.context.request.quality.denoise
            light = layers["beauty"] if effort == "off" else denoise(layers, effort)
        else:
            from render.post.temporal_denoise import temporal_denoise

            kept = {n: moment for n, moment in self._moments.items() if n in window}
            self._moments = {n: kept[n] if n in kept else self._moment(n) for n in window}
            quality = self.context.request.quality
            corner = quality.crop[:2] if quality.crop else (0, 0)
            light = temporal_denoise(self._moments, number, (quality.width, quality.height), corner)
            header = {**header, "steadied_with": [n for n in window if n != number]}
        return RenderedFrame({"beauty": light}, layers.facts), header

    def _read(self, number: int) -> tuple[RenderedFrame, dict[str, Any]]:
        request = self.context.request
        place = request.place("raw", number)
        key = self.keys[number].raw
        return self.context.read("raw", key, place, readers.picture(key, request.quality.rendered_size))

    def _moment(self, number: int) -> DenoisedFrame:
        from render.post.temporal_denoise import DenoisedFrame, residual_noise

        layers, _ = self._read(number)
        light = denoise(layers, self.context.request.quality.denoise)
        known = {name: layers[name] for name in ("position", "normal", "matte", "before", "after")}
        framing = self.framings[number]
        noise = residual_noise(layers["beauty"], light)
        return DenoisedFrame(light, noise, **known, camera=framing.camera, placement=framing.placement)
