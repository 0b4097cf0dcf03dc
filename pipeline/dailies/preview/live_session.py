"""Follow a shot: show each frame once it is simulated, and after an edit the frames that it changed."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pipeline.animation import FrameProgress
from pipeline.dailies.preview.animatic import SIZES, FramedSurfaces, framings_of, size_for
from pipeline.dailies.preview.live_server import LiveFeed
from pipeline.dailies.preview.sketch import Sketch, is_closed
from pipeline.dailies.preview.surface_stream import SurfaceStream
from pipeline.errors import FlowsculptError
from pipeline.production.render_inputs.framing import Framing
from pipeline.production.render_inputs.shading import STEP, flow_cache_data
from pipeline.production.request.keys import speed_data
from pipeline.production.request.shot_source import ShotSource
from render.post.image import jpeg_bytes


class EditedError(Exception):
    """Raised when the shot is saved while its last state is still being drawn."""


@dataclass(frozen=True)
class Drawn:
    """A picture, and the recipe that it was drawn from."""

    recipe: tuple[Any, ...]
    jpeg: bytes


@dataclass(eq=False)
class LiveSession:
    """Shows a shot on the live page.

    read     reads the shot
    done     called when the whole shot is shown with the cameras of the render
    watched  paths whose changes are edits
    """

    read: Callable[[], Sketch]
    feed: LiveFeed
    stream: SurfaceStream
    done: Callable[[FramedSurfaces], None]
    watched: set[Path]
    _before: Stamp = frozenset()
    _drawn: dict[int, Drawn] = field(default_factory=dict)
    _framings: Mapping[int, Framing] = field(default_factory=dict)

    def show_once(self) -> None:
        """Show the shot as it is. Raises FlowsculptError."""
        self._show(lambda: None)

    def follow(self) -> None:
        """Show the shot now and after each save, until the process is interrupted."""
        while True:
            self._before = stamp(self.watched)
            try:
                self._show(self._require_unedited)
                self.feed.say("Save the shot file to see what changes.")
            except EditedError:
                continue
            except FlowsculptError as error:
                self.feed.say(str(error), trouble=True)
            wait_for_edit(self.watched, self._before)

    def _require_unedited(self) -> None:
        if stamp(self.watched) != self._before:
            raise EditedError

    def _show(self, check: Callable[[], None]) -> None:
        """Show the shot; call `check` between frames."""
        sketch = self.read()
        request, known_before = sketch.request, set(self.watched)
        self.watched |= files_of(request.source)
        self._before |= stamp(self.watched - known_before)
        numbers, size = sorted(request.angles), size_for(request.aspect, SIZES["movie"])
        take_number = self.feed.begin(
            request.name, numbers[0], numbers[-1], float(request.shot.rate.fps), size
        )
        self.feed.say("Simulating …")

        def within_frame(progress: FrameProgress) -> None:
            check()
            self.feed.say(
                progress.slow or f"Frame {progress.frame}: {progress.share:.0%}, {progress.activity} …"
            )

        self.stream.callback = within_frame
        known = request.framings(self.stream.store) or self._framings
        for number in self.stream.play(request, numbers):
            check()
            if number == numbers[0]:
                sketch = replace(sketch, closed=is_closed(self.stream.arrays(request, number)))
            framing = known.get(number) or framings_of(request, self.stream, [number])[number]
            self._draw(
                take_number, FramedSurfaces(sketch, self.stream, {number: framing}), [number], size, check
            )
        self._framings = request.framings(self.stream.store) or framings_of(request, self.stream, numbers)
        surfaces = FramedSurfaces(sketch, self.stream, self._framings)
        self.feed.say("Framing …")
        self._draw(take_number, surfaces, numbers, size, check)
        self.feed.say("Writing the movie …")
        self.done(surfaces)
        self.feed.say("Done.")

    def _draw(
        self,
        take: int,
        surfaces: FramedSurfaces,
        numbers: Iterable[int],
        size: tuple[int, int],
        check: Callable[[], None],
    ) -> None:
        """Show frames; pictures whose recipe is unchanged are reused."""
        recipes = {number: _recipe(surfaces, number) for number in numbers}
        stale = []
        for number, recipe in recipes.items():
            drawn = self._drawn.get(number)
            if drawn is None or drawn.recipe != recipe:
                stale.append(number)
            elif self.feed.picture(take, number) is not drawn.jpeg:
                self.feed.show(take, number, drawn.jpeg)
        for number, picture in zip(stale, surfaces.pictures(stale, size, "srgb"), strict=True):
            check()
            self._drawn[number] = Drawn(recipes[number], jpeg_bytes(picture))
            self.feed.show(take, number, self._drawn[number].jpeg)


def files_of(source: ShotSource) -> set[Path]:
    """Return all files that a shot was read from."""
    pinned = [Path(path) for path, _ in source.inputs or ()]
    return {source.path, *(source.path.with_name(name) for name, _ in source.beside), *pinned}


def _recipe(surfaces: FramedSurfaces, number: int) -> tuple[Any, ...]:
    """Return everything that decides a picture."""
    request, sketch = surfaces.sketch.request, surfaces.sketch
    shown = request.shot.picture
    flows = repr(flow_cache_data(request.shot.motion, number, (0.0, STEP))) if sketch.flow else ""
    return (
        request.normals_key(number),
        repr(speed_data(request, number)),
        surfaces.framings[number],
        (shown.look, shown.lights, shown.stage, shown.view),
        (sketch.flow, flows, sketch.edges, sketch.burn_in),
    )


POLL_SECONDS = 0.1
"""Seconds between checks for an edit."""

Stamp = frozenset[tuple[str, int, int]]
"""Paths with the time they were last written, ns, and their sizes."""


def stamp(paths: Collection[Path]) -> Stamp:
    """Return the stamp of files. Missing ones count: editors may remove a file before they save it."""
    entries = set()
    for path in paths:
        try:
            facts = path.stat()
            entries.add((str(path), facts.st_mtime_ns, facts.st_size))
        except OSError:
            entries.add((str(path), 0, 0))
    return frozenset(entries)


def wait_for_edit(paths: Collection[Path], before: Stamp) -> None:
    """Wait until files differ from `before` and have stopped changing."""
    now = before
    while now == before:
        time.sleep(POLL_SECONDS)
        now = stamp(paths)
    last = before
    while now != last:
        time.sleep(POLL_SECONDS / 2)
        last, now = now, stamp(paths)
