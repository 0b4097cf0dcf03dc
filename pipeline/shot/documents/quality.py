"""The layout of the settings of qualities."""

import dataclasses
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from pipeline.shot.documents.fields import (
    ByForm,
    Document,
    SchemaKeywords,
    is_written_number,
    one_of,
    optional,
)
from pipeline.shot.yaml.validation import bad_value
from render.scene.quality import BATCH_SAMPLES, MOST_TEMPORAL_FRAMES, Quality


def _check_samples(samples: int) -> int:
    if samples > BATCH_SAMPLES and samples % BATCH_SAMPLES:
        raise bad_value(
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

    def build(self, quality: Quality) -> Quality:
        """Return a quality with these settings."""
        settings = self.model_dump(exclude_none=True)
        if self.noise_threshold == "off":
            settings["noise_threshold"] = None
        return dataclasses.replace(quality, **settings)


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
