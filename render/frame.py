"""One frame: passes of a few samples each, averaged, with everything a denoiser or a compositor wants.

Passes give progress, a place to stop, and a bound on sparkles. The box film and the fixed order of the
sum make a frame the same to the last bit however often and with however many threads it is rendered.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.camera import Camera
from render.engine import Engine
from render.lights import LightRig
from render.look import Look
from render.quality import PASS_SAMPLES, Quality
from render.scene import Rendering, build_scene
from render.spheres import Spheres
from render.stage import Placement, Stage
from render.surface import Surface

Layer = NDArray[np.float32]

SPARKLE_FACTOR = 3.0
"""A pixel of one pass may be this much brighter than the third brightest of its eight neighbours."""

_LUMA = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, eq=False)
class Layers:
    """A picture's named float32 arrays, (H, W, 3) or (H, W), and the facts about it.

    `facts` are the same whenever the same frame is rendered; `seconds` say where this rendering's time
    went.

    beauty    linear Rec.709 radiance
    albedo    reflectance, within 0 … 1
    normal    shading normal, scene axes
    position  scene units
    depth     distance from the camera, scene units
    matte     how much of the pixel the subject covers, 0 … 1

    All are averages over the pixel, so at the subject's outline (matte between 0 and 1) position and
    depth lie between the subject's and the stage's.
    """

    arrays: Mapping[str, Layer]
    facts: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Layer:
        return self.arrays[name]

    def with_(self, **arrays: Layer) -> Layers:
        """The same picture with some layers added or replaced."""
        return Layers({**self.arrays, **arrays}, self.facts, self.seconds)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = next(iter(self.arrays.values())).shape[:2]
        return width, height


def seed_of(*parts: str | int) -> int:
    """One 32-bit seed from a shot's name, a frame, a pass; Mitsuba repeats neighbouring plain seeds."""
    text = "\x1f".join(str(part) for part in parts)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")


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
) -> Layers:
    """Render one frame with `engine`, which is started here if it was not yet.

    `on_pass(done, total)` is called after each pass; what it raises ends the frame.
    Raises BadInputError for a surface that is empty, not finite or badly indexed.
    """
    engine.start()
    begun = time.perf_counter()
    if isinstance(surface, Spheres):
        surface = surface.surface(camera, quality.width)
    beauty, guides = build_scene(
        surface,
        look,
        lights,
        stage,
        placement,
        camera,
        (quality.width, quality.height),
        quality.depth,
        quality.crop,
    )
    built = time.perf_counter()
    passes = [*_passes("guides", guides, quality.guides), *_passes("beauty", beauty, quality.samples)]
    sums: dict[str, NDArray[np.float64]] = {}
    for number, (layer, rendering, samples) in enumerate(passes):
        picture = _render(rendering, samples, seed_of(seed, number, layer))
        if layer == "beauty":
            picture = without_sparkles(picture[..., :3])
        sums[layer] = sums[layer] + picture if layer in sums else picture
        if on_pass is not None:
            on_pass(number + 1, len(passes))
    seconds = {"building": built - begun, "rendering": time.perf_counter() - built}
    facts = {
        "seed": seed,
        "samples": quality.samples,
        "guides": quality.guides,
        "depth": quality.depth,
        "lens_radius": camera.lens_radius,
        "surface_vertices": len(surface.vertices),
        "surface_faces": len(surface.faces),
        **engine.facts(),
    }
    return Layers(_named(sums, passes), facts, seconds)


def without_sparkles(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """(H, W, 3) radiance of one pass, lone bright pixels dimmed to the bound that SPARKLE_FACTOR sets.

    A highlight or a thin bright line has at least three bright neighbours at every pixel and passes
    unchanged; a path that found a lamp by luck has none.
    """
    luminance = light @ _LUMA
    height, width = luminance.shape
    padded = np.pad(luminance, 1, mode="edge")
    around = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3) if (y, x) != (1, 1)]
    third = np.partition(np.stack(around), 5, axis=0)[5]
    bound = SPARKLE_FACTOR * third + 1e-3
    return np.asarray(light * (bound / np.maximum(luminance, bound))[..., None], dtype=np.float64)


def _render(rendering: Rendering, samples: int, seed: int) -> NDArray[np.float64]:
    import drjit as dr
    import mitsuba as mi

    picture = np.array(
        mi.render(rendering.scene, integrator=rendering.integrator, spp=samples, seed=seed), dtype=np.float64
    )
    dr.flush_malloc_cache()
    return picture


def _passes(layer: str, rendering: Rendering, samples: int) -> list[tuple[str, Rendering, int]]:
    """Whole passes of equal weight; a last one that is smaller would count too much."""
    each = min(samples, PASS_SAMPLES)
    return [(layer, rendering, each)] * (samples // each)


def _named(
    sums: Mapping[str, NDArray[np.float64]], passes: list[tuple[str, Rendering, int]]
) -> dict[str, Layer]:
    """Averages by name. Mitsuba's AOVs: albedo 3, depth 1, position 3, normal 3, a phase and the matte."""
    count = {layer: sum(1 for name, _, _ in passes if name == layer) for layer in sums}
    aovs = sums["guides"] / count["guides"]
    parts = {
        "beauty": sums["beauty"] / count["beauty"],
        "albedo": np.clip(aovs[..., 0:3], 0.0, 1.0),
        "normal": aovs[..., 7:10],
        "position": aovs[..., 4:7],
        "depth": aovs[..., 3],
        "matte": np.clip(aovs[..., 11], 0.0, 1.0),
    }
    return {name: np.ascontiguousarray(array, dtype=np.float32) for name, array in parts.items()}
