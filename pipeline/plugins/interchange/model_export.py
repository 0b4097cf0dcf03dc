"""Export frames of a shot as mesh files: sequences of PLY and OBJ, stills of GLB and STL.

renders/<shot>/models/<shot>.0001.ply         a frame
renders/<shot>/models/<shot>.ply.keys.json    what each was made from
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pipeline.errors import FrameError, MeshError, UsageError
from pipeline.mesh.write import write_mesh
from pipeline.plugins.interchange.exported_frame import ExportedFrame, frame_key, stored_frame
from pipeline.plugins.interchange.keyed_files import KeyedFiles
from pipeline.plugins.interchange.mesh_files import write_glb, write_obj, write_ply
from pipeline.plugins.interchange.print_model import LONGEST_SIDE, PrintReport, print_model
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Key, Store, key_of
from render.base.serialise import to_plain

SEQUENCES = ("ply", "obj")
"""Formats that can hold a range of frames."""

STILLS = ("glb", "stl")
"""Formats that hold one frame."""

MODELS = (*SEQUENCES, *STILLS)


def require_still(form: str, frames: str | None, count: int) -> None:
    """Raise UsageError where a form that holds a still is asked for so many frames."""
    if form in STILLS and count != 1:
        asked = f"-f {frames} is {count} frames" if frames else "no frame is chosen"
        raise UsageError(
            f"{asked}, and {form.upper()} holds one; choose it with -f, as in -f 12. usd, ply and obj take a "
            "range"
        )


@dataclass(frozen=True, eq=False)
class ModelExport:
    """Frames of a shot as files of one form. Files that are current are kept.

    folder   of the files, absolute
    form     one of MODELS
    longest  millimetres of the longest side of a model to be printed
    """

    request: RenderRequest
    store: Store
    folder: Path
    form: str
    longest: float = LONGEST_SIDE

    @cached_property
    def files(self) -> KeyedFiles:
        """The files of the folder."""
        return KeyedFiles(self.folder, f"{self._name}.{self.form}.keys.json", self.store)

    @property
    def _name(self) -> str:
        """The name of the shot in files, with that of its subject if it has several."""
        return self.request.motion_folders.part_name

    @property
    def path(self) -> Path:
        """The path of the file, or the folder of several."""
        numbers = self.request.requested
        return self.folder / self._file(numbers[0]) if len(numbers) == 1 else self.folder

    def stale(self) -> list[int]:
        """Return the frames whose files are missing, damaged, or of an earlier shot."""
        return [n for n in sorted(self.request.requested) if not self._is_current(n)]

    def shown(self) -> list[int]:
        """Return the frames whose files are current, in ascending order."""
        return [n for n in sorted(self.request.requested) if self._is_current(n)]

    def write(self, passed: Callable[[], None]) -> list[str]:
        """Write the files that are not current, and return messages of failed frames.

        passed  is called after each file

        Raises MachineError where the disk refuses, MeshError for a model that cannot be printed, or has no
        surface that GLB could hold.
        """
        faults = []
        with self.files.noting():
            for number in self.stale():
                try:
                    frame = stored_frame(self.request, self.store, number)
                    self.files.write(self._file(number), self._key(number), self._writer(number, frame))
                except FrameError as error:
                    faults.append(f"{self._name} {error.of(number)}")
                passed()
        return faults

    def print_report(self) -> PrintReport | None:
        """Return the measures of the model to be printed; None for other forms. Raises as `write`."""
        if self.form != "stl":
            return None
        (number,) = self.request.requested
        frame = stored_frame(self.request, self.store, number)
        return PrintReport.of(print_model(frame, self.longest, f"{self._name} frame {number}"))

    def _writer(self, number: int, frame: ExportedFrame) -> Callable[[Path], object]:
        """Return the function that writes a frame to a path. Raises MeshError for a frame of no such form."""
        name, look = f"{self._name} frame {number}", self.request.shot.picture.look
        if self.form == "stl":
            model = print_model(frame, self.longest, name)
            return lambda path: write_mesh(model, path)
        if not len(frame.faces) and self.form != "ply":
            raise MeshError(f"{name}: a point cloud has no surface for {self.form}; export it as ply or usd")
        writers: Mapping[str, Callable[[Path], object]] = {
            "ply": lambda path: write_ply(path, frame),
            "obj": lambda path: write_obj(path, frame),
            "glb": lambda path: write_glb(path, frame, look),
        }
        return writers[self.form]

    def _is_current(self, number: int) -> bool:
        return self.files.is_current(self._file(number), self._key(number))

    def _key(self, number: int) -> Key:
        more = {"stl": self.longest, "glb": to_plain(self.request.shot.picture.look)}.get(self.form)
        return key_of(frame_key(self.request, number), self.form, more)

    def _file(self, number: int) -> str:
        return f"{self._name}.{number:04d}.{self.form}"
