"""The subjects `lettering.text` and `lettering.svg`: their settings in shot files."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from flowsculpt import TriangleMesh, UsageError
from flowsculpt.api import SubjectKind
from flowsculpt.api.files import InputFile
from flowsculpt.api.shots import Positive

if TYPE_CHECKING:  # the libraries of outlines take time to import, and most shots have none
    from flowsculpt.pipeline.plugins.lettering.outline_process import Outlines

Index = Annotated[int, Field(ge=1)]


class OutlineKind(SubjectKind):
    """Base of the solids of outlines."""

    bare: ClassVar[str]
    """The setting that is meant where the file has a text alone."""

    depth: Positive = Field(0.25, description="from front to back, with its middle at the origin (units)")
    bevel: Annotated[float, Field(ge=0, le=1e12)] = Field(
        0.02, description="width of the bevels in front and behind; 0 for none (units)"
    )
    profile: Literal["round", "flat"] = Field("round", description="a quarter of a circle, or a chamfer")
    steps: Annotated[int, Field(ge=1, le=32)] = Field(4, description="pieces of a round bevel")
    tolerance: Positive = Field(0.001, description="greatest distance from curves of the outline (units)")

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        if isinstance(value, int | float):
            raise ValueError(f"{value} is a number, and text is in quotes. Write '{value}'.")
        return {cls.bare: value} if isinstance(value, str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"type": "string"}]}

    @abstractmethod
    def outlines(self, folder: Path) -> Outlines:
        """Return what is extruded. Raises UsageError where no such font is installed."""

    def surface(self, folder: Path) -> TriangleMesh:
        if 2.0 * self.bevel >= self.depth:
            raise UsageError(
                f"two bevels of {self.bevel:g} leave nothing of a depth of {self.depth:g}. "
                f"Write bevel: {0.1 * self.depth:.2g}, or raise depth."
            )
        from flowsculpt.pipeline.plugins.lettering.extrusion import Section

        profile = Section(float(self.depth), float(self.bevel), self.profile, self.steps)
        return self.outlines(folder).solid(profile)


class TextKind(OutlineKind):
    """Letters, extruded and bevelled, a part each."""

    bare = "text"

    text: Annotated[str, Field(min_length=1, max_length=1000)] = Field(
        description="the characters; \\n begins a line"
    )
    letter: Index | None = Field(
        None, description="the letter to keep, from 1, where it is in the text; spaces do not count"
    )
    font: str = Field(
        "", description="a TTF or OTF beside the shot file, or a family, as Inter:bold; else DejaVu Sans Bold"
    )
    face: Annotated[int, Field(ge=0)] = Field(0, description="number of the face in a collection of fonts")
    axes: dict[str, float] = Field(default_factory=dict, description="of a variable font, as {wght: 700}")
    size: Positive = Field(1.0, description="of the font: capitals are about 0.7 of it (units)")
    tracking: Annotated[float, Field(ge=-1, le=100)] = Field(
        0.0, description="added between letters (times the size)"
    )
    kerning: Literal["on", "off"] = Field("on", description="the font's own distances for pairs of letters")
    align: Literal["left", "centre", "right"] = Field("centre", description="what of each line is at x = 0")
    leading: Annotated[float, Field(gt=0, le=100)] = Field(
        1.2, description="from line to line (times the size)"
    )

    def files(self) -> tuple[str | Path, ...]:
        """Return the font, except for the default one: every installation has it in a place of its own."""
        from flowsculpt.pipeline.plugins.lettering.fonts import font_file

        return (font_file(self.font),) if self.font else ()

    @model_validator(mode="after")
    def _count_font(self) -> Self:
        if not self.font:
            from flowsculpt.pipeline.plugins.lettering.fonts import font_file

            self._digests.append(InputFile(Path(font_file(self.font))).digest())
        elif face := self._face:
            self._digests.append(f"face {face}")
        return self

    @property
    def _face(self) -> int:
        """The number of the face of an installed family, where none is set."""
        from flowsculpt.pipeline.plugins.lettering.fonts import face_of_family

        return 0 if self.face else face_of_family(self.font)

    def outlines(self, folder: Path) -> Outlines:
        from flowsculpt.pipeline.plugins.lettering.fonts import font_file
        from flowsculpt.pipeline.plugins.lettering.outline_process import Outlines

        settings = {
            "text": self.text,
            "face": self.face or self._face,
            "axes": [(tag, float(value)) for tag, value in self.axes.items()],
            "size": float(self.size),
            "tracking": float(self.tracking),
            "kerning": self.kerning == "on",
            "align": self.align,
            "leading": float(self.leading),
            "tolerance": float(self.tolerance),
        }
        return Outlines(folder / font_file(self.font), settings, "letter", self.letter)


class StartKind(TextKind):
    """Start shapes of letters: drops, and rings with as many holes, of the same volume and place."""

    def surface(self, folder: Path) -> TriangleMesh:
        return self.outlines(folder).start(float(self.depth))


class SvgKind(OutlineKind):
    """The filled and stroked paths of a drawing, extruded and bevelled."""

    bare = "file"

    file: str = Field(description="an SVG or SVGZ beside the shot file")
    path: Index | None = Field(None, description="the path to keep, from 1, where it is in the drawing")
    size: Positive = Field(
        2.0, description="the largest extent of the drawing, with its middle at the origin (units)"
    )

    def files(self) -> tuple[str | Path, ...]:
        return (self.file,)

    def outlines(self, folder: Path) -> Outlines:
        from flowsculpt.pipeline.plugins.lettering.outline_process import Outlines

        settings = {"size": float(self.size), "tolerance": float(self.tolerance)}
        return Outlines(folder / self.file, settings, "path", self.path)
