"""The contracts of plug-ins for kinds of subjects, and for layouts of their copies."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, model_validator

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.mesh import TriangleMesh, validate
from flowsculpt.pipeline.plugin_contracts import ContractError
from flowsculpt.pipeline.shot.animated_models import AnimatedModel, SurfaceSequence
from flowsculpt.pipeline.shot.documents.field_types import (
    DEGREE,
    ORIGIN,
    Degrees,
    Document,
    Positive,
    is_number,
    optional,
)
from flowsculpt.pipeline.shot.motion import Clock
from flowsculpt.pipeline.shot.subjects import Subject
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext
from flowsculpt.pipeline.shot.yaml.yaml_source import Where
from flowsculpt.render.base.foreign_code import ForeignError, foreign_code
from flowsculpt.render.base.input_files import joint_digest
from flowsculpt.render.base.render_errors import quote


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
        files = self.files()
        if isinstance(files, str):
            raise ValueError(f"{type(self).__name__}.files returned text; write return ({quote(files)},)")
        self._digests = [context.digests[context.file(str(file))] for file in files]
        try:
            with foreign_code():
                self._surface = self.surface(context.folder)
        except ForeignError as error:
            raise ValueError(f"it cannot be made: {error}") from error
        if not isinstance(self._surface, TriangleMesh):
            returned = type(self._surface).__name__
            raise ValueError(f"its plug-in returned {returned} for the surface; it must be a TriangleMesh")
        validate(self._surface).require()
        return self

    def made(self, origin: tuple[str, str]) -> tuple[str, TriangleMesh]:
        """Return a digest of all that decides the surface, `origin` included, and the surface."""
        settings = self.model_dump_json(exclude_defaults=True)
        return joint_digest([*origin, settings, *self._digests]), self._surface


def _require_angles(value: Any) -> Any:
    if is_number(value):
        raise ValueError(
            f"{value} is one number; it must be three, about x, then y, then z. Write [0, {value}, 0]."
        )
    return value


class SizedDocument(Document):
    """Size and rotation of a surface that is as a file or a plug-in says."""

    scale: Positive = Field(1.0, description="factor on all coordinates; or use fit")
    fit: Positive | None = optional("its largest extent, centred on the origin (units)")
    rotate: Annotated[list[Degrees], BeforeValidator(_require_angles), Field(min_length=3, max_length=3)] = (
        Field(ORIGIN, description="about x, then y, then z (degrees)")
    )

    def placing(self) -> dict[str, Any]:
        """Return scale, fit and rotation as a `Model` takes them."""
        fit = None if self.fit is None else float(self.fit)
        x, y, z = (DEGREE * angle for angle in self.rotate)
        return {"scale": float(self.scale), "fit": fit, "rotate": (x, y, z)}


class NamedKind(Document):
    """A kind of subject of a plug-in whose settings stand in the subject itself.

    The first of them has the name by which shots know the kind. Where the plug-in is not one of ours, the
    alias of that field begins with the name of the plug-in and a point.

    not_copied  message about `copies`; empty if there may be any
    """

    not_copied: ClassVar[str] = ""

    @classmethod
    def word(cls) -> str:
        """Return the name by which shots know it."""
        name, first = next(iter(cls.model_fields.items()))
        return first.alias or name

    @classmethod
    def require_word_of(cls, plugin: str) -> None:
        """Raise ContractError where its word does not begin with the name of its plug-in."""
        if not cls.word().startswith(f"{plugin}."):
            raise ContractError(f'{cls.__name__}: the alias of its first field must begin with "{plugin}."')

    @classmethod
    def faults(cls, given: Mapping[str, Any], folder: Path) -> Iterator[tuple[Where, str]]:
        """Yield what is wrong beyond the form of single values: its place in the subject, and a message.

        given   the subject as the shot file has it; its values may be of any type
        folder  of the shot file
        """
        yield from ()


class PointsKind(NamedKind):
    """A kind of subject of a plug-in that is points, which move one by one and are not resampled.

    Its settings stand in the subject itself, `{cloud: a.ply, radius: 0.1}`; a text in the first names a file.

    is_net         True if the points control a smooth surface; False if they are drawn as spheres
    not_resampled  fact that begins the message about `resample`
    """

    is_net: ClassVar[bool] = False
    not_resampled: ClassVar[str] = "points have no edges"

    @abstractmethod
    def build(self, folder: Path) -> Subject:
        """Return the subject.

        folder  of the shot file

        Raises MeshError or UsageError where it cannot be made.
        """


class MovingKind(NamedKind, SizedDocument):
    """A kind of subject of a plug-in whose surface at every time is given, `{sequence: "a_####.ply"}`."""

    up: Literal["y", "z"] | None = optional("the axis of the files that points up: what they state, else y")
    repair: Literal["on", "off"] = Field(
        "on", description="mends faults such as third faces on an edge; off refuses them"
    )
    paint: Literal["on", "off"] = Field(
        "off", description="keeps texture coordinates, vertex colours and materials for the look to show"
    )

    @classmethod
    def word(cls) -> str:
        own = (item for item in cls.model_fields.items() if item[0] not in MovingKind.model_fields)
        name, first = next(own)
        return first.alias or name

    @abstractmethod
    def surfaces(self, folder: Path, clock: Clock) -> SurfaceSequence:
        """Return what reads the surface of every frame.

        folder  of the shot file
        clock   of the shot, by which it finds what its frames show

        Raises MeshError, MissingInputError or UsageError where it cannot be made: its message is reported at
        the place of the kind's name.
        """

    def build(self, folder: Path, clock: Clock) -> AnimatedModel:
        """Return the subject. Raises what `surfaces` raises."""
        sequence = self.surfaces(folder, clock)
        repair = self.repair == "on"
        return AnimatedModel.of(sequence, self.up, self.paint == "on", repair=repair, **self.placing())


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
