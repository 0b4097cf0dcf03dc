"""Follow a shot on the live page: show each frame once it is simulated, and after an edit what it changed."""

from __future__ import annotations

import base64
import math
import queue
import threading
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Event
from typing import Any

from numpy.typing import NDArray

from flowsculpt import FlowsculptError, MachineError
from flowsculpt.api.frames import Framing, ShotSource
from flowsculpt.api.pictures import Camera, jpeg_bytes
from flowsculpt.pipeline.plugins.preview.animatic import SIZES, FramedSurfaces, framings_of, size_for
from flowsculpt.pipeline.plugins.preview.sketch import Sketch, is_closed
from flowsculpt.pipeline.plugins.preview.surface_stream import SurfaceStream

Message = dict[str, Any]

MOST_BEHIND = 2  # messages that a page may still have to take when a passing picture is sent

LATEST = 2  # takes whose pictures are kept: the page shows the last one while the next is drawn


@dataclass(eq=False)
class LiveFeed:
    """Pictures and messages for browsers; safe to use from several threads.

    session  identifies this process, for a page that stayed open after another one ended
    sound    returns the sound of the shot, as a WAV file; empty where it has none

    A *take* is one state of the shot file; takes are numbered. Each of its pictures may come twice: the
    second time from the camera that was framed by the whole shot.
    """

    session: int = field(default_factory=time.time_ns)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _subscribers: list[queue.SimpleQueue[Message]] = field(default_factory=list)
    _pictures: dict[tuple[int, int], bytes] = field(default_factory=dict)
    _drawn: dict[tuple[int, int], int] = field(default_factory=dict)
    _cameras: dict[tuple[int, int], Message] = field(default_factory=dict)
    _begun: Message = field(default_factory=dict)
    _said: Message = field(default_factory=dict)
    _shared: Message = field(default_factory=dict)
    sound: Callable[[], bytes] = bytes

    def begin(self, shot: str, first: int, last: int, fps: float, size: tuple[int, int]) -> int:
        """Begin a take and return its number."""
        with self._lock:
            take = self._begun.get("take", 0) + 1
            self._begun = {"event": "begin", "session": self.session, "take": take, "shot": shot}
            self._begun |= {"first": first, "last": last, "fps": fps, "size": list(size)}
            for place in [place for place in self._pictures if place[0] <= take - LATEST]:
                del self._pictures[place], self._drawn[place]
                self._cameras.pop(place, None)
            self._send(self._begun)
            return int(take)

    def show(self, take: int, frame: int, jpeg: bytes, camera: Message | None = None) -> None:
        """Show a picture; `camera` is what the page projects points by."""
        with self._lock:
            place = take, frame
            if camera is not None:
                self._cameras[place] = camera
            self._pictures[place] = jpeg
            self._drawn[place] = self._drawn.get(place, 0) + 1
            self._send(self._frame(place))

    def say(self, words: str, trouble: bool = False) -> None:
        """Show a message: what is going on, or, as `trouble`, what is wrong."""
        with self._lock:
            self._said = {"event": "say", "words": words, "trouble": trouble}
            self._send(self._said)

    def picture(self, take: int, frame: int) -> bytes | None:
        """Return a JPEG that was shown; None if there is none, or it is of a take long ago."""
        with self._lock:
            return self._pictures.get((take, frame))

    def share(self, message: Message) -> None:
        """Send a message to all pages, and to those that open later, until the next one."""
        with self._lock:
            self._shared = message
            self._send(message)

    def flash(self, message: Message) -> None:
        """Send a message that the next one replaces; a page that is behind gets it not."""
        with self._lock:
            for messages in self._subscribers:
                if messages.qsize() <= MOST_BEHIND:
                    messages.put(message)

    def subscribe(self) -> queue.SimpleQueue[Message]:
        """Return a queue with all that the page shows now, to which every later message is added."""
        messages: queue.SimpleQueue[Message] = queue.SimpleQueue()
        with self._lock:
            shown = [self._frame(place) for place in self._pictures if place[0] == self._begun.get("take")]
            for message in (self._begun, *shown, self._said, self._shared):
                if message:
                    messages.put(message)
            self._subscribers.append(messages)
        return messages

    def unsubscribe(self, messages: queue.SimpleQueue[Message]) -> None:
        """End the messages to a queue of `subscribe`."""
        with self._lock:
            self._subscribers.remove(messages)

    def _frame(self, place: tuple[int, int]) -> Message:
        message = {"event": "frame", "take": place[0], "frame": place[1], "drawn": self._drawn[place]}
        return {**message, "camera": self._cameras[place]} if place in self._cameras else message

    def _send(self, message: Message) -> None:
        for messages in self._subscribers:
            messages.put(message)


REST_SECONDS = 1.0
"""Time from the begin of a picture of a drag in which nothing else is computed, unless an edit is written."""

READY = "Up to date."  # the message of the page when it shows the whole shot


class EditedError(Exception):
    """Raised when the shot is saved while its last state is still being drawn."""


@dataclass(frozen=True)
class Drawn:
    """A picture, the recipe that it was drawn from, and what draws it."""

    recipe: tuple[Any, ...]
    jpeg: bytes
    sketch: Sketch
    framing: Framing

    @property
    def key(self) -> str:
        return str(self.recipe[0])


@dataclass(eq=False)
class LiveSession:
    """Shows a shot on the live page.

    read     reads the shot
    done     called when the whole shot is shown with the cameras of the render
    watched  paths whose changes are edits
    focus    the frame that the page shows: of frames that only have to be drawn again it comes first
    """

    read: Callable[[], Sketch]
    feed: LiveFeed
    stream: SurfaceStream
    done: Callable[[FramedSurfaces], None]
    watched: set[Path]
    focus: int | None = None
    _before: Stamp = frozenset()
    _drawn: dict[int, Drawn] = field(default_factory=dict)
    _framings: Mapping[int, Framing] = field(default_factory=dict)
    _rests_until: float = 0.0
    _edited: Event = field(default_factory=Event)

    def follow(self) -> None:
        """Show the shot now and after each save, until the process is interrupted."""
        while True:
            self._edited.clear()
            self._before = stamp(self.watched)
            try:
                self._show(self._require_unedited)
                self.feed.say(READY)
            except EditedError:
                continue
            except FlowsculptError as error:
                self.feed.say(str(error), trouble=True)
            except OSError as error:
                said = MachineError.of_path(Path(error.filename or "."), error, "used")
                self.feed.say(f"{said}. Save the shot to try again.", trouble=True)
            wait_for_edit(self.watched, self._before, self._edited)

    def hold(self, seconds: float = REST_SECONDS) -> None:
        """Rest for a moment, so that pictures of a drag come at once; or longer, until `resume`."""
        self._rests_until = max(self._rests_until, time.monotonic() + seconds)

    def resume(self) -> None:
        """End the rest and look at the files at once: they have been edited."""
        self._rests_until = 0.0
        self._edited.set()

    def drawn(self, number: int) -> Drawn | None:
        """Return the latest picture of a frame, if its surface is still there."""
        drawn = self._drawn.get(number)
        return drawn if drawn and self.stream.knows(drawn.sketch.request, number) else None

    def latest(self) -> list[Drawn]:
        """Return the latest pictures of all frames."""
        return list(self._drawn.values())

    def framing(self, number: int) -> Framing | None:
        """Return camera and stage of a frame, once the whole shot was simulated."""
        return self._framings.get(number)

    def _require_unedited(self) -> None:
        while time.monotonic() < self._rests_until:
            time.sleep(POLL_SECONDS / 5)
        if stamp(self.watched) != self._before:
            raise EditedError

    def _show(self, check: Callable[[], None]) -> None:
        """Show the shot; call `check` between frames."""
        sketch = self.read()
        request, known_before = sketch.request, set(self.watched)
        self.watched |= files_of(request.source)
        self._before |= stamp(self.watched - known_before)
        numbers, size = sorted(request.angles), size_for(request.pictures.aspect, SIZES["movie"])
        take = self.feed.begin(request.name, numbers[0], numbers[-1], float(request.shot.rate.fps), size)
        self.feed.say("Simulating …")

        def within_frame(progress: Any) -> None:
            check()
            self.feed.say(progress.slow or f"Frame {progress.frame}: {progress.share:.0%}, {progress.work} …")

        self.stream.callback = within_frame
        known = request.pictures.framings(self.stream.store) or self._framings
        is_simulated = all(self.stream.knows(request, number) for number in numbers)
        self._drawn = {number: drawn for number, drawn in self._drawn.items() if number in request.angles}
        shown = [(drawn.sketch.request, number) for number, drawn in self._drawn.items()]
        for number in self.stream.play(request, numbers, shown):
            check()
            if number == numbers[0]:
                sketch = replace(sketch, closed=all(map(is_closed, self.stream.each(request, number))))
            if is_simulated:
                continue  # the frames are drawn at once with their new cameras
            framing = known.get(number) or framings_of(request, self.stream, [number])[number]
            surfaces = FramedSurfaces(sketch, self.stream, {number: framing})
            self._draw(take, surfaces, [number], size, check)
        self._framings = request.pictures.framings(self.stream.store) or framings_of(
            request, self.stream, numbers
        )
        surfaces = FramedSurfaces(sketch, self.stream, self._framings)
        self.feed.say("Framing …")
        focus = numbers[0] if self.focus is None else self.focus
        self._draw(take, surfaces, sorted(numbers, key=lambda n: abs(n - focus)), size, check)
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
                framing = surfaces.framings[number]
                self._drawn[number] = replace(drawn, sketch=surfaces.sketch, framing=framing)
                self.feed.show(take, number, drawn.jpeg, projection(surfaces, number))
        for number, picture in zip(stale, surfaces.pictures(stale, size, "srgb"), strict=True):
            check()
            jpeg = jpeg_bytes(picture)
            self._drawn[number] = Drawn(recipes[number], jpeg, surfaces.sketch, surfaces.framings[number])
            self.feed.show(take, number, self._drawn[number].jpeg, projection(surfaces, number))


def projection(surfaces: FramedSurfaces, number: int) -> dict[str, Any] | None:
    """Return a frame's camera as the page projects points by it; see `Camera.project`."""
    return camera_data(surfaces.framings[number].camera, surfaces.sketch.request.pictures.aspect)


def camera_data(camera: Camera, aspect: float) -> dict[str, Any] | None:
    """Return a camera as plain data: origin, axes right, up and forward, half the width at depth 1.

    None for a wide camera: the page then has no handles, and its picture does not orbit.
    """
    if camera.projection.is_wide:
        return None
    places = {"origin": list(camera.origin), "target": list(camera.target), "axes": camera.axes().tolist()}
    return {**places, "half": math.tan(camera.field_of_view / 2.0), "aspect": aspect}


def picture_data(picture: NDArray[Any], camera: Camera, aspect: float) -> Message:
    """Return a passing picture as plain data: a JPEG in base64, and its camera."""
    jpeg = base64.b64encode(jpeg_bytes(picture)).decode()
    return {"picture": jpeg, "camera": camera_data(camera, aspect)}


def files_of(source: ShotSource) -> set[Path]:
    """Return all files that a shot was read from."""
    pinned = [Path(path) for path, _ in source.inputs or ()]
    return {source.path, *(source.path.with_name(name) for name, _ in source.beside), *pinned}


def _recipe(surfaces: FramedSurfaces, number: int) -> tuple[Any, ...]:
    """Return everything that decides a picture."""
    request, sketch = surfaces.sketch.request, surfaces.sketch
    shown = request.pictures.of(number)
    motions = [part.motion for part in request.shot.parts] if sketch.flow else []
    flows = repr([motion.velocity_data(number) for motion in motions])
    return (
        request.keys.normals(number),
        repr(request.keys.speed_data(number)),
        surfaces.framings[number],
        (*(part.pictures.of(number).look for part in request.parts), shown.lights, shown.stage, shown.view),
        (sketch.flow, flows, sketch.edges, sketch.burn_in),
    )


POLL_SECONDS = 0.1  # seconds between checks for an edit

Stamp = frozenset[tuple[str, int, int]]  # paths with the time they were last written, ns, and their sizes


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


def wait_for_edit(paths: Collection[Path], before: Stamp, edited: Event | None = None) -> None:
    """Wait until files differ from `before` and have stopped changing.

    edited  set by whoever has written one of them whole: then there is nothing to wait for
    """
    edited = edited or Event()
    now = before
    while now == before:
        is_whole = edited.wait(POLL_SECONDS)
        edited.clear()
        now = stamp(paths)
    last = now if is_whole else before
    while now != last:
        time.sleep(POLL_SECONDS / 2)
        last, now = now, stamp(paths)
