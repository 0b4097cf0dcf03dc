"""A requested turntable: its frames, its angles and its plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.errors import UsageError, suggestion
from pipeline.frames import FrameRange
from pipeline.mesh.read import FORMATS
from pipeline.production.execution.project import Project
from pipeline.production.planning.plan import Plan
from pipeline.production.request.lookup import find_shot
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.request.turntable import TURNS, Turntable
from render.base.plural import plural
from render.scene.materials import LOOKS

BOTH = "both"

STAGE = "turntable"
"""The stage of a turntable, a name in `render.scene.stage.STAGES`: with balls and a chart."""


@dataclass(frozen=True)
class TurntableRequest:
    """A turntable of one frame of a shot, or of a mesh file.

    subject  name or path of a shot, or path of a mesh file
    at       frame of the shot, by default its first
    frames   pictures of a full turn
    turn     one of TURNS, or BOTH
    looks    names of looks that replace the shot's own; each has its own turntable
    bare     True keeps the shot's own stage and camera, without grey ball, chrome ball and chart

    Raises UsageError for values that make no turntable.
    """

    project: Project
    subject: str
    quality: str
    at: int | None = None
    frames: int = 72
    turn: str = BOTH
    looks: tuple[str, ...] = ()
    bare: bool = False

    def __post_init__(self) -> None:
        if self.frames < 2:
            raise UsageError(
                f"a turntable of {plural(self.frames, 'frame')} does not turn; it needs at least 2, "
                "and 72 is usual"
            )
        if self.turn not in (*TURNS, BOTH):
            raise UsageError(
                f"--turn {self.turn}: that is nothing to turn. {suggestion(self.turn, (*TURNS, BOTH))}"
            )
        for look in self.looks:
            if look not in LOOKS:
                raise UsageError(f"--look {look}: {look!r} is not a look. {suggestion(look, LOOKS)}")

    @property
    def turns(self) -> tuple[str, ...]:
        return TURNS if self.turn == BOTH else (self.turn,)

    @property
    def requests(self) -> list[RenderRequest]:
        """Return the request of each look. Raises MissingInputError or UsageError."""
        mesh = Path(self.subject)
        of_file = mesh.suffix.lower().lstrip(".") in FORMATS
        path = self.project.shot_around(mesh) if of_file else find_shot(self.subject)
        return [self._take(path, of_file, look) for look in self.looks or (None,)]

    def _take(self, path: Path, of_file: bool, look: str | None) -> RenderRequest:
        project = replace(self.project, settings=tuple(self._settings(look)))
        request = project.request(path, self.quality)
        known = FrameRange(request.source.summary.frames)
        at = known.first if self.at is None else self.at
        if at not in known:
            raise UsageError(f"frame {at} is not in {request.name}, which has frames {known}")
        table = Turntable(at, self.frames, of_file, look if len(self.looks) > 1 else None)
        numbers = tuple(number for turn in self.turns for number in table.numbers(turn))
        return replace(request, requested=numbers, turntable=table)

    def _settings(self, look: str | None) -> Iterator[str]:
        """Yield settings of the shot; the user's come last and win."""
        if not self.bare:
            yield f"stage={STAGE}"
        if look is not None:
            yield f"look={look}"
        yield from self.project.settings

    def plan(self) -> Plan:
        """Return the plan of the frames and a movie of each look; what looks have in common is made once."""
        requests = self.requests
        planner = self.project.planner(len(requests))
        for request in requests:
            planner.pictures(request)
            planner.movie(request)
        return planner.plan()


EIGHTHS, QUARTERS = 8, 4
"""Key angles of a full turn of the object, and of the lights."""


def key_numbers(table: Turntable, turns: Sequence[str], parts_of_object: int = EIGHTHS) -> list[int]:
    """Return the pictures nearest to equal parts of each turn; fewer if there are fewer pictures."""
    parts = {"object": parts_of_object, "lights": QUARTERS}
    return [number for turn in turns for number in _spread(table.numbers(turn), parts[turn])]


def _spread(numbers: range, parts: int) -> list[int]:
    steps = dict.fromkeys(round(len(numbers) * i / parts) % len(numbers) for i in range(parts))
    return [numbers[step] for step in sorted(steps)]


def turn_and_angle(table: Turntable, number: int) -> tuple[str, str]:
    """Return what is turned in a picture, and by which angle: `object`, `45°`."""
    turn, numbers = next((t, table.numbers(t)) for t in ("object", "lights") if number in table.numbers(t))
    return turn, f"{round(360.0 * (number - numbers[0]) / table.frames, 1):g}°"
