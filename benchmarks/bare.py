"""`python -m benchmarks.bare [SHOT …] [--frames N] [--lean]`: `flowsculpt render` over a bare script.

Both make the draft of a shot from its file to its movie, from an empty store, with compiled kernels cached.
The script is one process: our simulation and normals with all meshes in memory, our framing, the materials,
lights and stage of the shot as Mitsuba's scene, Mitsuba's `path` with `aov` at the shot's samples, the
denoiser at the quality's effort, ACES by our table, and x264. It has no store, no keys, no checkpoints, no
raw pictures, no adaptive or guided sampling, and starts Python once. Shots that need a medium or motion blur
are not for it. `aov` around `path` doubles what a path costs: `--lean` renders the features apart, with the
samples that the quality has for them.

CPU seconds are those of all processes of each, user and system. Both run on one core: where two cores share
their units, as virtual ones do, a second thread lengthens the CPU seconds of the first. `--frames N` renders
the first N pictures; the mesh frames are all simulated, since the camera depends on them. Target: at most
0.85 times the script, 0.75 times the lean one.
Writes `benchmarks/out/bare.json`, and both movies beside it.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from argparse import ArgumentParser
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.first_film import CHECKOUT, run
from benchmarks.report import OUT, Row, Target, keep, show
from flowsculpt.pipeline.arrays import AnyArray

if TYPE_CHECKING:  # the script imports what it needs, as one does
    from flowsculpt.pipeline.production.request.framing import Framing
    from flowsculpt.pipeline.production.request.render_request import RenderRequest

SHOTS = ("A010_cube", "A020_lorenz", "A030_taffy", "B100_torus")
QUALITY = "draft"
FEATURES = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"}
MOST, MOST_LEAN = 0.85, 0.75
"""Targets: CPU seconds of the pipeline over those of the script, and of the lean one."""


def measure(shot: str, count: int | None, lean: bool) -> Row:
    """Return the CPU seconds of both. Raises CalledProcessError where one fails."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    path = CHECKOUT / f"shots/{shot}.yaml"
    frames = ["-f", f"1-{count}"] if count else []
    OUT.mkdir(exist_ok=True)
    movie = OUT / f"bare_{shot}.mp4"
    script = [sys.executable, "-m", "benchmarks.bare", "--script", path, movie, *frames]
    script += ["--lean"] if lean else []
    ours = [CHECKOUT / ".venv/bin/flowsculpt", "render", path, "--no-progress", *frames]
    with tempfile.TemporaryDirectory() as root:
        bare = run([str(word) for word in script], CHECKOUT, environment)
        whole = run([*ours, "--root", root], CHECKOUT, environment)
        made = next(Path(root, "renders").rglob("*.mp4"))
        shutil.copy(made, OUT / f"pipeline_{shot}.mp4")
    return {
        "shot": shot,
        "script, CPU s": bare.processor,
        "pipeline, CPU s": whole.processor,
        "pipeline over script": whole.processor / bare.processor,
        "script, s": bare.clock,
        "pipeline, s": whole.clock,
    }


def make_movie(path: Path, movie: Path, count: int | None, lean: bool) -> None:
    """Make the movie of a shot's first pictures, as a script would."""
    import imageio.v3 as iio

    from flowsculpt.render.mitsuba.engine import choose
    from flowsculpt.render.post.colour import quantise, to_display

    choose().start()
    with iio.imopen(movie, "w", plugin="pyav") as file:
        file.init_video_stream("libx264", fps=24.0, pixel_format="yuv420p")
        for light in pictures(path, count, lean):
            file.write_frame(quantise(to_display(light)))


def pictures(path: Path, count: int | None, lean: bool) -> Iterator[AnyArray]:
    """Yield denoised pictures (H, W, 3) of a shot."""
    import drjit as dr
    import mitsuba as mi
    import pyoidn

    from flowsculpt.pipeline.animation import animate
    from flowsculpt.pipeline.production.request.framing import Framer
    from flowsculpt.pipeline.production.request.render_request import RenderRequest
    from flowsculpt.pipeline.production.request.shading import Shading
    from flowsculpt.pipeline.production.request.shot_source import ShotSource

    source = ShotSource(path.read_text(encoding="utf-8"), path).with_inputs()
    request = RenderRequest(source, QUALITY, mi.variant(), ()).whole()
    picture = request.shot.picture
    meshes = list(animate(request.shot))
    views = [request.pictures.view(frame.number) for frame in meshes]
    aspect, follow = request.pictures.aspect, request.shot.picture.camera.follow
    framings = Framer(views, lambda i: meshes[i].mesh.vertices, aspect, follow).all()
    quality = request.pictures.quality
    for frame, framing in list(zip(meshes, framings, strict=True))[:count]:
        there = framing.with_stage_in_view(picture.stage, request.pictures.flat_aspect)
        shading = Shading.of(frame, request.shot.motion.thresholds_at(frame.number), picture.tessellate)
        scene, path_tracer = mitsuba_scene(request, frame.number, there, shading.arrays())

        def layers_of(integrator: Any, samples: int, scene: Any = scene, seed: int = frame.number) -> Any:
            return np.array(mi.render(scene, integrator=mi.load_dict(integrator), spp=samples, seed=seed))

        if lean:
            parts = layers_of(path_tracer, quality.samples), layers_of(FEATURES, quality.auxiliary_samples)
            layers = np.concatenate(parts, axis=2)
        else:
            layers = layers_of({**FEATURES, "path": path_tracer}, quality.samples)
        colour, albedo, normal = (np.ascontiguousarray(layers[..., i : i + 3]) for i in (0, 3, 6))
        yield pyoidn.denoise(colour, albedo, normal, hdr=True, clean_aux=True, quality=quality.denoise)
        dr.flush_malloc_cache()


def mitsuba_scene(
    request: RenderRequest, number: int, framing: Framing, arrays: Mapping[str, AnyArray]
) -> tuple[Any, Any]:
    """Return Mitsuba's scene of a frame, and the description of its `path`."""
    import mitsuba as mi

    from flowsculpt.render.mitsuba import emitters, materials
    from flowsculpt.render.mitsuba.sensor import sensor
    from flowsculpt.render.mitsuba.shapes import mesh, stage_shapes
    from flowsculpt.render.mitsuba.texture_coordinates import texture_coordinates
    from flowsculpt.render.scene.scene import Scene
    from flowsculpt.render.scene.surface import Surface

    picture = request.pictures.of(number)
    surface = Surface(arrays["vertices"], arrays["normals"], arrays["faces"], {}, arrays["material"])
    described = Scene(surface, picture.look, picture.lights, picture.stage, framing.placement, framing.camera)
    size = request.pictures.quality.width, request.pictures.quality.height
    split, coordinates = texture_coordinates(surface, picture.look)
    bsdf = materials.surface_bsdf(picture.look, (), coordinates, framing.placement.size)
    path = materials.path_integrator([picture.look], request.pictures.quality.depth)
    path["hide_emitters"] = not picture.lights.shows_sky
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(framing.camera, size),
            "subject": mesh("subject", split, bsdf, coordinates.values),
            **stage_shapes(described, size),
            **emitters.emitters(picture.lights, framing.placement.matrix()),
        }
    )
    return scene, path


def main(words: Sequence[str] = ()) -> list[Target]:
    """Measure the shots that the words name; return the targets."""
    parser = ArgumentParser(prog="python -m benchmarks.bare")
    parser.add_argument("shots", nargs="*")
    parser.add_argument("-f", "--frames", help="how many, or the range 1-N")
    parser.add_argument("--lean", action="store_true", help="a script that renders features apart")
    parser.add_argument("--script", action="store_true", help="make the movie SHOT MOVIE here")
    chosen = parser.parse_args(words)
    count = int(chosen.frames.rpartition("-")[2]) if chosen.frames else None
    if chosen.script:
        make_movie(Path(chosen.shots[0]), Path(chosen.shots[1]), count, chosen.lean)
        return []
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    rows = [measure(shot, count, chosen.lean) for shot in chosen.shots or SHOTS]
    show(f"A draft over a {'lean' if chosen.lean else 'bare'} script", rows)
    keep("bare_lean" if chosen.lean else "bare", rows)
    most = MOST_LEAN if chosen.lean else MOST
    return [
        Target(str(row["shot"]), "pipeline over script", float(row["pipeline over script"]), most=most)
        for row in rows
    ]


if __name__ == "__main__":
    if found := main(sys.argv[1:]):
        show("Targets", [target.row for target in found])
