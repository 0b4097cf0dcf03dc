"""The shot file as the live page and other programs edit it: values, edits with undo and redo, and refusals.

An editor names the digest of the text that it shows. Where the file has another one by now, nothing is
written.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import RLock
from typing import Any

from flowsculpt import FlowsculptError, MissingInputError, UsageError
from flowsculpt.api import ShotError
from flowsculpt.api.files import ChangedFileError, InputFile, atomic_write
from flowsculpt.api.shots import WrittenShot, YamlSource, read_shot
from flowsculpt.pipeline.plugins.preview.settable_values import settable_values
from flowsculpt.pipeline.plugins.preview.text_edits import (
    ValueEdit,
    Where,
    edited,
    parsed,
    path_text,
    with_times,
)
from flowsculpt.pipeline.plugins.preview.value_titles import value_title

MOST_STEPS = 200  # edits that can be undone

MOST_EDITS, DEEPEST_PATH = 1000, 24
"""Values that one request may change, and steps of a path."""

MOST_REQUEST_BYTES = 1 << 20
"""Size of the largest request: several times that of the largest shot file, since JSON takes more space."""

PATH_FORM = "the path of an edit is a list of names and numbers"


class StaleError(UsageError):
    """Raised where the file is not what the editor has read."""


@dataclass(frozen=True)
class Step:
    """The text before and after an edit; edits of one gesture, such as a drag, are one step."""

    before: str
    after: str
    gesture: str


@dataclass(eq=False)
class ShotEditor:
    """Edits one shot file; safe to use from several threads; one writes at a time.

    settings  values of the command line, which replace those of the file and cannot be edited
    """

    path: Path
    settings: tuple[str, ...] = ()
    allow_code: bool = False
    _lock: RLock = field(default_factory=RLock)
    _done: list[Step] = field(default_factory=list)
    _undone: list[Step] = field(default_factory=list)

    def state(self) -> dict[str, Any]:
        """Return digest, values and whether there is something to undo, as plain data.

        Raises ShotError and MissingInputError where the file is not a valid shot.
        """
        with self._lock:
            text = YamlSource.read_text(self.path)
            self._forget_others(text)
            return self.state_of(text)

    def edit(self, digest: str, edits: Sequence[ValueEdit], gesture: str = "") -> dict[str, Any]:
        """Write edits into the file and return the new state.

        digest   of the text that the page shows
        gesture  edits with the same name, one after another, are undone together; empty for an edit alone

        Raises StaleError where the file has another text, ShotError where the shot would not be valid, and
        MachineError where the disk refuses. The file then is as it was.
        """
        with self._lock:
            before = self._current(digest)
            after = self._edited(before, edits)
            state = self.state_of(after)
            if after != before:
                self._write(after, before)
                self._note(Step(before, after, gesture))
            return {**state, **self._can()}

    def undo(self, digest: str) -> dict[str, Any]:
        """Write the text before the last edit and return the state. Raises what `edit` raises."""
        return self._move(digest, self._done, self._undone, "undo")

    def redo(self, digest: str) -> dict[str, Any]:
        """Write the text after the last edit that was undone and return the state."""
        return self._move(digest, self._undone, self._done, "redo")

    def trial(self, digest: str, edits: Sequence[ValueEdit]) -> str:
        """Return the text with edits and write nothing. Raises what `edit` raises, except disk errors."""
        with self._lock:
            before = self._current(digest)
        return self._edited(before, edits, verify=False)

    def _edited(self, text: str, edits: Sequence[ValueEdit], verify: bool = True) -> str:
        source = parsed(self.path, text)
        for edit in edits:
            self._require_own(source, edit)
        clock = WrittenShot(source).clock
        after = edited(self.path, text, edits, lambda key: clock.seconds(key) if clock else None, verify)
        if len(after.encode()) > YamlSource.MOST_BYTES:
            raise ShotError(
                f"{self.path}: with this edit the file would be larger than "
                f"{YamlSource.MOST_BYTES // 1000} kB, which none may be; nothing was written. Give it fewer "
                "keys."
            )
        return after

    def _require_own(self, source: YamlSource, edit: ValueEdit) -> None:
        """Refuse an edit of a value that a setting replaces, or that another file gives in part."""
        name = path_text(edit.where)
        for setting in self.settings:
            given = setting.partition("=")[0].strip()
            if name == given or name.startswith(f"{given}.") or given.startswith(f"{name}."):
                raise ShotError(f"--set {setting}: it overrides {name} of the file. Start again without.")
        for depth, step in enumerate(edit.where):
            is_within = isinstance(step, int) or "keys" in edit.where[:depth]
            if is_within and source.get(*edit.where[:depth]) is None:
                place = source.place(edit.where[:depth])
                raise ShotError(
                    f"{place}: {path_text(edit.where[:depth])} comes from a file that this shot extends. "
                    "Edit it there, or write it here."
                )

    def state_of(self, text: str) -> dict[str, Any]:
        """Return the state of a text. Raises ShotError where it is not a valid shot."""
        read_shot(self.path, text, self.settings, allow_code=self.allow_code)
        clock, values, flow_frames, _ = settable_values(self.path, text, self.settings)
        return {
            "digest": digest_of(text),
            "shot": self.path.stem,
            "first": clock.frames.first,
            "last": clock.frames.last,
            "fps": float(clock.rate.fps),
            "values": [_plain({**asdict(each), **value_title(each.where)._asdict()}) for each in values],
            "flow_frames": [{"where": where, "frames": frames} for where, frames in flow_frames.items()],
            **self._can(),
        }

    def _can(self) -> dict[str, bool]:
        return {"can_undo": bool(self._done), "can_redo": bool(self._undone)}

    def text(self) -> str:
        """Return the text of the file, a valid shot. Raises ShotError and MissingInputError for another."""
        text = YamlSource.read_text(self.path)
        read_shot(self.path, text, self.settings, allow_code=self.allow_code)
        return text

    def _current(self, digest: str) -> str:
        text = YamlSource.read_text(self.path)
        self._forget_others(text)
        if digest_of(text) != digest:
            raise self._stale()
        return text

    def _stale(self) -> StaleError:
        return StaleError(
            f"{self.path}: the file has changed in the meantime; nothing was written. Edit the new file, "
            "which has been read."
        )

    def _forget_others(self, text: str) -> None:
        """Forget all steps where the file was changed by others, whose edits they would undo."""
        known = self._done[-1].after if self._done else self._undone[-1].before if self._undone else text
        if known != text:
            self._done.clear()
            self._undone.clear()

    def _note(self, step: Step) -> None:
        last = self._done[-1] if self._done else None
        if step.gesture and last is not None and last.gesture == step.gesture and not self._undone:
            self._done[-1] = Step(last.before, step.after, step.gesture)
        else:
            self._done.append(step)
        del self._done[:-MOST_STEPS]
        self._undone.clear()

    def _move(self, digest: str, taken: list[Step], given: list[Step], verb: str) -> dict[str, Any]:
        with self._lock:
            before = self._current(digest)
            if not taken:
                raise UsageError(f"{self.path}: there is nothing to {verb}")
            step = taken[-1]
            text = step.before if verb == "undo" else step.after
            state = self.state_of(text)
            self._write(text, before)
            given.append(taken.pop())
            return {**state, **self._can()}

    def _write(self, text: str, before: str) -> None:
        """Replace the file, or the file that a link leads to.

        before  the text that it has, unless a text editor has saved it while the edit was validated

        Raises StaleError and MachineError; the file is then as it was.
        """
        target = self.path.resolve()

        def is_same(path: Path) -> bool:
            with suppress(FlowsculptError):  # an editor is about to save it
                return YamlSource.read_text(path) == before
            return False

        try:
            newline = "\r\n" if b"\r\n" in InputFile(target).content() else "\n"
            with atomic_write(target, is_same=is_same) as draft:
                draft.write_text(text, encoding="utf-8", newline=newline)
                with suppress(FileNotFoundError):
                    shutil.copymode(target, draft)
        except (ChangedFileError, MissingInputError):
            raise self._stale() from None


def digest_of(text: str) -> str:
    """Return the SHA-256 of a text, in hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()


def json_object(body: bytes) -> dict[str, Any]:
    """Return the JSON object of a request. Raises UsageError for anything else, such as NaN or a long one."""
    if len(body) > MOST_REQUEST_BYTES:
        raise UsageError(f"a request has at most {MOST_REQUEST_BYTES} bytes; divide it into several")
    try:
        asked = json.loads(body, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        asked = None
    if not isinstance(asked, dict):
        raise UsageError("a request is a JSON object")
    return asked


def _refuse_constant(word: str) -> Any:
    """Refuse NaN and infinite numbers, which Python's JSON would read."""
    raise ValueError(word)


def edits_in(items: Any) -> list[ValueEdit]:
    """Return the edits that a request lists, as `{"kind": "set", "where": [...], "value": ...}`.

    Raises UsageError where they have another form.
    """
    if not isinstance(items, list) or not 0 < len(items) <= MOST_EDITS:
        raise UsageError(f"edits must be a list of 1 to {MOST_EDITS}")
    return [_edit_in(item) for item in items]


def _edit_in(item: Any) -> ValueEdit:
    if not isinstance(item, dict) or not {"kind", "where"} <= item.keys() <= {"kind", "where", "value"}:
        raise UsageError("an edit has kind, where and value")
    kind, where, value = item["kind"], item["where"], item.get("value")
    if kind not in ("set", "remove", "rename"):
        raise UsageError("the kind of an edit is set, remove or rename")
    if kind == "rename" and not _is_step(value):
        raise UsageError(PATH_FORM)
    return ValueEdit(kind, where_in(where), value if kind == "rename" else with_times(value))


def where_in(steps: Any) -> Where:
    """Return the path that a request gives. Raises UsageError where it has another form."""
    if not isinstance(steps, list) or not 0 < len(steps) <= DEEPEST_PATH or not all(map(_is_step, steps)):
        raise UsageError(PATH_FORM)
    return tuple(steps)


def _is_step(step: Any) -> bool:
    return isinstance(step, str | int | float) and not isinstance(step, bool)


def _plain(value: Any) -> Any:
    """Return data that JSON can say: infinite bounds are null."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and abs(value) == float("inf"):
        return None
    return value
