"""Show the first pictures of a run while it goes on: `python -m … PLAN [--no-animatic]`, in the root.

The animatic is drawn from the meshes and cameras that the jobs of the run store, each shot as soon as they
are there, so that nothing is simulated for it. The first finished frame is written as a PNG. A line on
standard output says where each is, or why there is none: nothing of the run rests on either. The process
leaves with the one that started it.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from flowsculpt import FlowsculptError, FrameError
from flowsculpt.api import plural
from flowsculpt.api.frames import Plan, RenderRequest, Runs, Store

if TYPE_CHECKING:  # who only waits for a frame needs no rasteriser
    from flowsculpt.pipeline.plugins.preview.animatic import Animatic

POLL_SECONDS = 0.2

NAME = "animatic"
"""Stands for a job and its stage in the event log, where the CPU seconds of this process are."""

WITHOUT = "--no-animatic"


def shown_requests(plan: Plan) -> list[RenderRequest]:
    """Return the requests that a plan shows: the clips of its film in order, or those with a movie."""
    of_film = [job.requests for job in plan.jobs if job.stage == "film"]
    places = of_film[0] if of_film else [place for place, stage in plan.goals if stage == "assemble"]
    return [plan.requests[place] for place in places]


def main(plan_file: str, *words: str) -> None:
    """Show the first pictures of the run of a frozen plan."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this process ends it
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_leave_with, args=(os.getppid(),), daemon=True).start()
    pictures = FirstPictures(Path.cwd(), Plan.thaw(Path(plan_file)))
    frame = threading.Thread(target=pictures.say, args=("first finished frame", pictures.frame), daemon=True)
    frame.start()
    if WITHOUT not in words:
        pictures.say("animatic", pictures.animatics)
    frame.join()


def _leave(number: int, frame: FrameType | None) -> None:
    sys.exit(0)  # files that are being written are removed


def _leave_with(parent: int) -> None:
    """End this process once the one that started it is gone."""
    while os.getppid() == parent:
        time.sleep(POLL_SECONDS)
    os.kill(os.getpid(), signal.SIGTERM)


class FirstPictures:
    """The first pictures of the run of a plan."""

    def __init__(self, root: Path, plan: Plan) -> None:
        self._root, self._plan, self._store = root, plan, Store(root)
        self._runs, self._cpu = Runs(root), 0.0

    def say(self, what: str, make: Callable[[], Iterator[str]]) -> None:
        """Print the lines that `make` yields, or why it could not."""
        try:
            for line in make():
                print(line, flush=True)
        except (FlowsculptError, OSError) as error:
            print(f"the {what} is left out: {error}", flush=True)
        except Exception as error:
            fault = f"{type(error).__name__}: {error}; this is a bug in flowsculpt"
            print(f"the {what} is left out: {fault}", flush=True)
        taken, self._cpu = time.process_time() - self._cpu, time.process_time()
        self._runs.note_work(self._plan, NAME, taken)

    def animatics(self) -> Iterator[str]:
        """Draw the animatic of the film, or of each shot when it can be drawn; yield where they are."""
        from flowsculpt.pipeline.plugins.preview.animatic import FOLDER, Animatic, write_film_animatic
        from flowsculpt.pipeline.plugins.preview.sketch import Sketch
        from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream

        requests = [request.with_cache(self._root) for request in shown_requests(self._plan)]
        with ExitStack() as stack:
            animatics = [
                Animatic(Sketch(request), stack.enter_context(SurfaceStream(self._store, once=True)))
                for request in requests
            ]
            if self._plan.film is not None:
                path = self._plan.film.path(FOLDER)
                frames = write_film_animatic(
                    self._plan.film,
                    animatics,
                    self._root / path,
                    _ignore,
                    ready=lambda clip: self._wait_for([clip]),
                )
                yield _words(path, frames)
                return
            while animatics:
                animatics.remove(ready := self._wait_for(animatics))
                path = ready.sketch.path()
                yield _words(path, ready.movie(self._root / path, _ignore))

    def frame(self) -> Iterator[str]:
        """Write the first frame that the run finishes as a PNG; yield where it is."""
        from flowsculpt.api.frames import FinishedPictures
        from flowsculpt.api.pictures import write_still

        job, number = self._first_finished()
        request = self._plan.requests[self._plan.job(job).requests[0]].with_cache(self._root)
        finished = FinishedPictures(request, self._store)
        if (frame := finished.key(number)) is None:
            raise FrameError(f"frame {number} is no longer there", number)
        key = request.keys.still("png", frame)
        header = {"shot": request.name, "frame": number, "key": key}

        def write(path: Path) -> None:
            pixels = finished.pixels(number)
            assert pixels is not None, "its key is known"
            write_still(path, pixels, header, projection=request.pictures.projection)

        self._store.put("png", key, write)
        self._store.link("png", key, request.place("png", number))
        yield f"First finished frame: {request.place('png', number)}"

    def _first_finished(self) -> tuple[str, int]:
        """Wait for a frame of the run that is finished; return its job and its number."""
        reader = Runs(self._root).reader(self._plan.name)
        while True:
            for event in reader.new("finish"):
                if event["event"] == "frame" and event["stage"] == "finish":
                    return str(event["job"]), int(event["frame"])
            time.sleep(POLL_SECONDS)

    def _wait_for(self, animatics: Sequence[Animatic]) -> Animatic:
        """Return the first of the animatics whose cameras, and so all mesh frames, are here; wait for one."""
        while True:
            for animatic in animatics:
                if self._store.is_here("cameras", animatic.sketch.request.keys.cameras):
                    return animatic
            time.sleep(POLL_SECONDS)


def _words(path: Path, frames: int) -> str:
    return f"Animatic: {path} ({plural(frames, 'frame')}, drawn without a path tracer)"


def _ignore(stage: str, number: int) -> None: ...


if __name__ == "__main__":
    main(*sys.argv[1:])
