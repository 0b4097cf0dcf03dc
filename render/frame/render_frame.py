"""One frame: passes of a few samples each, averaged, with everything a denoiser or a compositor wants.

Passes give progress, a place to stop, and a bound on sparkles. The box film and the fixed order of the
sum make a frame the same to the last bit however often and with however many threads it is rendered.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np

from render.frame.checkpoint import Checkpoint
from render.frame.motion_samples import Moment, Shutter, subframes
from render.frame.rendered_frame import Pixels, RenderedFrame
from render.frame.sample_batches import Passes
from render.frame.vertex_aovs import marks_of, stage_motion
from render.mitsuba.engine import Engine
from render.mitsuba.scene import build_scene
from render.scene.camera import Camera
from render.scene.lights import LightRig
from render.scene.look import Look
from render.scene.quality import Quality
from render.scene.spheres import Spheres
from render.scene.stage import Placement, Stage
from render.scene.surface import Surface


def render_frame(
    surface: Surface | Spheres,
    look: Look,
    lights: LightRig,
    stage: Stage,
    placement: Placement,
    camera: Camera,
    quality: Quality,
    seed: int,
    engine: Engine,
    on_pass: Callable[[int, int], None] | None = None,
    *,
    aovs: Collection[str] = (),
    shutter: Shutter | None = None,
    following: Moment | None = None,
    keep: Checkpoint | None = None,
) -> RenderedFrame:
    """Render one frame with `engine`, which is started here if it was not yet.

    aovs       the layers wanted beyond those that all pictures have: names of `aovs.EXTRA`. Velocity takes
               the surface's attribute of that name, rest its material
    shutter    while it is open, the picture is the mean of sub-frames: see `shutter.subframes`
    following  the same points at the next frame, for the layer motion
    keep       where its passes are kept, for it to go on from there should it be ended before it is done

    `on_pass(done, total)` is called after each pass; what it raises ends the frame.
    Raises BadInputError for a surface that is empty, not finite or badly indexed, and for a layer that lacks
    what it is made from.
    """
    engine.start()
    clock = Clock()
    size = quality.width, quality.height
    own = Moment(surface, placement, camera)
    marks = marks_of(own, following, aovs, size)
    way = 0.0 if shutter is None else shutter.longest_way(size)
    count = subframes(way, quality.samples)
    offsets = [0.0] if shutter is None else shutter.offsets(count)
    passes = Passes(quality, count, aovs, seed, on_pass, keep)
    clock.spent("preparing")
    shown: Surface | None = None

    def shown_at(subframe: int) -> tuple[Moment, Surface]:
        offset = offsets[subframe]
        moment = own if shutter is None or offset == 0.0 else shutter.at(offset)
        return moment, moment.dyed(marks).surface(quality.width)

    for subframe, its_passes in groupby(passes.left(), attrgetter("subframe")):
        moment, shown = shown_at(subframe)
        scenes = build_scene(
            shown,
            look,
            lights,
            stage,
            moment.placement,
            moment.camera,
            size,
            quality.depth,
            aovs,
            quality.crop,
        )
        clock.spent("building")
        for one in its_passes:
            passes.render(one, scenes, {name: shown.attributes[name] for name in marks})
        clock.spent("rendering")
    shown = shown or shown_at(count - 1)[1]  # all passes were taken from where they had been kept
    layers = passes.layers()
    if "motion" in layers and following is not None and stage.kind != "none":
        layers["motion"] = _with_stage(layers, own, following, size)
    facts = {
        "seed": seed,
        **passes.facts(),
        "auxiliary_samples": quality.auxiliary_samples,
        "depth": quality.depth,
        "lens_radius": camera.lens_radius,
        "surface_vertices": len(shown.vertices),
        "surface_faces": len(shown.faces),
        **({} if shutter is None else _facts_of(shutter, way, count)),
        **engine.facts(),
    }
    return RenderedFrame(layers, facts, clock.seconds)


class Clock:
    """Seconds by what they were spent on, since it was made."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def spent(self, what: str) -> None:
        """All since the last call."""
        now = time.perf_counter()
        self.seconds[what] = self.seconds.get(what, 0.0) + now - self._last
        self._last = now


def _facts_of(shutter: Shutter, way: float, count: int) -> dict[str, Any]:
    return {
        "shutter": [shutter.opens, shutter.closes],
        "subframes": count,
        "pixels_between_subframes": round(way / count, 3),
    }


def _with_stage(
    layers: Mapping[str, Pixels], own: Moment, following: Moment, size: tuple[int, int]
) -> Pixels:
    """The motion of the subject, and of the stage where it is seen."""
    there = np.clip(1.0 - layers["matte"], 0.0, 1.0) * (layers["depth"] > 0.0)
    motion = stage_motion(layers["position"].astype(np.float64), own, following, size)
    return np.asarray(layers["motion"] + there[..., None] * motion, dtype=np.float32)
