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
import pyoidn

from benchmarks.measures import told
from benchmarks.report import Row, Target, keep, show
from benchmarks.sitting import Sitting
from render.mitsuba.engine import Engine, choose
from render.post.colour import prepare

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

        from render.integrator.path_tracer import PathTracer

        render, follow, denoise = mi.render, PathTracer.render, pyoidn.denoise

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
            return self.timed("denoiser", lambda: denoise(*arguments, **others))

        mi.render, PathTracer.render, pyoidn.denoise = rendered, followed, denoised
        try:
            yield
        finally:
            mi.render, PathTracer.render, pyoidn.denoise = render, follow, denoise


def _layer(integrator: Any) -> str:
    """Return the activity of a render of AOVs: auxiliary features read positions, vertex AOVs do not."""
    return "auxiliary features" if "position" in str(integrator) else "vertex AOVs"


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
    show("Targets", [target.row for target in main(*map(int, given[:1]), *given[1:2], *map(int, given[2:]))])
