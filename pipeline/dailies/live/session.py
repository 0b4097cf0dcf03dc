"""Following a shot: every frame shown as soon as it is simulated, and what an edit changed shown again."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pipeline.dailies.live.feed import LiveFeed
from pipeline.dailies.preview.animatic import SIZES, FramedSurfaces, aims, size_for
from pipeline.dailies.preview.sketch import Sketch, is_closed
from pipeline.dailies.preview.surface_stream import SurfaceStream
from pipeline.errors import FlowsculptError
from pipeline.production.render_inputs.framing import Framing
from pipeline.production.render_inputs.motion import STEP, flow_cache_data
from pipeline.production.request.shot_source import ShotSource
from render.post.image import jpeg_bytes


class EditedError(Exception):
    """The shot was saved while its last text was still being shown."""


@dataclass(frozen=True)
class Drawn:
    """A picture, and what it was drawn from."""

    recipe: tuple[Any, ...]
    jpeg: bytes


@dataclass(eq=False)
class LiveSession:
    """Shows what `read` makes of the shot, on a screen.

    done    is told when the whole shot is shown as renders will see it
    edited  paths whose changes are edits
    """

    read: Callable[[], Sketch]
    screen: LiveFeed
    stream: SurfaceStream
    done: Callable[[FramedSurfaces], None]
    edited: set[Path]
    _before: Stamp = frozenset()
    _drawn: dict[int, Drawn] = field(default_factory=dict)
    _framings: Mapping[int, Framing] = field(default_factory=dict)

    def show_once(self) -> None:
        """Show the shot as it is. Raises what reading and simulating it raise."""
        self._show(lambda: None)

    def follow(self) -> None:
        """Show the shot as it is, and each time that it is saved; until the process is interrupted."""
        while True:
            self._before = stamp(self.edited)
            try:
                self._show(self._require_unedited)
                self.screen.say("Save the shot file to see what changes.")
            except EditedError:
                continue
            except FlowsculptError as error:
                self.screen.say(str(error), trouble=True)
            wait_for_edit(self.edited, self._before)

    def _require_unedited(self) -> None:
        if stamp(self.edited) != self._before:
            raise EditedError

    def _show(self, check: Callable[[], None]) -> None:
        """`check` is called between frames."""
        sketch = self.read()
        request, known_before = sketch.request, set(self.edited)
        self.edited |= files_of(request.source)
        self._before |= stamp(self.edited - known_before)
        numbers, size = sorted(request.angles), size_for(request.aspect, SIZES["movie"])
        number_of_take = self.screen.begin(
            request.name, numbers[0], numbers[-1], float(request.shot.rate.fps), size
        )
        self.screen.say("Simulating …")
        known = request.framings(self.stream.store) or self._framings
        for number in self.stream.play(request, numbers):
            check()
            if number == numbers[0]:
                sketch = replace(sketch, closed=is_closed(self.stream.arrays(request, number)))
            framing = known.get(number) or aims(request, self.stream, [number])[number]
            self._draw(
                number_of_take, FramedSurfaces(sketch, self.stream, {number: framing}), [number], size, check
            )
        self._framings = request.framings(self.stream.store) or aims(request, self.stream, numbers)
        ready = FramedSurfaces(sketch, self.stream, self._framings)
        self.screen.say("Framing …")
        self._draw(number_of_take, ready, numbers, size, check)
        self.screen.say("Writing the movie …")
        self.done(ready)
        self.screen.say("Done.")

    def _draw(
        self,
        request: int,
        ready: FramedSurfaces,
        numbers: Iterable[int],
        size: tuple[int, int],
        check: Callable[[], None],
    ) -> None:
        """Show frames; those that would show what was shown before are not drawn again."""
        recipes = {number: _recipe(ready, number) for number in numbers}
        stale = []
        for number, recipe in recipes.items():
            drawn = self._drawn.get(number)
            if drawn is None or drawn.recipe != recipe:
                stale.append(number)
            elif self.screen.picture(request, number) is not drawn.jpeg:
                self.screen.show(request, number, drawn.jpeg)
        for number, picture in zip(stale, ready.pictures(stale, size, "srgb"), strict=True):
            check()
            self._drawn[number] = Drawn(recipes[number], jpeg_bytes(picture))
            self.screen.show(request, number, self._drawn[number].jpeg)


def files_of(source: ShotSource) -> set[Path]:
    """All that a shot is read from; but not files that come to lie beside it later."""
    pinned = [Path(path) for path, _ in source.inputs or ()]
    return {source.path, *(source.path.with_name(name) for name, _ in source.beside), *pinned}


def _recipe(ready: FramedSurfaces, number: int) -> tuple[Any, ...]:
    """What a picture is drawn from."""
    request, sketch = ready.sketch.request, ready.sketch
    shown = request.shot.picture
    flows = repr(flow_cache_data(request.shot.motion, number, (0.0, STEP))) if sketch.flow else ""
    return (
        request.normals_key(number),
        repr(request.speed_data(number)),
        ready.framings[number],
        (shown.look, shown.lights, shown.stage, shown.view),
        (sketch.flow, flows, sketch.edges, sketch.burn_in),
    )


LOOK_AGAIN = 0.1
"""Seconds between looks."""

Stamp = frozenset[tuple[str, int, int]]
"""Paths, and when they were last written, ns, and how large they are."""


def stamp(paths: Collection[Path]) -> Stamp:
    """Of files as they are; one that is not there counts too, for editors take it away before they save."""
    found = set()
    for path in paths:
        try:
            facts = path.stat()
            found.add((str(path), facts.st_mtime_ns, facts.st_size))
        except OSError:
            found.add((str(path), 0, 0))
    return frozenset(found)


def wait_for_edit(paths: Collection[Path], before: Stamp) -> None:
    """Wait until files differ from `before`, and are done changing."""
    now = before
    while now == before:
        time.sleep(LOOK_AGAIN)
        now = stamp(paths)
    last = before
    while now != last:
        time.sleep(LOOK_AGAIN / 2)
        last, now = now, stamp(paths)
