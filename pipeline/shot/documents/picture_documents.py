"""The entries `picture`, `quality`, `overrides` and `view`: shape, cost and colours of pictures."""

import hashlib
import math
import re
from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_validator

from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.shot.documents.field_types import (
    MAPPING_IS_SECOND,
    ByForm,
    Document,
    SchemaKeywords,
    is_number,
    is_written_number,
    one_of,
    optional,
)
from flowsculpt.pipeline.shot.documents.light_documents import LightsDocument, require_rig
from flowsculpt.pipeline.shot.documents.look_documents import LookField, look_of
from flowsculpt.pipeline.shot.shot import FrameOverride
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext, finding
from flowsculpt.pipeline.shot.yaml.yaml_source import in_yaml
from flowsculpt.render.post.config_tables import tables
from flowsculpt.render.post.view import ACES, BUILT_IN, ColourView, view_of
from flowsculpt.render.scene.render_quality import (
    BATCH_SAMPLES,
    MOST_TEMPORAL_FRAMES,
    QUALITIES,
    even,
    final_size,
)
from flowsculpt.render.scene.scene_lights import LIGHTS, LightRig

NARROWEST, WIDEST = 0.2, 5.0
"""Limits of an aspect: automatic framing and the stages are made for these."""

SMALLEST, LARGEST = 64, 16384
"""Limits of a side of `final`, pixels: H.264 and H.265 go no further."""

_RATIO = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(?:[:/]\s*(\d+(?:\.\d*)?|\.\d+)\s*)?")
_PIXELS = re.compile(r"\s*(\d+)\s*[x×*]\s*(\d+)\s*")


def _aspect(value: Any) -> Any:
    """Parse `9:16`, `9/16` or a number as width over height; refuse others, with the one that is meant."""
    ratio = value
    if isinstance(value, str) and (match := _RATIO.fullmatch(value)):
        width, height = float(match[1]), float(match[2] or 1.0)
        ratio = width / height if height else math.inf
    if is_number(ratio) and NARROWEST <= ratio <= WIDEST:
        return float(ratio)
    remedy, sides = 'Write "9:16", "1:1" or 2.39.', re.findall(r"\d+", in_yaml(value))
    if not is_number(ratio) and len(sides) == 2:
        width, height = map(int, sides)
        are_pixels = min(width, height) >= SMALLEST
        remedy = f"Write size: [{width}, {height}]." if are_pixels else f'Write "{width}:{height}".'
    raise ValueError(f"{in_yaml(value)} is not an aspect, width to height from 1:5 to 5:1. {remedy}")


def _size(value: Any) -> Any:
    """Return an even width and height; refuse others, with the size that is meant."""
    match = _PIXELS.fullmatch(value) if isinstance(value, str) else None
    sides = list(map(int, match.groups())) if match else value
    is_pair = isinstance(sides, list) and len(sides) == 2 and all(map(is_number, sides))
    fits = is_pair and all(SMALLEST <= side <= LARGEST for side in sides)
    fits = fits and NARROWEST <= sides[0] / sides[1] <= WIDEST
    meant = list(map(even, sides)) if fits else [1080, 1920]
    if not fits or meant != value:
        rule = f"even width and height in pixels, {SMALLEST} to {LARGEST} each, and 1:5 to 5:1"
        raise ValueError(f"{in_yaml(value)} is not a size: {rule}. Write {meant}.")
    return meant


Aspect = Annotated[
    Any,
    BeforeValidator(_aspect),
    SchemaKeywords(
        anyOf=[
            {"type": "number", "minimum": NARROWEST, "maximum": WIDEST},
            {"type": "string", "pattern": f"^{_RATIO.pattern}$"},
        ]
    ),
]
Side = Annotated[int, Field(ge=SMALLEST, le=LARGEST), SchemaKeywords(multipleOf=2)]
Size = Annotated[list[Side], BeforeValidator(_size), Field(min_length=2, max_length=2)]


class PictureShapeDocument(Document):
    """The shape of all pictures of a shot, or of an edit: an aspect, or the pixels of `final`."""

    example = '{aspect: "9:16"}'

    aspect: Aspect | None = optional(
        'width to height, such as "9:16" or 2.39; the shorter side stays 270, 540 or 1080 pixels'
    )
    size: Size | None = optional(
        "width and height in `final`, even numbers; `daily` has half of them, `draft` a quarter (pixels)"
    )

    @model_validator(mode="before")
    @classmethod
    def _is_a_mapping(cls, value: Any) -> Any:
        """Refuse a bare shape, with the name that it needs."""
        if isinstance(value, str | list) or is_number(value):
            is_ratio = is_number(value) or (isinstance(value, str) and _RATIO.fullmatch(value))
            pixels = list(map(int, re.findall(r"\d{2,}", in_yaml(value))))
            size = {"size": pixels} if len(pixels) == 2 else {"aspect": "9:16"}
            shape = {"aspect": value} if is_ratio else size
            raise finding(f"picture must be a mapping. Write picture: {in_yaml(shape)}.")
        return value

    @model_validator(mode="after")
    def _has_one(self) -> Self:
        if self.aspect is not None and self.size is not None:
            raise finding("picture has both aspect and size, and a size has an aspect. Remove one of them.")
        return self

    @property
    def final(self) -> tuple[int, int] | None:
        """Width and height of pictures of `final`, pixels; None for the usual ones."""
        if self.size is not None:
            width, height = self.size
            return width, height
        return None if self.aspect is None else final_size(self.aspect)


def _check_samples(samples: int) -> int:
    if samples > BATCH_SAMPLES and samples % BATCH_SAMPLES:
        raise ValueError(
            f"{samples} samples do not divide into batches of {BATCH_SAMPLES}. "
            f"Write up to {BATCH_SAMPLES}, or a multiple of it."
        )
    return samples


Samples = Annotated[
    int,
    Field(ge=1, le=65536),
    AfterValidator(_check_samples),
    SchemaKeywords(anyOf=[{"maximum": BATCH_SAMPLES}, {"multipleOf": BATCH_SAMPLES}]),
]


NoiseThreshold = Annotated[
    Annotated[float, Field(gt=0, le=1)] | Annotated[str, one_of(("off",), "noise threshold")],
    ByForm(lambda value: isinstance(value, str) and not is_written_number(value)),
]


class QualityDocument(Document):
    """Settings of one quality that this shot replaces."""

    example = "{samples: 64}"

    samples: Samples | None = optional("for each pixel: up to 16, or a multiple of it")
    auxiliary_samples: Samples | None = optional(
        "of albedo, normal and depth, which guide the denoiser, for each pixel"
    )
    depth: Annotated[int, Field(ge=2, le=100)] | None = optional("longest path of light, in vertices")
    fireflies: Literal["keep", "soft", "firm"] | None = optional(
        "single pixels far too bright: keep them, spread their light (soft), or remove it (firm)"
    )
    denoise: Literal["off", "fast", "balanced", "high"] | None = optional("effort of the denoiser")
    temporal_denoise: Annotated[int, Field(ge=0, le=MOST_TEMPORAL_FRAMES)] | None = optional(
        "frames before and after that the temporal denoiser reads; 0 is off (frames)"
    )
    noise_threshold: NoiseThreshold | None = optional(
        "noise at which a part of the picture needs no more samples, such as 0.04, or `off`"
    )

    def settings(self) -> dict[str, Any]:
        """Return the settings that are written, as `Quality` has them."""
        written = self.model_dump(exclude_none=True)
        return {**written, "noise_threshold": None} if self.noise_threshold == "off" else written


class QualitiesDocument(Document):
    example = "{final: {samples: 64}}"

    draft: QualityDocument = Field(
        default=QualityDocument.model_construct(), description="480×270, for looks while working"
    )
    daily: QualityDocument = Field(
        default=QualityDocument.model_construct(), description="960×540, for review"
    )
    final: QualityDocument = Field(
        default=QualityDocument.model_construct(), description="1920×1080, for delivery"
    )


LightsField = Annotated[
    Annotated[str, one_of(LIGHTS, "light rig")] | LightsDocument,
    MAPPING_IS_SECOND,
    BeforeValidator(require_rig),
]


def built_lights(lights: str | LightsDocument) -> LightRig:
    """Return the light rig of parsed lights."""
    return LIGHTS[lights] if isinstance(lights, str) else lights.build()


def _as_text(value: Any) -> Any:
    """Return a single frame as the range that it is."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


OverriddenFrames = Annotated[str, BeforeValidator(_as_text)]


class OverrideDocument(Document):
    """A look, lights and a quality of some frames, in place of the shot's; see `picture_checks`."""

    example = "{frames: 40-60, look: glaze}"

    frames: OverriddenFrames = Field(description="as in 40-60, or 12,40-60")
    look: LookField | None = optional("the material of these frames, in place of the shot's")
    lights: LightsField | None = optional("their light rig, in place of the shot's, with its exposure")
    quality: QualitiesDocument | None = optional(
        "settings that they replace: samples, auxiliary_samples, depth, fireflies, noise_threshold"
    )

    @model_validator(mode="after")
    def _has_one(self) -> Self:
        if self.look is None and self.lights is None and self.quality is None:
            raise finding(
                "an override changes nothing without look, lights or quality. Write one of them, or remove "
                "the override."
            )
        return self

    def build(self, grouped: Callable[[LightRig], LightRig]) -> FrameOverride:
        """Return the override; `grouped` gives lights the light groups of the shot."""
        written = {name: getattr(self.quality, name).settings() for name in QUALITIES if self.quality}
        return FrameOverride(
            frames=FrameRange.parse(self.frames),
            look=None if self.look is None else look_of(self.look),
            lights=None if self.lights is None else grouped(built_lights(self.lights)),
            qualities={name: settings for name, settings in written.items() if settings},
        )


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
        self._view = view_of(config, self.view, self.display, self.space, digest)
        return self

    def build(self) -> ColourView:
        return self._view

    def _locate(self, context: ParseContext) -> tuple[str, str]:
        """Return the config's path or built-in name, and a digest of all files that its colours depend on."""
        if self.config.startswith(BUILT_IN):
            return self.config, ""
        path = context.file(self.config)
        digests = [context.digests[path], *map(context.note, context.attempt(lambda: tables(path)))]
        return str(path), hashlib.sha256("".join(digests).encode()).hexdigest()
