"""The command `turntable`: frames, angles and plan, and the sheets and movies drawn from its pictures.

renders/turntable/<name>/<quality>/<name>.png                   key angles, next to the movie
renders/turntable/<name>/<quality>/<name>.clay-glaze.{mp4,png}  looks side by side, and their key angles
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from numpy.typing import NDArray

from flowsculpt import MissingInputError, UsageError
from flowsculpt.api import plural, suggest
from flowsculpt.api.commands import Project, execute_and_report, progress_bars, require_one_of
from flowsculpt.api.files import InputFile
from flowsculpt.api.frames import (
    FinishedPictures,
    Folders,
    FrameRange,
    PipelineStage,
    Plan,
    RenderRequest,
    Show,
    Store,
    key_of,
)
from flowsculpt.api.meshes import ModelFile
from flowsculpt.api.options import (
    DEFAULT_QUALITY,
    Common,
    PictureOptions,
    Quality,
    ShotOptions,
    shared_option,
)
from flowsculpt.api.pictures import ContactSheet, prefetch, write_movie, write_still
from flowsculpt.api.shots import NAME_PATTERN, PRESETS, WrittenShot, YamlSource
from flowsculpt.pipeline.plugins.turntable.turntable_frames import REFERENCES, TURNS, Turntable

TURNTABLE_SHEET = PipelineStage(
    "turntable_sheet", version=2, packages=("av", "OpenImageIO"), doing="laying out sheets", makes="png"
)

BOTH = "both"

UPS = ("y", "z")  # the axes of a mesh file that can point up


@dataclass(frozen=True)
class TurntableRequest:
    """A turntable of one frame of a shot, or of a mesh file.

    subject  name or path of a shot, or path of a mesh file
    at       frame of the shot, by default its first
    frames   pictures of a full turn
    turn     one of TURNS, or BOTH
    looks    names of looks that replace the shot's own; each has its own turntable
    bare     True keeps the shot's own stage and camera, without grey ball, chrome ball and chart
    up       the axis, y or z, that points up in a mesh file; by default that of most files of its format
    of       the name of one of several subjects of the shot, which then turns alone

    Raises UsageError for values that make no turntable, and what reading the show's names of looks raises.
    """

    project: Project
    subject: str
    quality: str
    at: int | None = None
    frames: int = 72
    turn: str = BOTH
    looks: tuple[str, ...] = ()
    bare: bool = False
    up: str | None = None
    of: str | None = None

    def __post_init__(self) -> None:
        if self.frames < 2:
            raise UsageError(
                f"a turntable of {plural(self.frames, 'frame')} does not turn; it needs at least 2, "
                "and 72 is usual"
            )
        if self.turn not in (*TURNS, BOTH):
            raise UsageError(f"--turn {self.turn}: it does not turn. {suggest(self.turn, (*TURNS, BOTH))}")
        if self.up not in (None, *UPS):
            raise UsageError(f"--up {self.up}: only the axes y and z can point up. Write --up y or --up z.")
        if self.up is not None and not self._is_of_file:
            raise UsageError(
                f"--up {self.up} stands a mesh file up, and {self.subject} is a shot. Leave out --up; in the "
                "shot file of a model, write up under subject."
            )
        for look in self.looks:
            known = [*self._named_looks, *PRESETS["look"]]
            require_one_of(look, known, f"--look {look}: {look!r} is not a look.")
            if not re.fullmatch(NAME_PATTERN, look):
                raise UsageError(
                    f"--look {look}: {look!r} cannot name a folder of pictures; where the show names it, use "
                    "letters, digits, _ and -"
                )

    @property
    def turns(self) -> tuple[str, ...]:
        return TURNS if self.turn == BOTH else (self.turn,)

    @property
    def requests(self) -> list[RenderRequest]:
        """Return the request of each look. Raises MissingInputError or UsageError."""
        mesh, of_file = Path(self.subject), self._is_of_file
        up = self.up or ModelFile(mesh).up()
        if of_file:
            path = mesh.absolute().with_name(re.sub(r"[^\w.-]", "_", mesh.stem) + ".yaml")
            shot = _shot_around(mesh, up, self._named_looks, PAINTED in self.looks)
            self.project.use_text(path, shot)
        else:
            path = Show().find_shot(self.subject)
        return [self._take(path, of_file, look) for look in self.looks or (None,)]

    @cached_property
    def _named_looks(self) -> Mapping[str, Any]:
        """The looks that the show and the shot name; none if no look is asked for."""
        if not self.looks:
            return {}
        if not self._is_of_file:
            written = WrittenShot.read(Show().find_shot(self.subject), settings=self.project.settings)
            return written.source.mapping("looks")
        try:
            looks = YamlSource.read(Show().defaults).mapping("looks")
        except MissingInputError:
            looks = {}
        return cast(Mapping[str, Any], _with_absolute_files(looks, Show().folder))

    @property
    def _is_of_file(self) -> bool:
        return ModelFile(Path(self.subject)).reader is not None

    def _take(self, path: Path, of_file: bool, look: str | None) -> RenderRequest:
        subjects = self.project.request(path, self.quality).manifest.subjects if look else ()
        project = replace(self.project, settings=tuple(self._settings(look, subjects)))
        request = project.request(path, self.quality).of_subject(self.of)
        known = FrameRange(request.manifest.frames)
        at = known.first if self.at is None else self.at
        if at not in known:
            raise UsageError(f"frame {at} is not in {request.name}, which has frames {known}")
        table = Turntable(at, self.frames, of_file, look if len(self.looks) > 1 else None)
        numbers = FrameRange(number for turn in self.turns for number in table.numbers(turn))
        return replace(request, requested=numbers, frame_source=table)

    def _settings(self, look: str | None, subjects: Sequence[str]) -> Iterator[str]:
        """Yield settings of the shot and of its subjects by name; the user's come last and win."""
        if not self.bare:
            yield f"stage={REFERENCES}"
        if look is not None:
            yield f"look={look}"
            yield from (f"subjects.{name}.look={look}" for name in subjects)
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
    found = []
    for turn in turns:
        numbers, parts = table.numbers(turn), parts_of_object if turn == "object" else QUARTERS
        steps = {round(len(numbers) * i / parts) % len(numbers) for i in range(parts)}
        found += [numbers[step] for step in sorted(steps)]
    return found


def turn_and_angle(table: Turntable, number: int) -> tuple[str, str]:
    """Return what is turned in a picture, and by which angle: `object`, `45°`."""
    turn, numbers = next((t, table.numbers(t)) for t in ("object", "lights") if number in table.numbers(t))
    return turn, f"{round(360.0 * (number - numbers[0]) / table.frames, 1):g}°"


PAINTED = "model"
"""The look that shows the paint of a model."""

ROW = 4  # most looks in one row; with as many looks or more, each has its own row of key angles

Caption = tuple[tuple[str, str], ...]
"""Labels and texts below a picture of a sheet."""

Bar = Callable[[str, int], Callable[[], None]]
"""Adds a progress bar by name and total, and returns what advances it by one."""


@dataclass(frozen=True, eq=False)
class TurntableSheets:
    """Sheets of a rendered turntable; missing pictures are shown as missing."""

    turntable: TurntableRequest

    def draw(self, bar: Bar = lambda name, total: lambda: None) -> list[Path]:
        """Draw all sheets that are not stored yet, and return their paths relative to the root.

        Return nothing if no picture is rendered. Raises FrameError for a damaged picture, MachineError if
        the disk refuses.
        """
        first, looks = self._first, range(len(self._requests))
        if not any(self._finished[look].key(number) for look in looks for number in first.requested):
            return []
        sheets = [self._key_angles([look], self._requests[look].movie_path) for look in looks]
        if len(looks) == 1:
            return sheets
        turns = self.turntable.turns
        part = "" if len(turns) > 1 else f".{turns[0]}"
        folders = Folders(first.folders.home.parent, first.folders.name)
        movie = folders.movie(first.quality_name, "-".join(self.turntable.looks) + part)
        return [self._movie(movie, bar), self._key_angles(looks, movie), *sheets]

    @cached_property
    def _requests(self) -> list[RenderRequest]:
        return self.turntable.requests

    @cached_property
    def _finished(self) -> list[FinishedPictures]:
        return [FinishedPictures(request, self._store) for request in self._requests]

    @property
    def _store(self) -> Store:
        return self.turntable.project.store

    @property
    def _first(self) -> RenderRequest:
        """The request of the first look; all looks have the same frames."""
        return self._requests[0]

    @property
    def _table(self) -> Turntable:
        table = self._first.frame_source
        assert isinstance(table, Turntable), "all requests are of turntables"
        return table

    def _key_angles(self, looks: Sequence[int], movie: Path) -> Path:
        """Draw key angles of one look, or of several: then each turn has a row, or each of many looks."""
        is_single = len(looks) == 1
        numbers = key_numbers(self._table, self.turntable.turns, EIGHTHS if is_single else QUARTERS)
        cells = [(look, number) for look in looks for number in numbers]
        columns = min(QUARTERS, self._table.frames) if len(looks) < ROW else len(numbers)
        captions: list[Caption] = []
        for look, number in cells:
            turn, angle = turn_and_angle(self._table, number)
            line = (turn, angle) if is_single else (self.turntable.looks[look], f"{turn} {angle}")
            captions.append((line,))
        sheet, factor = self._sheet(captions, columns)
        name = self.turntable.looks[looks[0]] if is_single and self.turntable.looks else ""
        frame = "" if self._table.of_file else f"frame {self._table.at}"
        note = " · ".join(filter(None, (name, frame, self._first.quality_name)))
        header = {"turntable": self._first.folders.name, "quality": self._first.quality_name}

        def write(path: Path) -> None:
            write_still(path, sheet.picture(self._pictures(cells, factor, 8, "srgb"), note), header)

        key = self._key("png", cells, captions, columns, note)
        self._store.put("png", key, write)
        self._store.link("png", key, movie.with_suffix(".png"))
        return movie.with_suffix(".png")

    def _movie(self, path: Path, bar: Bar) -> Path:
        """Write the movie of all looks side by side."""
        first, looks = self._first, range(len(self._requests))
        size = first.pictures.quality.width, first.pictures.quality.height
        columns = len(looks) if len(looks) <= ROW else ContactSheet.columns_for(len(looks), size)
        captions: list[Caption] = [(("", name),) for name in self.turntable.looks]
        sheet, factor = self._sheet(captions, columns, 16)

        def write(path: Path) -> None:
            advance = bar("side by side", len(first.requested))

            def pages() -> Iterator[NDArray[Any]]:
                for number in first.requested:
                    pictures = self._pictures([(look, number) for look in looks], factor, 16, "rec709")
                    yield sheet.picture(pictures, " ".join(turn_and_angle(self._table, number)))
                    advance()

            encode = first.pictures.movie_encode
            write_movie(path, prefetch(pages()), first.shot.rate.fps, encode)

        cells = [(look, number) for look in looks for number in first.requested]
        key = self._key("movie", cells, captions, columns, str(first.manifest.rate))
        self._store.put("movie", key, write)
        self._store.link("movie", key, path)
        return path

    def _sheet(self, captions: Sequence[Caption], columns: int, bits: int = 8) -> tuple[ContactSheet, int]:
        """Return a sheet and the factor by which pictures are smaller on it."""
        size = self._first.pictures.quality.width, self._first.pictures.quality.height
        return ContactSheet.fitted(self._heading, captions, size, columns, bits)

    @property
    def _heading(self) -> str:
        name = self._first.name
        return name if self._table.of_file else self._first.shot.heading

    def _pictures(
        self, cells: Sequence[tuple[int, int]], factor: int, bits: int, display: str
    ) -> list[NDArray[Any] | None]:
        """Read the pictures of cells. Raises FrameError for a damaged one."""
        return [self._finished[look].pixels(number, factor, bits, display) for look, number in cells]

    def _key(self, kind: str, cells: Sequence[tuple[int, int]], *content: Any) -> str:
        frames = [self._finished[look].key(number) for look, number in cells]
        displays = [dict(request.manifest.shown_as) for request in self._requests]
        return key_of(TURNTABLE_SHEET.recipe, kind, self._heading, frames, displays, *content)


def turntable(
    common: Common,
    subject: Annotated[
        str,
        typer.Argument(
            metavar="SHOT|MESHFILE", help="A shot, OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD."
        ),
    ],
    options: ShotOptions,
    at: Annotated[int | None, shared_option("at", "The frame of the shot. Default: its first.")] = None,
    frames: Annotated[int, typer.Option(metavar="N", help="Pictures in a full turn.")] = 72,
    turn: Annotated[
        str, typer.Option(metavar="WHAT", help="object, lights, or both: the object first, then the lights.")
    ] = BOTH,
    look: Annotated[
        str | None,
        typer.Option(
            metavar="LOOKS",
            help="Replace the shot's look. Several, as in clay,glaze, also give a movie side by side.",
        ),
    ] = None,
    bare: Annotated[
        bool,
        typer.Option("--bare", help="Keep the shot's own stage, without balls and colour chart."),
    ] = False,
    up: Annotated[
        str | None,
        typer.Option(
            metavar="y|z",
            help="The axis of the mesh file that points up. Default: what it states, or z of an STL, else y.",
        ),
    ] = None,
    part: Annotated[
        str | None,
        typer.Option("--subject", metavar="NAME", help="One of the shot's subjects, if it has several."),
    ] = None,
    quality: Quality = DEFAULT_QUALITY,
    scale: Annotated[
        str | None, typer.Option(metavar="PERCENT", help="Render smaller or larger pictures: 50%, or 0.5.")
    ] = None,
    variant: Annotated[str | None, shared_option("variant")] = None,
) -> None:
    """Render one frame of a shot, or a mesh file, turning; then the lights turning around it.

    `flowsculpt turntable A010_cube --at 22` writes a movie and a sheet of key angles to renders/turntable.
    A grey ball, a chrome ball and a colour chart are in the picture. `flowsculpt turntable model.obj
    --look clay,glaze,chrome` renders each look, and one movie of all three side by side. For STL files
    z is up, for others y, unless `--up` sets it. Several subjects turn together; `--subject heron` turns one
    of them alone.
    """
    project = options.project(common, variant)
    named = PictureOptions(scale=scale).quality(quality, project, ())
    looks = tuple(dict.fromkeys(word.strip() for word in (look or "").split(",") if word.strip()))
    if look is not None and not looks:
        raise UsageError("--look names no look; write one, or several as in clay,glaze,chrome")
    request = TurntableRequest(project, subject, named, at, frames, turn, looks, bare, up, part)

    def draw() -> list[Path]:
        with progress_bars(common.progress) as bar:
            return TurntableSheets(request).draw(bar)

    execute_and_report(common, request.plan, draw)


def _with_absolute_files(settings: Any, folder: Path) -> Any:
    """Return settings with the absolute paths of the files in a folder that they name."""
    if isinstance(settings, dict):
        return {name: _with_absolute_files(value, folder) for name, value in settings.items()}
    if isinstance(settings, list):
        return [_with_absolute_files(value, folder) for value in settings]
    names_file = isinstance(settings, str) and InputFile(folder / settings).is_there()
    return str((folder / settings).absolute()) if names_file else settings


def _shot_around(mesh: Path, up: str, looks: Mapping[str, Any], is_painted: bool) -> str:
    """Return the text of a shot that shows a mesh file as it is, and may have one of the looks of a show.

    up          the axis, y or z, that points up
    is_painted  True where one of its looks shows the paint of the model

    Raises MissingInputError.
    """
    if not mesh.exists():
        raise MissingInputError(f"{mesh}: no such mesh file; check the path")
    InputFile(mesh).size()
    shot = {
        "title": mesh.stem,
        "frames": "1-1",
        "subject": {"model": str(mesh.absolute()), "up": up, **({"paint": "on"} if is_painted else {})},
        "resample": "off",
        **({"looks": looks} if looks else {}),
    }
    return json.dumps(shot, ensure_ascii=False)  # JSON is YAML, quotes and all
