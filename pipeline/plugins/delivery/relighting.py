"""The command `relight`: the light groups of finished frames, each times a factor, and a movie of them.

renders/<shot>/<quality>/relight/<name>/frames/<shot>.0001.exr
renders/<shot>/<quality>/relight/<name>/<shot>.mp4
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from flowsculpt import FrameError, MissingInputError, UsageError
from flowsculpt.api import plural, quote, suggest
from flowsculpt.api.commands import print_error, print_result, progress_bars
from flowsculpt.api.frames import (
    FrameKeys,
    FrameRange,
    FrameRate,
    Locks,
    PictureSequence,
    PipelineStage,
    QualityName,
    RenderRequest,
    SequenceQuery,
    Show,
    Store,
    StoredFiles,
    key_of,
)
from flowsculpt.api.materials import LightRig
from flowsculpt.api.options import (
    DEFAULT_QUALITY,
    Common,
    Frames,
    PictureOptions,
    Quality,
    Shot,
    ShotOptions,
    shared_option,
)
from flowsculpt.api.pictures import (
    RenderedFrame,
    RenderError,
    loop_frames,
    prefetch,
    read_header,
    write_finished,
    write_movie,
)
from flowsculpt.api.shots import NAME_PATTERN, WrittenShot, linear_of_hex, to_yaml
from flowsculpt.pipeline.plugins.delivery.hdr_frames import Frame

RELIGHT = PipelineStage("relight", version=1, packages=("OpenImageIO",), doing="relighting", makes="frame")

Factor = tuple[float, float, float]
"""A factor on the light of a group: red, green and blue of linear Rec.709."""

if TYPE_CHECKING:
    from flowsculpt.api.frames import Framing


@dataclass(frozen=True, eq=False)
class RelitFrames:
    """The frames of a request with factors on their light groups."""

    request: RenderRequest
    store: Store
    factors: Mapping[str, Factor]
    name: str

    @cached_property
    def numbers(self) -> list[int]:
        """The numbers of the frames, in ascending order."""
        return sorted(self.request.requested)

    @property
    def movie_path(self) -> Path:
        return self._folder / self.request.movie_path.name

    def missing(self) -> FrameRange | None:
        """Return the frames that are not finished, or None."""
        keys = self._keys
        lacking = [n for n in self.numbers if keys is None or not self.store.holds("frame", keys[n].frame)]
        return FrameRange.of(lacking) if lacking else None

    def make(self, threads: int, bar: Callable[[str, int], Callable[[], None]]) -> tuple[int, list[str]]:
        """Mix the frames and encode the movie, except what the store holds; `bar` gets a name and a number.

        Returns how many frames were mixed, and the messages about damaged frames; with any, there is no
        movie. Raises MachineError where the disk refuses.
        """
        made, faults = self.mix(threads, bar)
        if not faults:
            self._make_movie(bar("encoding", len(self.numbers)))
        return made, faults

    def mix(self, threads: int, bar: Callable[[str, int], Callable[[], None]]) -> tuple[int, list[str]]:
        """Mix the frames that are finished, except what the store holds. As `make`, without the movie."""
        missing = self.missing() or ()
        numbers = [number for number in self.numbers if number not in missing]
        passed = bar("relighting", len(numbers))
        made, faults = 0, []
        with ThreadPoolExecutor(threads) as pool:
            for outcome in pool.map(self._make_frame, numbers):
                made += outcome is True
                faults += [outcome] if isinstance(outcome, str) else []
                passed()
        return made, faults

    def _make_frame(self, number: int) -> bool | str:
        """Mix a frame unless the store holds it; return whether it did, or why it could not."""
        key = self.key(number)
        if mixes := not self.store.bring("frame", key):
            try:
                self.store.put("frame", key, lambda path: self._write(number, key, path))
            except FrameError as error:
                return str(error)
        self.store.link("frame", key, self.place(number))
        return mixes

    def _write(self, number: int, key: str, path: Path) -> None:
        finished, header = self._read(self._source(number), self.request.place("frame", number))
        light = self._mixed(finished)
        stages = {**header.get("stages", {}), RELIGHT.name: RELIGHT.recipe}
        relit = {"relit": {name: list(factor) for name, factor in self.factors.items()}}
        entries = {**header, **relit, "stages": stages, "finished_key": header["key"], "key": key}
        layers = RenderedFrame({"beauty": light, "alpha": finished["alpha"]})
        write_finished(path, self.request, number, self._framings, layers, entries)

    def _mixed(self, finished: RenderedFrame) -> NDArray[np.float32]:
        """Return the sum (H, W, 3) of the light groups of a frame, each times its factor.

        Groups are added in alphabetical order, as those of a render are.
        """
        picture = self.request.shot.picture
        groups = sorted(picture.lights.groups, key=lambda group: group.layer)
        total = np.zeros_like(finished[groups[0].layer])
        for group in groups:
            factor = np.array(self.factors.get(group.name, (1.0, 1.0, 1.0)))
            total += finished[group.layer] * picture.working_space.from_rec709(factor).astype(np.float32)
        return total

    def _make_movie(self, passed: Callable[[], None]) -> None:
        request = self.request
        rate = FrameRate.of(request.manifest.rate)
        key = key_of(RELIGHT.recipe, request.keys.movie([self.key(n) for n in self.numbers]))
        if not self.store.holds_whole("movie", key):
            shown = loop_frames(self.numbers, request.loop_dissolve, partial(self._shown, passed))
            frames, encode = prefetch(shown), request.pictures.movie_encode
            options: Any = {"projection": request.pictures.projection, "loops": request.loop is not None}
            self.store.put("movie", key, lambda path: write_movie(path, frames, rate.fps, encode, **options))
        self.store.link("movie", key, self.movie_path)

    def _shown(self, passed: Callable[[], None], numbers: list[int]) -> Iterator[Frame]:
        """Yield frames as a display shows them."""
        for number in numbers:
            light = self._read(self.key(number), self.place(number))[0]["beauty"]
            yield self.request.shot.picture.display.pixels(light)
            passed()

    def _read(self, key: str, place: Path) -> tuple[RenderedFrame, dict[str, Any]]:
        reader = StoredFiles("frame").reader(key, size=self.request.pictures.quality.rendered_size)
        return self.store.read("frame", key, place, reader)

    @cached_property
    def _framings(self) -> Mapping[int, Framing]:
        return self.request.pictures.framings(self.store) or {}

    @cached_property
    def _keys(self) -> Mapping[int, FrameKeys] | None:
        return self.request.keys.pictures(self.store, rendered=())

    def _source(self, number: int) -> str:
        """Return the key of a finished frame."""
        assert self._keys is not None, "finished frames have keys"
        return self._keys[number].frame

    def is_mixed(self, number: int) -> bool:
        """Tell whether the store holds a frame."""
        return self._keys is not None and self.store.holds("frame", self.key(number))

    def key(self, number: int) -> str:
        """Return the key of a frame, whose finished frame has one."""
        return key_of(RELIGHT.recipe, self._source(number), {n: list(f) for n, f in self.factors.items()})

    @property
    def _folder(self) -> Path:
        return _folder(self.request) / self.name

    def place(self, number: int) -> Path:
        """Return where a frame is shown."""
        return self._folder / "frames" / self.request.place("frame", number).name


def _folder(request: RenderRequest) -> Path:
    """Return the folder of all relit versions, relative to the root."""
    return request.folders.home / request.quality_name / "relight"


def relit_names(request: RenderRequest, root: Path) -> list[str]:
    """Return the names of the relit versions of a shot at one quality, in alphabetical order."""
    return sorted(folder.parent.name for folder in (root / _folder(request)).glob("*/frames"))


def relit_files(request: RenderRequest, root: Path, name: str) -> dict[int, Path]:
    """Return the files of a relit version by frame number."""
    version = RelitFrames(request, Store(root), {}, name)
    places = {number: root / version.place(number) for number in sorted(request.angles)}
    return {number: path for number, path in places.items() if path.is_file()}


def relit_version(request: RenderRequest, store: Store, name: str) -> RelitFrames:
    """Return the relit version of a name, with the factors that its frames tell.

    Raises MissingInputError where there is none, FrameError where its frames have different factors.
    """
    files = relit_files(request, store.root, name)
    chosen = [files[number] for number in request.requested if number in files] or list(files.values())
    told = set()
    for path in chosen:
        with suppress(RenderError):
            told.add(tuple((group, tuple(f)) for group, f in read_header(path).get("relit", {}).items()))
    if not told:
        names = relit_names(request, store.root)
        others = f"There are: {', '.join(names)}" if names else "flowsculpt relight makes them"
        raise MissingInputError(
            f"{request.name} has no relit frames {name} at {request.quality_name}. {others}"
        )
    if len(told) > 1:
        raise FrameError(
            f"{_folder(request) / name}: its frames were relit with different factors. Relight all of them "
            f"with the same, or choose frames with -f"
        )
    return RelitFrames(request, store, dict(told.pop()), name)


OUTDATED = "its finished frame has changed since; flowsculpt relight mixes it again"


def relit_sequences(query: SequenceQuery) -> Iterator[PictureSequence]:
    """Yield the frames of every relit version. Those whose finished frame was rendered again are stale."""
    root = query.project.root
    for request in query.requests():
        keys = request.keys.pictures(query.project.store, rendered=())
        for name in relit_names(request, root):
            files, stale = relit_files(request, root, name), {}
            for number, path in files.items():
                with suppress(RenderError):
                    if keys is None or read_header(path).get("finished_key") != keys[number].frame:
                        stale[number] = "stale", OUTDATED
            yield PictureSequence(
                shot=request.name,
                kind="relit",
                label=f"{request.quality_name} relit {name}",
                quality=request.quality_name,
                subject=request.folders.title,
                numbers=tuple(files),
                files=files,
                display=request.shot.picture.display,
                faults=stale,
                seconds={},
                source=request.source,
            )


MAX_FACTOR = 1e6

MOST_LETTERS = 60  # letters of the longest name that factors give to a version

_FACTOR = re.compile(r"\s*lights\.(\w+)\s*=(.*)", re.DOTALL)
_HEX = re.compile("#([0-9a-fA-F]{3}|[0-9a-fA-F]{6})")
_INTENSITY = re.compile(r"\s*lights\.intensity(?:\.(\w+))?\s*=(.*)", re.DOTALL)

_OF_SHOT = ("exposure", "hdri", "rig", "softboxes", "turn", "visible")
"""Names under `lights` in a shot file that are not lights."""


@dataclass(frozen=True)
class LightSettings:
    """Settings of the command line: factors on light groups as typed, and settings of the shot."""

    factors: Mapping[str, str]
    of_shot: tuple[str, ...]

    @classmethod
    def of(cls, settings: Iterable[str]) -> LightSettings:
        """Split settings; of several factors on one group the last counts. Raises UsageError."""
        factors, others = {}, []
        for setting in settings:
            if match := _INTENSITY.fullmatch(setting):
                raise UsageError(
                    f"--set {setting}: an intensity belongs to the shot; changing it renders frames "
                    "again. Scale "
                    f"the rendered light by a factor instead: lights.{match[1] or 'key'}={match[2]}"
                )
            match = _FACTOR.fullmatch(setting)
            if match and match[1] not in _OF_SHOT:
                factors[match[1]] = match[2].strip()
            else:
                others.append(setting)
        return cls(factors, tuple(others))

    def by_group(self, shot: str, lights: LightRig) -> dict[str, Factor]:
        """Return the factors (red, green, blue) by light group, in the order of the groups.

        Raises UsageError where there are none, for a group that the shot does not have, and for text that is
        no factor.
        """
        names = [group.name for group in lights.groups]
        if not self.factors:
            raise UsageError(
                f"no light is set. Write, for example, --set lights.{names[0]}=1.4; the light groups of "
                f"{shot} are {', '.join(names)}"
            )
        for name in self.factors:
            if name not in names:
                owner = next((group.name for group in lights.groups if name in group.lights), None)
                remedy = f"It is in group {owner}: set lights.{owner}." if owner else suggest(name, names)
                raise UsageError(f"--set lights.{name}: {shot} has no light group {name}. {remedy}")
        return {name: _parsed(name, self.factors[name]) for name in names if name in self.factors}


def _parsed(name: str, text: str) -> Factor:
    """Return a factor: one number, three of linear Rec.709, or a hexadecimal colour of sRGB."""
    bare = text.strip("[]()'\" ")
    if re.fullmatch(_HEX, bare):
        red, green, blue = linear_of_hex(bare)
        return red, green, blue
    try:
        numbers = [float(part) for part in bare.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 3) or not all(math.isfinite(n) and 0.0 <= n <= MAX_FACTOR for n in numbers):
        raise UsageError(
            f"--set lights.{name}: {quote(text)} is not a factor from 0 to 1e6. Write a number, "
            f"lights.{name}=1.4, or a colour, lights.{name}=1,0.8,0.6 or 'lights.{name}=#ffd0a0'"
        )
    red, green, blue = numbers * (3 // len(numbers))
    return red, green, blue


def version_name(factors: Mapping[str, Factor]) -> str:
    """Return a name for frames with these factors, as in `key1.4_rim1-0.8-0.6`."""
    words = [
        name + "-".join(f"{value:.4g}" for value in (factor[:1] if _is_grey(factor) else factor))
        for name, factor in factors.items()
    ]
    return "_".join(words).replace("+", "")[:MOST_LETTERS]


def permanent(path: Path, of_shot: Sequence[str], lights: LightRig, factors: Mapping[str, Factor]) -> str:
    """Return how the factors are written in the shot file at `path`; `of_shot` are settings over it."""
    members = {each.name: [name for name in each.lights if name in lights.names] for each in lights.groups}
    refused = [
        name
        for name, factor in factors.items()
        if not _is_grey(factor) and set(members[name]) & set(lights.keeping_colours)
    ]
    written_factors = {name: factor for name, factor in factors.items() if name not in refused}
    words = []
    if any(members[name] for name in written_factors):
        data: Any = WrittenShot.read(path, settings=of_shot).source.data
        written = data.get("lights")
        before = written.get("intensity", 1.0) if isinstance(written, dict) else 1.0
        if not isinstance(before, dict):
            before = {} if before == 1.0 else dict.fromkeys(lights.names, float(before))
        after = {
            light: _multiplied(before.get(light, 1.0), factor)
            for name, factor in written_factors.items()
            for light in members[name]
        }
        intensity = {**before, **after}
        if isinstance(written, dict):
            words.append(f"write intensity: {to_yaml(intensity)} under lights in {path}")
        else:
            rig = {"rig": written or "studio", "intensity": intensity}
            words.append(f"write lights: {to_yaml(rig)} in {path}")
    if refused:
        words.append(
            f"{', '.join(refused)}: the colour of daylight and of an hdri cannot be set; write softboxes or "
            "a sky with a radiance of that colour"
        )
    sentences = ["To render with these lights, " + "; ".join(words) + "."] if words else []
    seen = {light for group in lights.groups for light in group.lights} - set(lights.names)  # by the lens
    if len({_factor_on(light, lights, factors) for light in ("sky", *seen)} - {None}) > 1:
        sentences.append("Only relit frames can show a sky brighter or darker than its light.")
    return " ".join(sentences)


def _multiplied(intensity: Any, factor: Factor) -> float | list[float]:
    """Return the intensity of a shot file, a number or a colour, times a factor."""
    before = linear_of_hex(intensity) if isinstance(intensity, str) else intensity
    parts = before if isinstance(before, Sequence) else [before] * 3
    product = [float(f"{float(a) * b:.6g}") for a, b in zip(parts, factor, strict=True)]
    return product[0] if len(set(product)) == 1 else product


def _factor_on(light: str, lights: LightRig, factors: Mapping[str, Factor]) -> Factor | None:
    """Return the factor on a light, or None where it is in no group."""
    owner = next((group.name for group in lights.groups if light in group.lights), None)
    return None if owner is None else factors.get(owner, (1.0, 1.0, 1.0))


def _is_grey(factor: Factor) -> bool:
    return len(set(factor)) == 1


def relight(
    common: Common,
    shot: Shot,
    settings: Annotated[
        list[str] | None,
        shared_option(
            "settings",
            "Multiply the light of a group: by a number, as in lights.key=1.4, or by a colour, as in "
            "lights.rim=1,0.8,0.6 or 'lights.rim=#ffd0a0'; 0 turns it off. Repeatable. Other names replace "
            "values of the shot, as in `render`.",
            metavar="lights.NAME=FACTOR",
        ),
    ] = None,
    quality: Quality = DEFAULT_QUALITY,
    frames: Frames = None,
    name: Annotated[
        str | None, typer.Option(metavar="VERSION", help="The folder of the frames. Default: the factors.")
    ] = None,
    crop: Annotated[
        str | None,
        typer.Option(
            metavar="X0,Y0,X1,Y1", help="Relight this part: its edges, in fractions of the picture or pixels."
        ),
    ] = None,
    scale: Annotated[
        str | None, typer.Option(metavar="PERCENT", help="Relight pictures of this size: 50%, or 0.5.")
    ] = None,
    variant: Annotated[str | None, shared_option("variant")] = None,
    allow_code: Annotated[bool, shared_option("allow_code")] = False,
) -> None:
    """Change lights of finished frames by factors, without rendering: new frames and a movie in seconds.

    The shot needs light groups: write `light_groups: each` in its file and render it once. Then
    `flowsculpt relight A010_cube -q daily --set lights.key=1.4 --set lights.rim=1,0.8,0.6` writes frames and
    a movie to renders/A010_cube/daily/relight/key1.4_rim1-0.8-0.6: the same light as a render, through
    the same view. At the end it prints what to write in the shot file to render with these lights.
    """
    given = LightSettings.of(settings or ())
    project = ShotOptions(list(given.of_shot), allow_code).project(common, variant)
    quality_name = PictureOptions(crop, scale).quality(quality, project, [shot])
    request = project.find_request(shot, quality_name, frames)
    lights, path = request.shot.picture.lights, Show().find_shot(shot)
    if not lights.groups:
        raise UsageError(
            f"{path}: {request.name} has no light groups, so its frames cannot be relit. Write "
            f"light_groups: each in the file, and render it: {_render_command(request)}"
        )
    factors = given.by_group(request.name, lights)
    if name is not None and not re.fullmatch(NAME_PATTERN, name):
        raise UsageError(f"--name {name}: a version has letters, digits, _, - and . in its name, as warm_key")
    version = name or version_name(factors)
    relit = RelitFrames(project.as_finished(request), project.store, factors, version)
    if missing := relit.missing():
        raise MissingInputError(
            f"{request.name}: frame {missing} is not finished at {request.quality_name}, so it cannot be "
            f"relit. Render it first: {_render_command(relit.request)} -f {missing}"
        )
    count = plural(len(relit.numbers), "frame")
    facts: dict[str, Any] = {"path": str(relit.movie_path), "frames": relit.numbers, "factors": factors}
    if common.dry_run:
        print_result(f"{relit.movie_path}: {count} would be relit.", facts, common.json)
        return
    started = time.monotonic()
    with Locks(common.root).hold_with_writers(common.wait), progress_bars(common.progress) as bar:
        made, faults = relit.make(common.cores, bar)
    seconds = time.monotonic() - started
    for fault in faults:
        print_error(fault)
    if faults:
        words = f"{plural(len(faults), 'frame')} could not be relit, so no movie was made."
    else:
        facts["permanent"] = permanent(path, given.of_shot, lights, factors)
        words = f"{relit.movie_path}: {count}, {made} relit in {seconds:.0f} s.\n{facts['permanent']}"
    facts |= {"relit": made, "failed": faults, "seconds": round(seconds, 2)}
    print_result(words, facts, common.json)
    raise typer.Exit(FrameError.exit_code if faults else 0)


def _render_command(request: RenderRequest) -> str:
    """Return the command that renders the shot and quality of a request."""
    settings = "".join(f" --set '{setting}'" for setting in request.source.settings)
    return f"flowsculpt render {request.name} {QualityName.of(request.quality_name).options}{settings}"
