"""Arms values of a shot, records what moves them while the shot plays, and chooses among takes.

One recording is under way at a time, whichever page began it. It ends with the shot, when it is stopped, or
when no page is heard for a while; in each case its take is written whole, and then its keys.
"""

from __future__ import annotations

import io
import sys
import threading
import time
import wave
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from flowsculpt import FlowsculptError, MachineError, UsageError
from flowsculpt.api import quote
from flowsculpt.api.pictures import AudioClip
from flowsculpt.pipeline.plugins.preview.animatic import size_for
from flowsculpt.pipeline.plugins.preview.control_inputs import DECODERS, TOUCH, Armed, Controls, Moved
from flowsculpt.pipeline.plugins.preview.live_session import LiveSession, picture_data
from flowsculpt.pipeline.plugins.preview.performance import Performance, is_finite, live_curve
from flowsculpt.pipeline.plugins.preview.performed_takes import (
    Recorded,
    RecordedValue,
    Take,
    TakeFolder,
    TakeJournal,
)
from flowsculpt.pipeline.plugins.preview.settable_values import SettableShot, settable_values
from flowsculpt.pipeline.plugins.preview.shot_editor import ShotEditor, where_in
from flowsculpt.pipeline.plugins.preview.take_edits import is_chosen, restoring_edits, take_edits
from flowsculpt.pipeline.plugins.preview.text_edits import Where, path_text

NO_TAKE = "-"  # in place of the name of a take, for a value that has the keys of none

SPEEDS = (1.0, 0.5, 0.25)

SILENCE = 3.0  # seconds without a word of any page after which a recording ends

SHORTEST = 1 / 45  # seconds from a picture to the next, at least: browsers on two cores show no more

IN_TIME = 1 / 60  # seconds within which a picture is drawn, or it is drawn rough, then smaller

MOST_WAIT = 0.1  # seconds that a picture waits for a page that takes none

SWITCH = 1e-3  # seconds after which a thread lets another one run, while a recording is under way

ARRIVAL = 0.4
"""Frames after its time at which a frame is simulated, a 60th of a second at full speed: samples up to then
have arrived by that time, and later ones are only seen from the next frame on."""

MOST_BEHIND = 2.0  # frames by which the simulation may be behind before time waits for it

EACH_KEPT = 1.0  # seconds after which what is recorded is kept

RESTS = 3600.0 * 24  # seconds for which nothing else is computed, unless the recording ends before

SIZES = (((480, 270), False), ((480, 270), True), ((360, 202), True), ((240, 136), True))
"""Pixels of a 16:9 picture, and whether its outlines may show steps: from the usual ones to those of a shot
that hardly keeps up."""

SLOW, QUICK = 4, 48
"""Pictures in a row that are late before a quicker way, and in time before a better one."""

ROOM = 0.7  # share of the time for a picture within which one was drawn before the next is drawn better

MOST_INPUTS = 4000  # that one request may bring


@dataclass(eq=False)
class Recording:
    """A performance under way.

    begun    seconds of the clock at which it began, later by what the simulation was too slow
    heard    seconds of the clock at which a page was last heard
    samples  (time, path, index or None for all numbers, numbers) that were not taken over yet
    count    samples that were heard
    drawn    pictures that were drawn, and `shown` the last of them that a page has taken
    failed   why it ended early; empty where it did not
    """

    performance: Performance
    journal: TakeJournal
    first: int
    speed: float
    whole: bool
    begun: float
    heard: float
    samples: deque[tuple[float, Where, int | None, list[float]]] = field(default_factory=deque)
    count: int = 0
    drawn: int = 0
    shown: int = 0
    failed: str = ""
    ended: threading.Event = field(default_factory=threading.Event)
    done: threading.Event = field(default_factory=threading.Event)
    taken: threading.Event = field(default_factory=threading.Event)

    def wait_for_page(self) -> None:
        """Wait until a page has taken all pictures but the latest, or for MOST_WAIT."""
        self.taken.clear()
        if self.drawn - self.shown > 1:
            self.taken.wait(MOST_WAIT)

    @cached_property
    def rate(self) -> float:
        """Frames of the film in a second of the clock."""
        return float(self.performance.drawn.sketch.request.shot.rate.fps) * self.speed

    def position(self, now: float) -> float:
        """Return the frame of the film at a time of the clock."""
        return min(self.first + max(0.0, now - self.begun) * self.rate, float(self.performance.last))

    def take_over(self, now: float) -> None:
        """Put the samples into the live curves."""
        while self.samples:
            at, where, part, numbers = self.samples.popleft()
            curve = self.performance.curves.get(where)
            if curve is not None:
                row = tuple(numbers) if part is None else curve.part(part, numbers[0])
                curve.add(self.position(min(at, now)), row)


class DisplaySize:
    """How pictures are drawn: rough and smaller while they come late."""

    def __init__(self) -> None:
        self.index, self._late, self._in_time = 0, 0, 0

    def note(self, seconds: float, allowed: float) -> None:
        """Note what a picture has taken, with the frames before it."""
        is_late = seconds > allowed
        self._late, self._in_time = (self._late + 1, 0) if is_late else (0, self._in_time + 1)
        if self._late >= SLOW and self.index < len(SIZES) - 1:
            self.index, self._late = self.index + 1, 0
        elif self._in_time >= QUICK and seconds < ROOM * allowed and self.index:
            self.index, self._in_time = self.index - 1, 0


@dataclass(eq=False)
class Performer:
    """Records performances of the shot of a live session; safe to use from several threads.

    clock  returns seconds; they count while a recording plays
    """

    editor: ShotEditor
    session: LiveSession
    clock: Callable[[], float] = time.perf_counter
    controls: Controls = field(default_factory=Controls)
    recording: Recording | None = None
    words: str = ""
    _lock: threading.RLock = field(default_factory=threading.RLock)
    _takes: dict[str, Take] = field(default_factory=dict)

    def act(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Do what a page asks by the name `do`. Raises FlowsculptError."""
        acts = {
            "state": lambda asked: None,
            "arm": self._arm,
            "bind": self._bind,
            "record": self._record,
            "stop": lambda asked: self.end(),
            "play": self._play,
            "choose": self._choose,
        }
        name = asked.get("do")
        if name not in acts:
            raise UsageError(f"do must be one of {', '.join(acts)}")
        acts[name](asked)
        if name != "play":
            self.share()
        return {}

    def heard(self, moved: Moved, at: float | None = None) -> None:
        """Take what controls have moved, at a time of the clock; by default now."""
        with self._lock:
            changed, recording = self.controls.heard(moved), self.recording
            if recording is not None:
                for name, number in moved:
                    for where, part, value in self.controls.moves(name, number):
                        self._sample(recording, self.clock() if at is None else at, where, part, [value])
        if changed:
            self.share()

    def share(self) -> None:
        """Send all pages what is armed, which takes there are, and what is going on."""
        with self._lock:
            recording = self.recording
            message = {
                "event": "perform",
                "armed": [armed.data for armed in self.controls.armed.values()],
                "controls": self.controls.listed(),
                "takes": self._choices(),
                "recording": recording is not None,
                "speed": recording.speed if recording else 1.0,
                "fps": recording.rate if recording else 0.0,
                "words": self.words,
            }
        self.session.feed.share(message)

    def sound(self) -> bytes:
        """Return the sound of the shot from its first frame on, as a WAV file; empty where it is silent."""
        drawn = next(iter(self.session.latest()), None)
        if drawn is None:
            return b""
        request = drawn.sketch.request.whole()
        mixed = AudioClip.mix(request.sounds, len(request.shot.frames), request.shot.rate)
        if mixed is None:
            return b""
        file = io.BytesIO()
        with wave.Wave_write(file) as sound:
            sound.setparams((2, 2, SOUND_RATE, 0, "NONE", ""))
            for block in mixed:
                sound.writeframesraw((np.clip(block.T, -1.0, 1.0) * 32767).astype("<i2").tobytes())
        return file.getvalue()

    def rescue(self) -> None:
        """Save takes of processes that were killed while they recorded, and say so."""
        try:
            names = TakeFolder(self.editor.path).rescue()
            if names:
                self._note(f"flowsculpt was killed during a recording, which is kept as {', '.join(names)}.")
        except FlowsculptError as error:
            self._note(f"A recording that was cut off could not be kept: {error}")

    def end(self) -> None:
        """End a recording, as when the server ends; its take is written."""
        if (recording := self.recording) is not None:
            recording.ended.set()
            recording.done.wait()

    # What pages ask

    def _arm(self, asked: Mapping[str, Any]) -> None:
        where = where_in(asked.get("where"))
        with self._lock:
            self._require_still()
            if where in self.controls.armed:
                del self.controls.armed[where]
                return
            shot = self._shot()
            value = shot.by_path.get(where)
            if value is None:
                raise UsageError(f"{path_text(where)} is not in this shot")
            if value.file:
                raise UsageError(
                    f"{path_text(where)} comes from {value.file}; write it into this shot to perform it"
                )
            curve = live_curve(shot, value, shot.clock.frames.first)
            row = curve.given(0.0)
            self.controls.armed[where] = Armed.of(where, row, (value.low, value.high), value.unit)
            self.words = ""

    def _bind(self, asked: Mapping[str, Any]) -> None:
        armed = self.controls.armed.get(where_in(asked.get("where")))
        part, control = asked.get("part"), asked.get("control")
        ends = asked.get("low"), asked.get("high")
        if armed is None:
            raise UsageError("arm the value before you bind it")
        if not isinstance(part, int) or not isinstance(control, str) or len(control) > 100:
            raise UsageError("a binding has a part and a control")
        if not all(isinstance(end, int | float) for end in ends):
            raise UsageError("the ends of a range are numbers, such as 0 and 1")
        with self._lock:
            armed.bind(part, control, float(ends[0] or 0), float(ends[1] or 0))

    def _record(self, asked: Mapping[str, Any]) -> None:
        frame, speed = asked.get("frame"), asked.get("speed", 1)
        if not isinstance(frame, int) or speed not in SPEEDS:
            raise UsageError("a recording has a frame, and a speed of 1, 0.5 or 0.25")
        with self._lock:
            self._require_still()
            if not self.controls.armed:
                raise UsageError("nothing is armed; press ● beside a value or A on a handle, then record")
            drawn = self.session.drawn(frame)
            if drawn is None:
                raise UsageError(f"frame {frame} is not simulated yet; record once it is shown")
            if frame >= drawn.sketch.request.shot.frames.last:
                raise UsageError("the shot ends here; go to an earlier frame to record")
            self.session.hold(RESTS)
            try:
                performance = Performance(self.session, drawn, frame, list(self.controls.armed))
            except BaseException:
                self.session.resume()
                raise
            now = self.clock()
            journal, whole = TakeJournal(self.editor.path), bool(asked.get("whole"))
            self.recording = Recording(performance, journal, frame, float(speed), whole, now, now)
            self.words = ""
            threading.Thread(target=self._perform, args=(self.recording,), daemon=True).start()

    def _play(self, asked: Mapping[str, Any]) -> None:
        """Take what a page has heard: [age in milliseconds, kind, …], oldest first.

        `value` has a path and the value itself; the other kinds are those of DECODERS, with their numbers.
        """
        inputs, now = asked.get("inputs"), self.clock()
        if not isinstance(inputs, list) or len(inputs) > MOST_INPUTS:
            raise UsageError(f"inputs must be a list of at most {MOST_INPUTS}")
        if (recording := self.recording) is not None:
            recording.heard, shown = now, asked.get("shown")
            if isinstance(shown, int) and shown > recording.shown:
                recording.shown = min(shown, recording.drawn)
                recording.taken.set()
        for each in inputs:
            if not isinstance(each, list) or len(each) < 3 or not isinstance(each[0], int | float):
                raise UsageError("an input has an age, a kind, and what was moved")
            at, kind = now - max(0.0, min(float(each[0]), 10_000.0)) / 1000.0, each[1]
            if kind == "value" and len(each) == 4:
                self._touched(at, where_in(each[2]), each[3])
            elif kind in DECODERS and all(isinstance(n, int | float) and is_finite([n]) for n in each[2:]):
                self.heard(DECODERS[kind](each[2:]), at)
            else:
                raise UsageError(f"{quote(str(kind)[:20])} is not a kind of input")

    def _touched(self, at: float, where: Where, given: Any) -> None:
        """Take a value that its own handle was moved to."""
        row = given if isinstance(given, list) else [given]
        with self._lock:
            armed, recording = self.controls.armed.get(where), self.recording
            if recording is None:
                return
            is_row = all(isinstance(n, int | float) and is_finite([n]) for n in row)
            if armed is None or len(row) != len(armed.bindings) or not is_row:
                return
            if any(binding.control == TOUCH for binding in armed.bindings):
                self._sample(recording, at, where, None, [float(n) for n in row])

    def _sample(
        self, recording: Recording, at: float, where: Where, part: int | None, numbers: list[float]
    ) -> None:
        recording.samples.append((at, where, part, numbers))
        recording.count += 1

    def _choose(self, asked: Mapping[str, Any]) -> None:
        """Give a value the keys of a take, or what it had before its first one."""
        where, name = where_in(asked.get("where")), asked.get("take")
        if not isinstance(name, str):
            raise UsageError("a choice has the name of a take, or none for what was before")
        with self._lock:
            self._require_still()
            if name == NO_TAKE:
                return
            takes = {
                each: take
                for each, take in TakeFolder(self.editor.path).all(self._takes).items()
                if take.value_at(where)
            }
            if not takes or (name and name not in takes):
                raise UsageError(f"{path_text(where)} has no take {name or 'at all'}")
            taken = takes[name or next(iter(takes))].value_at(where)
            assert taken is not None, "takes without the value were left out"
            shot = self._shot()
            self._write(take_edits(shot, taken) if name else restoring_edits(shot, taken))

    # The recording

    def _perform(self, recording: Recording) -> None:
        """Draw until the recording ends, while another thread simulates; then write what was recorded."""
        size = DisplaySize()
        simulation = threading.Thread(target=self._simulate, args=(recording,), daemon=True)
        simulation.start()
        interval = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH)  # so that inputs are not kept waiting by another thread
        try:
            while not recording.ended.is_set():
                began = self.clock()
                position = recording.position(began)
                self._show(recording, position, size)
                took = self.clock() - began
                size.note(took, IN_TIME)
                if position >= recording.performance.last or began - recording.heard > SILENCE:
                    break
                recording.wait_for_page()
                recording.ended.wait(max(0.0, SHORTEST - (self.clock() - began)))
        except FlowsculptError as error:
            recording.failed = str(error)
        finally:
            recording.ended.set()
            simulation.join()
            sys.setswitchinterval(interval)
            try:
                self._finish(recording)
            finally:
                with self._lock:
                    self.recording = None
                self.session.resume()
                recording.done.set()
                self.share()

    def _simulate(self, recording: Recording) -> None:
        """Simulate each frame once its time has come; where that takes too long, time waits."""
        performance, kept = recording.performance, self.clock()
        try:
            while not recording.ended.is_set():
                position = recording.position(self.clock() - ARRIVAL / recording.rate)
                if performance.frame + 1 > position:
                    recording.ended.wait((performance.frame + 1 - position) / recording.rate)
                    continue
                with self._lock:
                    recording.take_over(self.clock())
                performance.advance(performance.frame + 1.0)
                if self.clock() - kept > EACH_KEPT:
                    self._keep(recording)
                    kept = self.clock()
                behind = recording.position(self.clock() - ARRIVAL / recording.rate) - performance.frame
                if behind > MOST_BEHIND and performance.frame < performance.last:
                    recording.begun += (behind - MOST_BEHIND) / recording.rate
                    self._note("Too slow for this speed: time waits for the simulation.")
        except FlowsculptError as error:
            recording.failed = str(error)
            recording.ended.set()

    def _show(self, recording: Recording, position: float, size: DisplaySize) -> None:
        """Show the shot at a position, with all samples that were heard."""
        performance = recording.performance
        with self._lock:
            heard = recording.count
            recording.take_over(self.clock())
        request = performance.drawn.sketch.request
        pixels, is_rough = SIZES[size.index]
        pixels = size_for(request.pictures.aspect, pixels)
        picture, framing = performance.picture(position, pixels, is_rough)
        recording.drawn += 1
        high, wide = picture.shape[:2]
        words = f"Recording; drawn roughly at {wide} × {high} to keep up" if is_rough else "Recording"
        self.session.feed.flash(
            {
                "event": "live",
                "frame": int(position),
                "position": position,
                **picture_data(picture, framing.camera, request.pictures.aspect),
                "inputs": heard,
                "number": recording.drawn,
                "values": performance.values(),
                "words": words,
            }
        )

    def _note(self, words: str) -> None:
        if words != self.words:
            self.words = words
            self.share()

    def _recorded(self, recording: Recording, kept: Mapping[Where, int] | None = None) -> Recorded:
        """Return what was recorded, except samples that are kept, so many of each path."""
        performance, values = recording.performance, []
        request = performance.drawn.sketch.request
        for where, curve in performance.curves.items():
            new = slice((kept or {}).get(where, 0), len(curve.times))  # each row is there before its time
            values.append(
                RecordedValue(
                    where=list(where),
                    source=self.controls.armed[where].source,
                    times=curve.times[new],
                    samples=[list(row) for row in curve.rows[new]],
                    before=performance.before.get(where),
                )
            )
        fps, speed, whole = float(request.shot.rate.fps), recording.speed, recording.whole
        return Recorded(shot=request.name, fps=fps, speed=speed, whole=whole, values=values)

    def _keep(self, recording: Recording) -> None:
        """Keep what was recorded, as this process may be killed."""
        try:
            recording.journal.keep(self._recorded(recording, recording.journal.kept))
        except MachineError as error:
            self._note(f"{error}. Until the recording ends, its take is in memory alone.")

    def _finish(self, recording: Recording) -> None:
        """Write the take, and its keys into the shot file; say what became of it."""
        failed = f"{recording.failed} The recording ended there. " if recording.failed else ""
        recording.take_over(self.clock())
        curves = [curve for curve in recording.performance.curves.values() if curve.count]
        for curve in curves:
            curve.close(recording.performance.frame)
        name = ""
        try:
            take, folder = self._recorded(recording).take(), TakeFolder(self.editor.path)
            if take is None:
                recording.journal.end()
                self.words = f"{failed}Nothing armed was moved; a take needs a movement."
                return
            name = folder.save(take)
            self._takes[name] = take
            recording.journal.end()
            with self._lock:
                shot = self._shot()
                self._write([edit for value in take.values for edit in take_edits(shot, value)])
            keys = sum(len(value.keys) for value in take.values)
            samples = sum(curve.count for curve in curves)
            self.words = f"{failed}Take {name}: {samples} samples, {keys} keys."
        except FlowsculptError as error:
            kept = f"Take {name} is kept, and not in the shot: " if name else "The take could not be kept: "
            self.words = f"{failed}{kept}{error}"

    def _write(self, edits: list[Any]) -> None:
        if edits:
            digest = self.editor.state()["digest"]
            self.editor.edit(digest, edits)
            self.session.resume()

    def _require_still(self) -> None:
        if self.recording is not None:
            raise UsageError("a recording is under way, perhaps by another page; end it first")

    def _shot(self) -> SettableShot:
        text = self.editor.text()
        return settable_values(self.editor.path, text, self.editor.settings)

    # Takes

    def _choices(self) -> list[dict[str, Any]]:
        """Return, for each value with takes, what a list shows, (name, words), and the take that it has."""
        takes = TakeFolder(self.editor.path).all(self._takes)
        if not takes:
            return []
        try:
            values = self._shot().by_path
        except (FlowsculptError, ValueError):
            return []
        found: dict[Where, dict[str, Any]] = {}
        for name, take in takes.items():
            for taken in take.values:
                where = tuple(taken.where)
                if where not in values:
                    continue
                first = [("", "as before the takes")]
                entry = found.setdefault(where, {"where": where, "takes": first, "chosen": NO_TAKE})
                entry["takes"].append((name, name.replace(f"{self.editor.path.stem}.", "take ")))
                if is_chosen(values[where], taken):
                    entry["chosen"] = name
        for entry in found.values():
            if entry["chosen"] == NO_TAKE:
                entry["takes"].insert(0, (NO_TAKE, "its own keys"))
        return list(found.values())


SOUND_RATE = 48_000
"""Samples per second of mixed sound."""
