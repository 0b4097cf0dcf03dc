"""Verdicts of `validate` about shots and edits, kept for as long as all that decides them is as it was.

That is the code of flowsculpt and of plug-ins, the packages that are installed, the machine, the settings,
and the contents of all files that are read, with the names around them. Files with mistakes are checked each
time.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flowsculpt import FlowsculptError
from flowsculpt.api import plugins
from flowsculpt.api.commands import Project
from flowsculpt.api.files import InputFile, from_plain, to_plain
from flowsculpt.api.frames import Folders, QualityName, Show, key_of
from flowsculpt.api.options import Common
from flowsculpt.pipeline.plugins.authoring.verdict import Verdict

if TYPE_CHECKING:  # imported where something is checked, which takes a second
    from flowsculpt.api.shots import Shot
    from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrames

Digests = tuple[tuple[str, str], ...]
"""Paths of files and their digests, empty for those that must not be there."""

Decided = tuple[Any, Digests | None]
"""Plain data, and the files that decide them; None where more does."""

LOOKED_AT = 8
"""Frames that the light of a shot is judged by."""

MOST_NAMES = 5000
"""Names of files below the folders that a shot reads from, up to which answers about it are kept."""


@dataclass(frozen=True)
class _Kept:
    """Plain data that follow from files.

    names  digests of the names below the folders of the files: what is looked for may come to be there
    """

    files: Digests
    names: Digests | None
    data: Any


@dataclass(frozen=True)
class Verdicts:
    """Finds verdicts about shots and edits with settings, or those that were kept.

    fresh  True if nothing that was kept is used
    """

    common: Common
    settings: tuple[str, ...]
    fresh: bool = False

    def of_shot(self, name: str) -> Verdict:
        """Return the verdict about a shot file, and if it is well written about its scene and its light."""
        verdict = Verdict(name)
        try:
            path = Show().find_shot(name)
        except FlowsculptError as error:
            verdict.add_error(error)
            return verdict

        def decided() -> Decided:
            from flowsculpt.pipeline.plugins.authoring.shot_checks import check_shot

            written = _written(path)
            shot = check_shot(verdict, path, self.settings, self._first_frames)
            files = None if shot is None or verdict.errors else self._files_of([shot], written)
            return to_plain(verdict), files

        verdict = from_plain(Verdict, self._found(decided, "verdict", name))
        if not verdict.errors:
            verdict.warnings += [f"{name}: {note}" for note in self._light(path)]
        return verdict

    def of_edit(self, name: str) -> Verdict:
        """Return the verdict about an edit and the files of its shots."""

        def decided() -> Decided:
            verdict = Verdict(name)
            try:
                folder = Show().find_edit(name).parent
                written = _digests({folder / Show().defaults.name, *folder.glob("*.yaml")})
                edit = Show().check_edit(name, self.settings)
            except FlowsculptError as error:
                verdict.add_error(error)
                return to_plain(verdict), None
            sound = {} if edit.sound is None else {str(edit.sound.file): edit.sound.digest}
            return to_plain(verdict), self._files_of(edit.shots, {**written, **sound})

        return from_plain(Verdict, self._found(decided, "verdict on edit", name))

    @cached_property
    def _first_frames(self) -> FirstFrames:
        from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrames

        return FirstFrames()

    @cached_property
    def _project(self) -> Project:
        common = self.common
        return Project(common.root, common.cores, settings=self.settings, profile=common.profile)

    def _found(self, decided: Callable[[], Decided], *found_from: Any) -> Any:
        """Return what is decided now, or was before; a check measures times, so that counts per machine."""
        ours = {name: value for name, value in os.environ.items() if name.startswith(_VARIABLES)}
        here = platform.node(), self.common.cores, str(Path.cwd()), ours, plugins().packages
        cache, key = self._project.cache, (*found_from, self.settings, *here)

        def is_current(kept: _Kept) -> bool:
            return (
                kept.names is not None
                and cache.are_current(kept.files)
                and _names_around(kept.files) == kept.names
            )

        known = None if self.fresh else cache.get(_Kept, *key)
        if known is not None and is_current(known):
            return known.data
        data, files = decided()
        if files is not None and not plugins().left_out:
            made = _Kept(files, _names_around(files), data)
            if is_current(made):  # nothing is kept of files that change meanwhile
                cache.put(made, *key)
        return data

    def _files_of(self, shots: Iterable[Shot], written: Mapping[str, str]) -> Digests | None:
        """Return the files that decide a verdict; None where there are more, such as all fonts of the system.

        written  the shot files, with digests from before they were read
        """
        files = dict(written)
        for shot in shots:
            if shot.picture.view.digest:  # a colour config: it reads tables that no digest covers
                return None
            files |= {str(path): digest for path, digest in shot.files}
        beside = {Path(path).parent for path in written}
        others = [file for file in map(Path, files) if not any(map(file.is_relative_to, beside))]
        if not others:
            return tuple(files.items())
        try:
            texts = [Path(path).read_text("utf-8", "replace") for path, digest in written.items() if digest]
        except OSError:
            return None
        is_named = all(any(file.name in text for text in (*texts, *self.settings)) for file in others)
        return tuple(files.items()) if is_named else None

    def _light(self, path: Path) -> list[str]:
        """Return what is to be said about the light of a shot, by up to LOOKED_AT of its finished frames.

        They are whole pictures, those of its draft if there are any.
        """
        root, project = self.common.root, self._project
        if not any(
            map(_is_whole, (each.name for each in (root / Folders.of_shot(path.stem).home).glob("*/")))
        ):
            return []
        whole = [each for each in project.rendered_requests(path) if _is_whole(each.quality_name)]
        if not whole:
            return []
        from flowsculpt.api.frames import FinishedPictures

        request = min(whole, key=lambda each: each.quality_name != "draft")
        finished = FinishedPictures(request, project.store)
        places = {n: root / request.place("frame", n) for n in sorted(request.angles)}
        there = [n for n, place in places.items() if place.exists()]
        looked_at = there[:: -(-len(there) // LOOKED_AT) or 1]

        def decided() -> Decided:
            files = _digests(places[n] for n in looked_at)
            notes = FinishedPictures.light_notes({n: finished.pixels(n, 2) for n in looked_at})
            return notes, None if request.shot.picture.view.digest else tuple(files.items())

        source, keys = request.source, {n: finished.key(n) for n in looked_at}
        return list(self._found(decided, "light", source.read_from, source.manifest.inputs, keys))


_VARIABLES = ("FLOWSCULPT_", "NUMBA_", "OMP_")
"""Beginnings of the names of environment variables by which computations go."""


def _names_around(files: Digests) -> Digests | None:
    """Return digests of the names below the folders of files other than shots; None for too many names."""
    found, left = [], MOST_NAMES
    for folder in sorted({str(Path(path).parent) for path, _ in files if not path.endswith(".yaml")}):
        names = []
        for place, folders, inside in os.walk(folder):
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            names.append((place, sorted(inside)))
            left -= 1 + len(inside)
            if left < 0:
                return None
        found.append((folder, key_of(names)))
    return tuple(found)


def _is_whole(quality_name: str) -> bool:
    quality = QualityName.of(quality_name)
    return quality.is_known and quality.crop is None


def _written(path: Path) -> dict[str, str]:
    """Return the files that a shot is written in: all beside it where it may extend others."""
    content = b""
    with suppress(FlowsculptError):  # which the check reports
        content = InputFile(path).content().replace(b"\0", b"")  # of UTF-16
    others = path.parent.glob("*.yaml") if b"extends" in content else ()
    return _digests({path, path.parent / Show().defaults.name, *others})


def _digests(files: Iterable[Path]) -> dict[str, str]:
    """Return digests of files by path, empty for those that are not there or cannot be read."""

    def digest(file: Path) -> str:
        try:
            return InputFile(file).digest()
        except FlowsculptError:
            return ""

    return {str(file): digest(file) for file in sorted(files)}
