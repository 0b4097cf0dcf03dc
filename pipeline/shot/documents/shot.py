"""The layout of shot files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from pipeline.frames import FASTEST, SLOWEST
from pipeline.shot.documents.camera import CameraDocument
from pipeline.shot.documents.curves import NumberField
from pipeline.shot.documents.fields import Count, Document, Positive, SchemaKeywords, one_of
from pipeline.shot.documents.flows import FlowDocument
from pipeline.shot.documents.lights_and_stage import LightsDocument, StageDocument
from pipeline.shot.documents.look import LookDocument
from pipeline.shot.documents.picture import AovsField, ShutterDocument, SmoothDocument, ViewDocument
from pipeline.shot.documents.resampling import ResampleDocument
from pipeline.shot.documents.subject import SubjectDocument
from render.scene.lights import LIGHTS
from render.scene.materials import LOOKS
from render.scene.quality import BATCH_SAMPLES, MOST_TEMPORAL_FRAMES
from render.scene.stage import STAGES


def _named_or_spelt_out(value: Any) -> str:
    return "spelt out" if isinstance(value, dict) else "by name"


Resample = Annotated[
    Annotated[Literal["off"], Tag("by name")] | Annotated[ResampleDocument, Tag("spelt out")],
    Discriminator(_named_or_spelt_out),
]


def _check_samples(samples: int) -> int:
    if samples > BATCH_SAMPLES and samples % BATCH_SAMPLES:
        raise PydanticCustomError(
            "passes",
            "{samples} samples do not divide into batches of {size}. Write up to {size}, or a multiple of "
            "it.",
            {"samples": samples, "size": BATCH_SAMPLES},
        )
    return samples


Samples = Annotated[
    int,
    Field(ge=1, le=65536),
    AfterValidator(_check_samples),
    SchemaKeywords(anyOf=[{"maximum": BATCH_SAMPLES}, {"multipleOf": BATCH_SAMPLES}]),
]


class QualityDocument(Document):
    """Settings of one quality that this shot replaces."""

    renamed: ClassVar[Mapping[str, str]] = {"guides": "auxiliary_samples", "steady": "temporal_denoise"}

    samples: Samples | None = Field(
        default=None, description="of light, for each pixel: up to 16, or a multiple of it"
    )
    auxiliary_samples: Samples | None = Field(
        default=None, description="of albedo, normal and depth, which guide the denoiser, for each pixel"
    )
    depth: Annotated[int, Field(ge=2, le=100)] | None = Field(
        default=None, description="longest path of light, in vertices"
    )
    denoise: Literal["off", "fast", "balanced", "high"] | None = Field(
        default=None, description="effort of the denoiser"
    )
    temporal_denoise: Annotated[int, Field(ge=0, le=MOST_TEMPORAL_FRAMES)] | None = Field(
        default=None,
        description="frames before and after that the temporal denoiser reads; 0 is off (frames)",
    )
    noise_threshold: Annotated[float, Field(gt=0, le=1)] | None = Field(
        default=None, description="noise at which a picture needs no more samples, such as 0.03"
    )


class QualitiesDocument(Document):
    preview: QualityDocument = Field(
        default=QualityDocument(), description="480×270, for looks while working"
    )
    draft: QualityDocument = Field(default=QualityDocument(), description="480×270, one bounce more")
    daily: QualityDocument = Field(default=QualityDocument(), description="960×540, for review")
    final: QualityDocument = Field(default=QualityDocument(), description="1920×1080, for delivery")


Frames = Annotated[str, SchemaKeywords(pattern=r"^\s*-?\d+(--?\d+)?(,-?\d+(--?\d+)?)*\s*$")]
"""A range without gaps, which `clock.parse_frames` checks."""

Rate = Annotated[
    Any,
    SchemaKeywords(
        anyOf=[
            {"type": "number", "minimum": float(SLOWEST), "maximum": float(FASTEST)},
            {"type": "string", "pattern": r"^\s*\+?\d+(\.\d*)?(/\d+)?\s*$"},
        ]
    ),
]


class ShotDocument(Document):
    renamed: ClassVar[Mapping[str, str]] = {"stride": "max_step"}

    title: str = Field(description="the name of the shot")
    extends: str | None = Field(
        None, description="the shot beside this file from which it inherits what it leaves out"
    )
    intent: str = Field("", description="what the shot should show, in a sentence")
    frames: Frames = Field(
        description="the first and the last, as in 1-96; the first shows the subject at rest"
    )
    rate: Rate = Field(24, description="24, 23.976 or 24000/1001 (frames per second)")
    subject: SubjectDocument = Field(
        description="what flows: a solid by name, a model from a file, a cloud or a net"
    )
    resample: Resample = Field(
        "off",
        validate_default=False,
        description="thresholds of the surface's edges while it flows; off for comparisons",
    )
    flows: list[FlowDocument] = Field(
        default_factory=list, description="what moves the subject, one after another within each frame"
    )
    substeps: Count | None = Field(
        None, description="steps that a frame is cut into; by default as many as the flow needs"
    )
    integrator: Annotated[str, one_of(("rk4", "adaptive"), "integrator")] = Field(
        "rk4", description="of velocity fields: rk4, or adaptive for fields that are steep somewhere"
    )
    tolerance: Positive | None = Field(
        None, description="error of a sub-step of the adaptive integrator, at most (units)"
    )
    max_step: Positive | None = Field(
        None, description="longest move of a vertex in a sub-step (maximum edges)"
    )
    speed: NumberField = Field(
        1.0, description="rate of the flow's time: 1 as it is, 0 stands still, below 0 backwards"
    )
    look: Annotated[
        Annotated[str, one_of(LOOKS, "look"), Tag("by name")] | Annotated[LookDocument, Tag("spelt out")],
        Discriminator(_named_or_spelt_out),
    ] = Field("clay", description="the material, by name or spelt out")
    smooth: SmoothDocument = Field(default=SmoothDocument(), description="curved patches over the triangles")
    camera: CameraDocument = Field(
        default=CameraDocument(), description="the view of the subject; framing finds distance and target"
    )
    lights: Annotated[
        Annotated[str, one_of(LIGHTS, "light rig"), Tag("by name")]
        | Annotated[LightsDocument, Tag("spelt out")],
        Discriminator(_named_or_spelt_out),
    ] = Field("studio", description="the light rig, by name or spelt out")
    stage: Annotated[
        Annotated[str, one_of(STAGES, "stage"), Tag("by name")] | Annotated[StageDocument, Tag("spelt out")],
        Discriminator(_named_or_spelt_out),
    ] = Field("cyclorama", description="the ground below the subject, by name or spelt out")
    shutter: ShutterDocument | None = Field(None, description="exposure of a frame in time: motion blur")
    aovs: AovsField = Field(
        default_factory=list, description="AOVs beside the beauty: names, or names with half or float"
    )
    view: ViewDocument = Field(
        default=ViewDocument(),
        description="colour view: a view of an OpenColorIO config; by default ACES 2.0",
    )
    quality: QualitiesDocument = Field(
        default=QualitiesDocument(), description="settings of qualities that this shot replaces"
    )
