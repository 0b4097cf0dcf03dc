"""Plug-ins: what one may add, and the registry of those that are installed.

A distribution names its plug-ins as entry points of the group `flowsculpt.plugins`, each a `Plugin`. The
core's own commands and the plug-ins that come with it, in `pipeline/plugins/`, are entry points too. Only the
modules with the entry points are imported here: what a plug-in adds is named as "module:function" and
imported when used.
"""

from __future__ import annotations

import hashlib
import logging
import os
import re
import sys
import threading
import tomllib
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

from flowsculpt.pipeline.plugin_contracts import (
    API,
    ContractError,
    fault_of_fields,
    fault_of_types,
    fault_of_version,
    require_class,
)
from flowsculpt.render.base.foreign_code import foreign_code, located_reason, reason_of_foreign
from flowsculpt.render.base.render_errors import MachineError

if TYPE_CHECKING:
    from flowsculpt.render.scene.aovs import RenderedFrame

T = TypeVar("T")

LOG = logging.getLogger("flowsculpt.plugins")
"""Warnings about parts of plug-ins that fail when they are first used."""

GROUP = "flowsculpt.plugins"
"""The group of entry points that name plug-ins."""


@dataclass(frozen=True)
class Command:
    """A command, or a format of the command `export`.

    function  "module:function" that has the options as parameters, as those of `render_commands`
    summary   its line in the help
    panel     the part of the help that lists it
    folder    the folder in renders/ with what it makes, by whose name no shot may be called; empty for none
    also      words by which other programs call it: whoever types one gets the command's name
    opening   a sentence for the head of the help: what beginners call first, with an example
    """

    function: str
    summary: str
    panel: str = "Plug-ins"
    folder: str = ""
    also: str = ""
    opening: str = ""


class PictureTask(Protocol):
    """The function of a picture stage, called for each frame, in several processes."""

    def __call__(self, frame: RenderedFrame, entry: Any, number: int) -> RenderedFrame:
        """Return a rendered frame with changed layers; equal arguments give equal results.

        frame   its `arrays` are the layers by name, float32, of height and width of the picture: `beauty`
                (H, W, 3) and `alpha` (H, W), linear light, and all AOVs, `depth` in units among them
        entry   what the shot writes for the stage, an object of the entry's model
        number  of the frame

        Layers may be added; none may be left out or get another shape. Raises FrameError where the frame
        cannot be made; anything else that it raises fails the frame as well, and is reported as an error of
        the plug-in.
        """
        ...


@dataclass(frozen=True)
class FileFormat:
    """What is read of files with a suffix: each "module:name", or empty where they do not hold it.

    surface  a `SurfaceReader` of models
    paint    a `PaintReader` of what lies on the faces of these models
    motion   a function of a file's path and a `ScenePart` or None, which returns a `MovingSurface`; for files
             that hold points alone it takes the path of the model with the faces in place of the part
    edit     a function of another program's timeline, the names of the shots and the folder of edits; returns
             the path and the text of an edit
    """

    surface: str = ""
    paint: str = ""
    edit: str = ""
    motion: str = ""


@dataclass(frozen=True)
class PictureStage:
    """A picture stage, between `render` and `finish`, for shots that have its entry.

    task     "module:function", a `PictureTask`
    version  raised when equal arguments give other results
    doing    what it does, in the words of progress bars
    is_last  True if `finish` does it, once the noise is removed
    """

    task: str
    version: int
    doing: str
    is_last: bool = False


@dataclass(frozen=True)
class ShotEntry:
    """An entry of shot files, `{PLUGIN: {NAME: {…}}}`, which `read_shot(…).entries` has as "PLUGIN.NAME".

    model  "module:Model", a pydantic model of the entry
    stage  the stage that shots with the entry have; None where it only holds settings for commands
    """

    model: str
    stage: PictureStage | None = None


@dataclass(frozen=True)
class Plugin:
    """A plug-in and what it adds; functions and classes are named as "module:name".

    name           a letter, then letters, digits and _; shot files write `NAME.part` for what a plug-in adds
                   to them, so that they say which plug-ins a shot needs
    version        part of the keys of what the plug-in decides; where it is empty, flows are decided by their
                   `cache_data` alone
    api            the API version that it is built for
    flows          velocity fields and other flows, dataclasses with documented parameters, by their names
    looks          `Material`s by their names
    subjects       `SubjectKind`s, `PointsKind`s and `CopyLayout`s, kinds of subjects and layouts of
                   copies, by their names: `subject: {PLUGIN.NAME: {…}}`,
                   `copies: {count: 9, PLUGIN.NAME: {…}}`
    encodes        `Encode`s of `deliver --as PLUGIN.NAME`, by their names
    entries        entries of shot files by their names, and the stages that shots with them have
    frame_sources  `FrameSource`s by their kinds, which are names of folders in renders/ too
    commands       commands by name; formats of the command `export` have the name "export FORMAT"
    observer       a `RunObserver`, which is called around runs and deliveries
    extras         `ShotExtras`: what the plug-in has of a shot besides its frames
    formats        `FileFormat`s of models and timelines by suffix: `obj`, `otio`
    resamplers     `PolygonMethod`s, by the names that shots write: `resample: {method: NAME}`
    remote_stores  `RemoteStores`, which finds remote stores by their addresses
    """

    name: str
    version: str
    api: int = API
    flows: Mapping[str, str] = field(default_factory=dict)
    looks: Mapping[str, str] = field(default_factory=dict)
    subjects: Mapping[str, str] = field(default_factory=dict)
    encodes: Mapping[str, str] = field(default_factory=dict)
    entries: Mapping[str, ShotEntry] = field(default_factory=dict)
    frame_sources: Mapping[str, str] = field(default_factory=dict)
    commands: Mapping[str, Command] = field(default_factory=dict)
    observer: str = ""
    extras: str = ""
    formats: Mapping[str, FileFormat] = field(default_factory=dict)
    resamplers: Mapping[str, str] = field(default_factory=dict)
    remote_stores: str = ""

    def __new__(cls, *values: Any, **given: Any) -> Self:
        """Begin a plug-in. Raises ContractError for a version of the API and for fields that are not ours."""
        api = given.get("api", values[2] if len(values) > 2 else API)
        known = [each.name for each in fields(cls)]
        if fault := fault_of_version(api) or fault_of_fields(given, known):
            raise ContractError(fault)
        return super().__new__(cls)

    @property
    def stages(self) -> dict[str, PictureStage]:
        """Its stages, by the names of their entries."""
        return {name: entry.stage for name, entry in self.entries.items() if entry.stage is not None}

    @property
    def sources(self) -> list[Path]:
        """The files of the packages and modules with what it adds to shots; none of flowsculpt's."""
        return _files_of((self.flows, self.looks, self.subjects, self.entries))

    @property
    def files(self) -> list[Path]:
        """The files of all its packages and modules; none of flowsculpt's."""
        return _files_of(vars(self).values())


def _files_of(values: Iterable[Any]) -> list[Path]:
    """Return the files of the packages and modules that places in values of fields name."""
    tops = {place.partition(":")[0].partition(".")[0] for place in _places(values)}
    found: list[Path] = []
    for spec in filter(None, map(find_spec, sorted(tops - {"flowsculpt"}))):
        folders = spec.submodule_search_locations or ()
        found += [Path(file) for folder in folders for file in _files_below(folder)]
        found += [Path(spec.origin)] if spec.origin and not folders else []
    return found


def _files_below(folder: str) -> Iterator[str]:
    """Yield the files of a package in order, without compiled ones."""
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if name not in ("__pycache__", "compiled"))
        yield from (f"{place}/{name}" for name in sorted(names))


def _places(values: Iterable[Any]) -> Iterator[str]:
    """Yield each "module:name" in values of fields."""
    for value in values:
        if isinstance(value, Mapping):
            yield from _places(value.values())
        elif is_dataclass(value):
            yield from _places(vars(value).values())
        elif isinstance(value, str) and _PLACE.fullmatch(value):
            yield value


@dataclass(frozen=True)
class Plugins:
    """The plug-ins that are installed and can be loaded, by name.

    faults  a message for each that cannot
    """

    loaded: Mapping[str, Plugin]
    faults: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Plugin]:
        return iter(self.loaded.values())

    @cached_property
    def code(self) -> str:
        """The digest of all code: of Python's version, of our files and of those of plug-ins.

        Cached answers are kept under it: they may depend on too much rather than on too little.
        """
        digest, home = hashlib.sha256(f"{sys.version}\n{self!r}".encode()), str(Path(__file__).parents[1])
        ours = (file for package in ("pipeline", "render") for file in _files_below(f"{home}/{package}"))
        for file in (*ours, *(str(file) for plugin in self for file in plugin.files)):
            with suppress(OSError), open(file, "rb") as opened:  # noqa: PTH123  # Paths are slow
                content = opened.read()
                digest.update(f"{file.removeprefix(home)}\0{len(content)}\0".encode())
                digest.update(content)
        return digest.hexdigest()

    @cached_property
    def packages(self) -> tuple[str, ...]:
        """Names and versions of all installed packages, by their folders in Python's search path."""
        folders = (folder for folder in sys.path if os.path.isdir(folder))  # noqa: PTH112  # Paths are slow
        names = (name for folder in folders for name in os.listdir(folder))  # noqa: PTH208
        return tuple(sorted({name for name in names if name.endswith((".dist-info", ".egg-info"))}))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Messages about parts of plug-ins that were asked for and are left out."""
        return tuple(_LEFT_OUT)

    def parts(self, door: str, make: Callable[[Plugin, str, Any], T]) -> dict[str, T]:
        """Return what plug-ins add to shot files by a field of `Plugin`, by names such as `marbling.swirl`.

        Of shipped plug-ins, flows and a part with the name of its plug-in have their names alone.

        make  gets the plug-in, the name and the object, and returns the entry. A part for which it raises, or
              that cannot be imported, is left out with a warning
        """
        found = {}
        for plugin in self:
            for part, value in getattr(plugin, door).items():
                place = value.model if isinstance(value, ShotEntry) else value
                is_whole = place.startswith("flowsculpt.") and (part == plugin.name or door == "flows")
                name = part if is_whole else f"{plugin.name}.{part}"
                try:
                    found[name] = make(plugin, name, named(place))
                except Exception as error:
                    _leave_out(plugin.name, name, error)
        return found

    def lacking(self, name: str) -> str | None:
        """Return the sentence about a plug-in that a name needs; None where all is there.

        name  `people.person`, or what a plug-in that comes with flowsculpt adds, as it is written: `become`,
              `.obj`, `flowsculpt review`
        """
        plugin, _, part = name.partition(".")
        if not part or not plugin:
            plugin = next((each for each, names in _shipped().items() if name in names), "")
        if not _NAME.fullmatch(plugin):
            return None
        loaded = self.loaded.get(plugin)
        doors = ("flows", "looks", "subjects", "encodes", "entries")
        if loaded and any(part in getattr(loaded, door) for door in doors):
            return f"Plug-in {plugin} could not load it."
        if any(fault.startswith(f"plug-in {plugin} ") for fault in self.faults):  # perhaps a second one
            return f"It needs plug-in {plugin}, which did not load; see the warning."
        source = "it comes with flowsculpt: install that again" if plugin in _shipped() else "pip install …"
        return None if loaded else f"It needs plug-in {plugin}, which is not installed ({source})."

    @property
    def commands(self) -> dict[str, Command]:
        """The commands of all plug-ins by name, and the formats of `export` as `export FORMAT`."""
        return {name: command for plugin in self for name, command in plugin.commands.items()}

    @property
    def picture_stages(self) -> dict[str, tuple[Plugin, PictureStage]]:
        """Picture stages and their plug-ins, by the names of entries."""
        stages = ((plugin, name) for plugin in self for name in plugin.stages)
        return {f"{plugin.name}.{name}": (plugin, plugin.stages[name]) for plugin, name in stages}

    @property
    def frame_sources(self) -> dict[str, str]:
        """The sources of frames by kind."""
        return {kind: source for plugin in self for kind, source in plugin.frame_sources.items()}

    def readers(self, part: str) -> dict[str, str]:
        """Return the readers of a part of files, `surface`, `paint`, `motion` or `edit`, by suffix."""
        forms = (item for plugin in self for item in plugin.formats.items())
        return {suffix: place for suffix, form in forms if (place := getattr(form, part))}

    def classes(self, door: str, contract: Any) -> dict[str, Any]:
        """Return the classes that plug-ins name by a field of `Plugin`, by their names in it.

        They extend the contract. One that cannot be used is left out with a warning, the first time.
        """
        named = ((plugin.name, *item) for plugin in self for item in getattr(plugin, door).items())
        found = {name: _class(plugin, place, contract) for plugin, name, place in named}
        return {name: each for name, each in found.items() if each is not None}

    def objects(self, door: str, contract: type[T]) -> dict[str, T]:
        """Return an object of the class that each plug-in names by a field of `Plugin`, by plug-ins' names.

        The classes extend the contract. One that cannot be used is left out with a warning, the first time.
        """
        kind: Any = contract
        made = {plugin.name: _object(plugin.name, getattr(plugin, door), kind) for plugin in self}
        return {name: each for name, each in made.items() if each is not None}


@cache
def _shipped() -> Mapping[str, list[str]]:
    """Return what the plug-ins that come with flowsculpt add, by their names."""
    return tomllib.loads((Path(__file__).parent / "plugins" / "added.toml").read_text("utf-8"))


_LOADING: list[str] = []  # the entry point whose module is being imported
_LOOKS = threading.RLock()  # held by the thread that looks for plug-ins


@cache
def plugins() -> Plugins:
    """Return the plug-ins of this environment; they are looked for once in a process.

    Raises ImportError in a thread while it looks for them.
    """
    with _LOOKS:
        return _found()


def _found() -> Plugins:
    if _LOADING:
        raise ImportError(
            f"{_LOADING[0].partition(':')[0]} imports what itself needs the plug-ins, such as read_shot; "
            "import that in the functions that use it"
        )
    loaded: dict[str, Plugin] = {}
    faults: list[str] = []
    taken: dict[str, str] = {}  # what a plug-in adds, and the name of the plug-in
    packages: dict[str, str] = {}  # by the names of plug-ins
    for entry in sorted(entry_points(group=GROUP), key=_order):
        try:
            _LOADING.append(entry.value)
            plugin = _loaded(entry)
        except Exception as error:
            faults.append(f"plug-in {entry.name} ({entry.value}) is left out: {_reason(error)}")
            continue
        finally:
            _LOADING.pop()
        package = entry.dist.name if entry.dist else entry.module
        if fault := _refusal(plugin, package, packages, taken):
            faults.append(f"plug-in {plugin.name} ({entry.value}) is left out: {fault}")
            continue
        loaded[plugin.name] = plugin
        packages[plugin.name] = package
        taken |= dict.fromkeys(_added(plugin), plugin.name)
    return Plugins(loaded, tuple(faults))


def named(place: str) -> Any:
    """Return what "module:name" names, importing the module."""
    module, _, name = place.partition(":")
    if not name:
        raise ValueError(f'{place!r} is not "module:name"')
    with nullcontext() if module.startswith("flowsculpt.") else foreign_code():
        return getattr(import_module(module), name)


@cache
def _class(plugin: str, place: str, contract: type) -> Any:
    """Return the class at a place; None, with a warning the first time, where it cannot be used."""

    def checked() -> Any:
        require_class(kind := named(place), contract)
        return kind

    return _unless_left_out(plugin, place, checked)


@cache
def _object(plugin: str, place: str, contract: type) -> Any:
    """Return an object of the class at a place, once in a process; None where there is none to use."""
    kind = _class(plugin, place, contract) if place else None
    return None if kind is None else _unless_left_out(plugin, place, kind)


def _unless_left_out(plugin: str, place: str, make: Callable[[], Any]) -> Any:
    """Return what is made; None, with a warning, where that fails in a plug-in that is not ours."""
    try:
        return make()
    except Exception as error:
        if place.startswith("flowsculpt."):
            raise
        _leave_out(plugin, place, error)
        return None


_LEFT_OUT: list[str] = []


def _leave_out(plugin: str, part: str, error: Exception) -> None:
    """Warn about a part of a plug-in that is left out."""
    _LEFT_OUT.append(f"plug-in {plugin}: {part} is left out: {_reason(error)}")
    LOG.warning(_LEFT_OUT[-1])


def _reason(error: Exception) -> str:
    """Return why a plug-in or a part of it is left out, in one sentence."""
    return str(error) if isinstance(error, ContractError) else located_reason(error)


def fault_of_plugin(error: BaseException) -> MachineError | None:
    """Return an error raised by the code of a plug-in as one that names its line; None for any other."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [(frame.filename, frame.lineno) for frame in frames]
    if loc := getattr(error, "loc", None):  # numba compiles a kernel far from its line
        lines.append((loc.filename, loc.line))
    owners = {str(file): plugin.name for plugin in plugins() for file in plugin.files}
    for file, line in reversed(lines):
        if file in owners:
            return MachineError(f"{file}:{line}: plug-in {owners[file]}: {reason_of_foreign(error)}")
    return None


def _order(entry: EntryPoint) -> tuple[bool, bool, str]:
    """Return what sorts the core before the plug-ins that come with it, and these before others."""
    return (
        not entry.module.startswith("flowsculpt.pipeline.cli"),
        not entry.module.startswith("flowsculpt."),
        entry.name,
    )


def _loaded(entry: EntryPoint) -> Plugin:
    """Return the plug-in of an entry point. Raises TypeError for what is none, and what importing raises."""
    with nullcontext() if entry.module.startswith("flowsculpt.") else foreign_code():
        plugin = entry.load()
    if not isinstance(plugin, Plugin):
        raise TypeError(f"{entry.value} is not a flowsculpt.pipeline.plugin.Plugin")
    return plugin


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_PLACE = re.compile(r"[\w.]+:\w+")
_COMMAND = re.compile(r"(?!export$)(export )?[A-Za-z0-9][A-Za-z0-9_.-]*")


def _refusal(
    plugin: Plugin, package: str, packages: Mapping[str, str], taken: Mapping[str, str]
) -> str | None:
    """Return why a plug-in of a package cannot be used next to those that are loaded; None where it can."""
    if fault := fault_of_types(plugin):
        return fault
    if not _NAME.fullmatch(plugin.name):
        return f"its name {plugin.name!r} is not a letter followed by letters, digits and _"
    for words in plugin.commands:
        if not _COMMAND.fullmatch(words):
            return f"its command {words!r} is not a word; write a word, or export and the name of a format"
    if other := packages.get(plugin.name):
        return f"packages {other} and {package} both have a plug-in {plugin.name}; uninstall one of the two"
    for added in _added(plugin):
        if added in taken:
            return f"plug-in {taken[added]} adds {added} too; uninstall one of the two"
    return None


def _added(plugin: Plugin) -> Iterator[str]:
    """Yield the names that a plug-in adds and that must be its own."""
    doors = {
        "command": plugin.commands,
        "reader of": plugin.formats,
        "method": plugin.resamplers,
        "frames of": plugin.frame_sources,
    }
    for kind, names in doors.items():
        yield from (f"{kind} {name}" for name in names)
