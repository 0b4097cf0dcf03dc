"""The files of finished frames: light and alpha, layers for compositing, and the attributes of the EXR."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.frames import FrameRate
from pipeline.production.request.render_request import RenderRequest
from render.movie.sequences import timecode
from render.post.compositing import LayerInputs, Viewpoint, compositing_layers, mattes_header
from render.post.exr_attributes import ExrAttributes
from render.post.image import write_exr
from render.scene.aovs import RenderedFrame
from render.scene.light_groups import light_layers
from render.scene.materials import LOOKS, Material
from render.scene.scene import SUBJECT

if TYPE_CHECKING:
    from pipeline.production.render_inputs.framing import Framing


@dataclass(frozen=True)
class FinishedFrames:
    """Writes the finished frames of a request.

    framings  camera and stage of every picture
    """

    request: RenderRequest
    framings: Mapping[int, Framing]

    def write(self, path: Path, number: int, frame: RenderedFrame, header: Mapping[str, Any]) -> None:
        """Write a finished frame; `frame` has the raw AOVs, and the finished light as its beauty."""
        request, standard = self.request, {}
        shadow = {"shadow": frame["shadow"]} if "shadow" in frame.arrays else {}
        alpha = np.minimum(sum(shadow.values(), frame["alpha"]), np.float32(1.0))
        groups = {name: frame[name] for name in light_layers(frame.arrays)}
        layers = light = {"beauty": frame["beauty"], "alpha": alpha, **groups}
        if request.summary.layers is not None:
            inputs = self._inputs(number)
            extra = {name: frame[name] for name, _ in request.summary.precision if name in frame.arrays}
            layers = {**extra, **compositing_layers(frame, inputs), **shadow, **light}
            standard = mattes_header(frame, inputs, request.summary.layers)
        write_exr(
            path,
            RenderedFrame(layers, frame.facts),
            header,
            dict(request.summary.precision),
            attributes=exr_attributes(request, number, self.framings),
            standard=standard,
            convention=request.summary.layers,
        )

    def _inputs(self, number: int) -> LayerInputs:
        """Return what `compositing_layers` needs besides the AOVs."""
        from pipeline.production.render_inputs.shading import framing_at  # takes a moment

        picture, quality = self.request.picture(number), self.request.quality
        around = (framing_at(self.framings, number, offset) for offset in (0.0, -1.0, 1.0))
        now, before, after = (Viewpoint(framing.camera, framing.placement) for framing in around)
        size = quality.width, quality.height
        parts = self.request.parts
        materials = {
            part.source.subject or SUBJECT: material_name(part.picture(number).look) for part in parts
        }
        copies = self.request.copies
        return LayerInputs(now, before, after, size, picture.stage, materials, copies)


def material_name(look: Material) -> str:
    """Return the name of a look, or of its model where it is no look by name."""
    return next((name for name, known in LOOKS.items() if known == look), look.model)


def exr_attributes(request: RenderRequest, number: int, framings: Mapping[int, Framing]) -> ExrAttributes:
    """Return the standard attributes of a finished picture."""
    rate = FrameRate.of(request.source.summary.rate).fps
    return replace(raw_attributes(request, framings[number]), rate=rate, timecode=timecode(number, rate))


def raw_attributes(request: RenderRequest, framing: Framing) -> ExrAttributes:
    """Return the standard attributes of a raw picture, whose key knows no frame rate."""
    quality = request.quality
    return ExrAttributes(
        whole=(quality.width, quality.height),
        corner=quality.crop[:2] if quality.crop else (0, 0),
        camera=framing.camera,
    )
