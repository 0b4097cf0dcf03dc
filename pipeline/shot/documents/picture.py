"""The entries `smooth`, `shutter`, `aovs` and `view` of a shot file."""

import hashlib
import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationInfo,
    model_validator,
)

from pipeline.errors import UsageError
from pipeline.flow.parameters import number_at
from pipeline.mesh.pn_triangles import MOST_PIECES
from pipeline.shot.camera import Shutter
from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import NumberField, number, sampled_frames
from pipeline.shot.documents.fields import DEGREE, ByForm, Document, SchemaKeywords, one_of, optional
from pipeline.shot.yaml.validation import ParseContext, as_finding, bad_curve, bad_value, finding
from render.post.view import ACES, BUILT_IN, ColourView, view_of
from render.scene.aovs import AOVS

_PIXELS = r"^\s*(\d+\.?\d*|\.\d+)\s*px\s*$"

_TABLE = re.compile(r"\bsrc\s*:\s*([^,}\n]+)")
"""An OpenColorIO config's reference to a table file."""


def _pixels(value: Any) -> Any:
    """Parse `2px` as 2.0."""
    if not isinstance(value, str):
        return value
    match = re.match(_PIXELS, value)
    if not match:
        raise bad_value(f"{value!r} is no length in pixels. Write 2px.")
    return float(match[1])


Pixels = Annotated[
    float,
    BeforeValidator(_pixels),
    Field(ge=0.25, le=1000),
    SchemaKeywords(type=["number", "string"], pattern=_PIXELS),
]


class SmoothDocument(Document):
    """Segments of each edge, by their number or by their length in the picture."""

    tessellate: Annotated[int, Field(ge=1, le=MOST_PIECES)] | None = optional(
        "segments that each edge is cut into; 1 is off"
    )
    dicing: Pixels | None = optional("longest segment of an edge in the picture, such as 2px (pixels)")

    @model_validator(mode="after")
    def _has_one(self) -> Self:
        if self.tessellate is not None and self.dicing is not None:
            raise finding(
                "smooth has both tessellate, a number of segments, and dicing, their length in the picture; "
                "one of them can act. Remove the other."
            )
        return self


def _degrees(low: float, high: float, usual: str) -> AfterValidator:
    """Return a validator: degrees that stay within bounds at every half frame of the shot."""
    rule = f"it must stay from {low:g} to {high:g} degrees. Write {usual}."

    def check(value: Any, info: ValidationInfo) -> Any:
        clock: Clock | None = (info.context or {}).get("clock")
        if clock is None:
            return value
        try:
            curve = number(value, clock)
            for frame in sampled_frames(clock):
                if not low <= (degrees := number_at(curve, clock.time(frame))) <= high:
                    fault = f"is {degrees:.4g} at frame {frame:g}; {rule}"
                    raise bad_curve(fault)
        except (UsageError, AssertionError):  # other checks report these
            return value
        return value

    return AfterValidator(check)


class ShutterDocument(Document):
    angle: Annotated[NumberField, _degrees(0.0, 360.0, "180, which film cameras have")] = Field(
        default=180.0, description="opening of the shutter; 360 is a whole frame, 0 no blur (degrees)"
    )
    phase: Annotated[NumberField, _degrees(-360.0, 0.0, "-90")] | None = optional(
        "when it opens, before the frame; by default half the angle (degrees)"
    )

    def build(self, clock: Clock) -> Shutter:
        phase = None if self.phase is None else number(self.phase, clock, DEGREE)
        return Shutter(number(self.angle, clock, DEGREE), phase)


AovName = Annotated[str, one_of(AOVS, "AOV")]
Precision = Literal["half", "float"]

AovsField = Annotated[
    dict[AovName, Precision] | list[AovName], ByForm(lambda value: not isinstance(value, dict))
]
"""`[velocity, noise]`, or `{velocity: half, position: half}`."""


class ViewDocument(Document):
    """A view of an OpenColorIO config; what is left out is the config's default."""

    config: str = Field(
        default=ACES.config,
        description="of OpenColorIO: ocio://default, another built-in config, or a file beside the shot file",
    )
    view: str | None = optional("a view of the config by its name there")
    display: str | None = optional(
        "a display of the config; by default Rec.709 for movies and sRGB for pictures"
    )
    space: str | None = optional("the config's name of linear Rec.709, if it is an unusual one")

    _view: ColourView = ACES

    @model_validator(mode="after")
    def _is_there(self, info: ValidationInfo) -> Self:
        if not self.model_fields_set:  # the default needs no OpenColorIO, which takes time to import
            return self
        config, digest = self._locate(ParseContext.of(info))
        self._view = as_finding(lambda: view_of(config, self.view, self.display, self.space, digest))
        return self

    def build(self) -> ColourView:
        return self._view

    def _locate(self, context: ParseContext) -> tuple[str, str]:
        """Return the config's path or built-in name, and a digest of all files that its colours depend on."""
        if self.config.startswith(BUILT_IN):
            return self.config, ""
        path = context.file(self.config)
        files = [path, *_tables(path)]
        for table in files[1:]:
            context.file(str(table.relative_to(context.folder)))
        digests = [context.digests[file] for file in files]
        return str(path), hashlib.sha256("".join(digests).encode()).hexdigest()


def _tables(config: Path) -> list[Path]:
    """Return the files beside a config, or below, whose names it mentions as tables."""
    if config.suffix != ".ocio":
        return []
    text = config.read_text(encoding="utf-8", errors="replace")
    names = {Path(name.strip().strip("'\"")).name for name in _TABLE.findall(text)}
    return sorted(file for name in names if name for file in config.parent.rglob(name) if file.is_file())
