"""`python -m benchmarks.overhead [FRAMES] [SCALE] [STEADY …]`: the seconds of a frame beside rendering it.

A sculpture of some 67,000 vertices is made by the production's own jobs as on two cores: one job with one
thread for each core, of which one is measured. 1280 × 720 pixels unless SCALE (per cent of 1920 × 1080) says
otherwise, 64 samples of light and of the auxiliary features. Seconds within `mi.render` and our path tracer,
until the picture is there, and within the denoiser are counted apart from all others; so both sides of the
ratio come from the same frames and the same moments of a busy machine. Then the light of the last frame is
rendered in one call of 64 samples, which measures the cost of sample batches. Writes
`benchmarks/out/overhead.json`.

Runs twice unless STEADY says otherwise: without temporal denoising, and with 2 frames to either side, whose
AOVs take batches of their own. A frame includes neither simulation nor the start of Python and Snakemake.

`python -m benchmarks.overhead digests [SCALE]`: the share of digests in finishing a frame, for scenes of four
kinds. Finishing reads a rendered frame with its AOVs, removes its noise, and writes the finished one. Both
files are hashed. Few samples leave the most noise, which packs worst, so these files are the largest.
Writes `benchmarks/out/digests.json`.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measures import told
from benchmarks.report import Row, Target, keep, show
from benchmarks.sitting import Sitting
from flowsculpt.pipeline.production.store.digests import Digests
from flowsculpt.render.mitsuba.engine import Engine, choose
from flowsculpt.render.post import denoise
from flowsculpt.render.post.colour import prepare

SHOT = """\
title: A box of 50,000 vertices, twisted
frames: 1-8
rate: 24
subject: {{solid: box, size: [2, 2, 2]}}
resample: {{max_edge_length: 0.034}}
flows:
  - twist: {{axis: y, amount: {{ease: linear, keys: {{1: 0, 8: 60}}}}}}
look: glaze
camera: {{azimuth: -24, elevation: 14}}
lights: studio
stage: cyclorama
quality: {{final: {{samples: 64, auxiliary_samples: 64, depth: 6, temporal_denoise: {steady}}}}}
"""

BEFORE, WATCHED = ("simulate", "frame_camera"), ("smooth_normals", "render", "finish", "assemble")
MOST = 0.08
"""Target: all other seconds over those of rendering and denoising."""


@dataclass
class Watch:
    """Seconds by activity."""

    seconds: dict[str, float] = field(default_factory=dict)
    light: Callable[[], Any] | None = None
    """Renders the last rendered light again, in one call."""

    def timed(self, what: str, work: Callable[[], Any]) -> Any:
        begun = time.perf_counter()
        answer = work()
        self.seconds[what] = self.seconds.get(what, 0.0) + time.perf_counter() - begun
        return answer

    @contextmanager
    def over(self) -> Iterator[None]:
        """Record within the context how long `mi.render`, our path tracer and the denoiser take."""
        import drjit as dr
        import mitsuba as mi

        from flowsculpt.render.integrator.feature_tracer import FeatureTracer
        from flowsculpt.render.integrator.path_tracer import PathTracer

        render, follow, filtered = mi.render, PathTracer.render, denoise._filtered
        features = FeatureTracer.render

        def rendered(scene: Any, *arguments: Any, integrator: Any, **others: Any) -> Any:
            def work() -> Any:
                picture = render(scene, *arguments, integrator=integrator, **others)
                dr.eval(picture)
                dr.sync_thread()
                return picture

            is_light = "path" in str(integrator).lower().split("[")[0]
            if is_light:
                self.light = lambda: np.array(render(scene, integrator=integrator, spp=64, seed=1))
            return self.timed("light" if is_light else _layer(integrator), work)

        def followed(tracer: PathTracer, *arguments: Any) -> Any:
            self.light = lambda: follow(tracer, 64, 0, 1)
            return self.timed("light", lambda: follow(tracer, *arguments))

        def denoised(*arguments: Any, **others: Any) -> Any:
            return self.timed("denoiser", lambda: filtered(*arguments, **others))

        def traced(tracer: FeatureTracer, *arguments: Any) -> Any:
            return self.timed("auxiliary features", lambda: features(tracer, *arguments))

        mi.render, PathTracer.render, denoise._filtered = rendered, followed, denoised
        FeatureTracer.render = traced
        try:
            yield
        finally:
            mi.render, PathTracer.render, denoise._filtered = render, follow, filtered
            FeatureTracer.render = features

    @contextmanager
    def over_digests(self) -> Iterator[None]:
        """Record within the context how long digests take: reading records, hashing, and recording."""
        methods = {name: getattr(Digests, name) for name in ("add", "add_copy", "check")}

        def timed(method: Callable[..., Any]) -> Callable[..., Any]:
            return lambda *arguments: self.timed("digests", lambda: method(*arguments))

        for name, method in methods.items():
            setattr(Digests, name, timed(method))
        try:
            yield
        finally:
            for name, method in methods.items():
                setattr(Digests, name, method)


def _layer(integrator: Any) -> str:
    """Return the activity of a render of AOVs: auxiliary features read positions, vertex AOVs do not."""
    return "auxiliary features" if "position" in str(integrator) else "vertex AOVs"


SCENES = {
    "mesh, glaze": "subject: {solid: box, size: [2, 2, 2]}\nresample: {max_edge_length: 0.1}\nlook: glaze",
    "glass": "subject: {solid: icosphere, radius: 1}\nresample: {max_edge_length: 0.2}\nlook: glass",
    "points": "subject: {cloud: {solid: torus, tube_radius: 0.3}, count: 20000, seed: 1, radius: 0.01}",
    "all AOVs, 32 bits": "subject: {solid: torus, tube_radius: 0.3}\nresample: {max_edge_length: 0.1}\n"
    "look: marble\naovs: {velocity: float, motion: float, position: float, normal: float, albedo: float}",
}
"""Scenes whose files differ most in size and packing."""

SCENE = """\
title: Digests
frames: 1-4
rate: 24
{scene}
flows:
  - twist: {{axis: y, amount: {{ease: linear, keys: {{1: 0, 4: 30}}}}}}
quality: {{final: {{samples: 4, auxiliary_samples: 4, temporal_denoise: {steady}}}}}
"""

MOST_OF_DIGESTS = 0.03
"""Target: the seconds of digests over those of finishing a frame."""


def digests(scale: str = "100") -> list[Target]:
    """Measure the share of digests in finishing the frames of all scenes; return the targets."""
    prepare()
    engine = choose(threads=1)
    engine.start()
    rows = [_digests(name, scale, steady, engine) for name in SCENES for steady in (0, 2)]
    show("Digests in finishing a frame", rows)
    keep("digests", rows)
    return [
        Target(str(row["scene"]), "digests, share", told(row, "share"), most=MOST_OF_DIGESTS) for row in rows
    ]


def _digests(name: str, scale: str, steady: int, engine: Engine) -> Row:
    """Return the mean seconds of finishing a frame of a scene, and those of the digests within."""
    quality, watch = f"final.scale{scale}", Watch()
    with tempfile.TemporaryDirectory() as folder:
        text = SCENE.format(scene=SCENES[name], steady=steady)
        shot = Sitting.of(Path(folder), text, quality, engine, 2, range(1, 5))
        shot.do_all([*BEFORE, "smooth_normals", "render"])
        begun = time.perf_counter()
        with watch.over_digests():
            shot.do_all(["finish"])
        seconds = time.perf_counter() - begun
        sizes = {
            kind: sum(path.stat().st_size for path in Path(folder).rglob(f"store/{kind}/*/*.exr")) / 4e6
            for kind in ("raw", "frame")
        }
    spent = watch.seconds["digests"]
    return {
        "scene": f"{name}; steady {steady}",
        **{f"{kind}, MB": size for kind, size in sizes.items()},
        "finishing, s": seconds / 4,
        "digests, s": spent / 4,
        "share": spent / (seconds - spent),
    }


def measure(frames: int, scale: str, steady: int, engine: Engine) -> Row:
    """Return the mean seconds of a frame by activity."""
    quality, numbers = f"final.scale{scale}", range(9 - frames, 9)
    watch, spent = Watch(), dict[str, float]()
    with tempfile.TemporaryDirectory() as folder:
        shot = Sitting.of(Path(folder), SHOT.format(steady=steady), quality, engine, 2, numbers)
        shot.do_all(BEFORE)
        cpu = time.process_time()
        with watch.over():
            for task in WATCHED:
                begun = time.perf_counter()
                shot.do_all([task])
                spent[task] = time.perf_counter() - begun
        cpu = time.process_time() - cpu
        stages_of = [shot.statistics(quality, number) for number in numbers]
    inside, total, once = watch.seconds, sum(spent.values()), _in_one_call(watch)
    calls = sum(inside.values())
    stages = {what: sum(each[what] for each in stages_of) for what in ("preparing", "building", "rendering")}
    seconds = {
        **inside,
        "normals": spent["smooth_normals"],
        "preparing": stages["preparing"],
        "building": stages["building"],
        "adding passes up": stages["rendering"] - (calls - inside["denoiser"]),
        "reading, EXR, store": spent["render"] - sum(stages.values()),
        "finishing, but the denoiser": spent["finish"] - inside["denoiser"],
        "view and encoding": spent["assemble"],
        "all": total,
        "CPU seconds, all": cpu,
    }
    return {
        "steady": float(steady),
        "vertices": stages_of[-1]["vertices"],
        **{what: each / frames for what, each in seconds.items()},
        "light in one call": once,
        "everything else, share": total / calls - 1.0,
        "auxiliary features and batches as ours": total / (once * frames + inside["denoiser"]) - 1.0,
    }


def _in_one_call(watch: Watch) -> float:
    assert watch.light is not None
    begun = time.perf_counter()
    watch.light()
    return time.perf_counter() - begun


def main(frames: int = 2, scale: str = "66.67", *steady: int) -> list[Target]:
    """Measure the overhead; return the target."""
    prepare()
    engine = choose(threads=1)
    engine.start()
    rows = [measure(frames, scale, each, engine) for each in steady or (0, 2)]
    for row in rows:
        show(
            f"A frame, seconds; steady {row['steady']:g}", [{"what": what, "s": s} for what, s in row.items()]
        )
    keep("overhead", rows)
    return [
        Target(
            f"a frame, steady {row['steady']:g}",
            "everything else",
            told(row, "everything else, share"),
            most=MOST,
        )
        for row in rows
    ]


if __name__ == "__main__":
    given = sys.argv[1:]
    if given[:1] == ["digests"]:
        show("Targets", [target.row for target in digests(*given[1:2])])
        sys.exit()
    show("Targets", [target.row for target in main(*map(int, given[:1]), *given[1:2], *map(int, given[2:]))])
