"""The contracts of plug-ins for kinds of subjects, and for layouts of their copies."""

from abc import abstractmethod
from pathlib import Path
from typing import Self

from pydantic import PrivateAttr, ValidationInfo, model_validator

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.mesh import TriangleMesh, require
from flowsculpt.pipeline.shot.documents.field_types import Document
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext
from flowsculpt.render.base.input_files import joint_digest


class SubjectKind(Document):
    """A kind of subject of a plug-in: its settings, and the surface that they make."""

    _digests: list[str] = PrivateAttr()
    _surface: TriangleMesh = PrivateAttr()

    def files(self) -> tuple[str | Path, ...]:
        """Return the files that it reads, relative to the shot file: their contents decide frames too."""
        return ()

    @abstractmethod
    def surface(self, folder: Path) -> TriangleMesh:
        """Return the surface at rest: sound, closed or open; its creases and seams are kept.

        folder  of the shot file

        Raises UsageError, whose message is reported at the place of the settings.
        """

    @model_validator(mode="after")
    def _can_be_made(self, info: ValidationInfo) -> Self:
        context = ParseContext.of(info)
        self._digests = [context.digests[context.file(str(file))] for file in self.files()]
        self._surface = self.surface(context.folder)
        require(self._surface)
        return self

    def made(self, origin: tuple[str, str]) -> tuple[str, TriangleMesh]:
        """Return a digest of all that decides the surface, `origin` included, and the surface."""
        settings = self.model_dump_json(exclude_defaults=True)
        return joint_digest([*origin, settings, *self._digests]), self._surface


class CopyLayout(Document):
    """A layout of copies of a plug-in: its settings, and the places that they make."""

    def digests(self) -> tuple[str, ...]:
        """Return the digests of the files that it has read: they decide frames too."""
        return ()

    @abstractmethod
    def places(self, count: int, seed: int) -> tuple[Points, Floats]:
        """Return places (count, 3), and the rotation (count, 3, 3) of each: x is ahead or outwards, y up.

        Raises UsageError, whose message is reported at the place of the copies.
        """
