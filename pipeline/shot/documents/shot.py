"""The layout of shot and film files: what may stand in them, of which kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from pipeline.frames import FASTEST, SLOWEST
from pipeline.shot.documents.camera import CameraDocument
from pipeline.shot.documents.curves import NumberField
from pipeline.shot.documents.fields import Count, Document, Positive, Told, one_of
from pipeline.shot.documents.flows import FlowDocument
from pipeline.shot.documents.lights_and_stage import LightsDocument, StageDocument
from pipeline.shot.documents.look import LookDocument
from pipeline.shot.documents.resampling import ResampleDocument, SmoothDocument
from pipeline.shot.documents.subject import CloudDocument, NetDocument, SolidDocument
from pipeline.shot.documents.views import ViewDocument
from pipeline.shot.shutter import LayersField, ShutterDocument
from render.scene.lights import LIGHTS
from render.scene.look import LOOKS
from render.scene.quality import MOST_TEMPORAL_FRAMES, PASS_SAMPLES
from render.scene.stage import STAGES


class ModelDocument(Document):
    model: str
    scale: Positive = 1.0


_SUBJECTS = {"model": "a model file", "cloud": "a cloud", "net": "a net"}


def _subject_form(value: Any) -> str:
    named = [form for name, form in _SUBJECTS.items() if isinstance(value, dict) and name in value]
    return named[0] if named else "a solid"


SubjectDocument = Annotated[
    Annotated[SolidDocument, Tag("a solid")]
    | Annotated[ModelDocument, Tag("a model file")]
    | Annotated[CloudDocument, Tag("a cloud")]
    | Annotated[NetDocument, Tag("a net")],
    Discriminator(_subject_form),
]


def _named_or_spelt_out(value: Any) -> str:
    return "spelt out" if isinstance(value, dict) else "by name"


Resample = Annotated[
    Annotated[Literal["off"], Tag("by name")] | Annotated[ResampleDocument, Tag("spelt out")],
    Discriminator(_named_or_spelt_out),
]


def _in_passes(samples: int) -> int:
    if samples > PASS_SAMPLES and samples % PASS_SAMPLES:
        raise PydanticCustomError(
            "passes",
            "{samples} samples do not divide into passes of {each}. Write up to {each}, or a multiple of it.",
            {"samples": samples, "each": PASS_SAMPLES},
        )
    return samples


Samples = Annotated[
    int,
    Field(ge=1, le=65536),
    AfterValidator(_in_passes),
    Told(anyOf=[{"maximum": PASS_SAMPLES}, {"multipleOf": PASS_SAMPLES}]),
]


class QualityDocument(Document):
    """Settings of one quality that this shot replaces."""

    renamed: ClassVar[Mapping[str, str]] = {"guides": "auxiliary_samples", "steady": "temporal_denoise"}

    samples: Samples | None = None
    auxiliary_samples: Samples | None = None
    depth: Annotated[int, Field(ge=2, le=100)] | None = None
    denoise: Literal["off", "fast", "balanced", "high"] | None = None
    temporal_denoise: Annotated[int, Field(ge=0, le=MOST_TEMPORAL_FRAMES)] | None = None
    noise_threshold: Annotated[float, Field(gt=0, le=1)] | None = None


class QualitiesDocument(Document):
    preview: QualityDocument = QualityDocument()
    draft: QualityDocument = QualityDocument()
    daily: QualityDocument = QualityDocument()
    final: QualityDocument = QualityDocument()


Frames = Annotated[str, Told(pattern=r"^\s*-?\d+(--?\d+)?(,-?\d+(--?\d+)?)*\s*$")]
"""Those of a shot have no gaps, as `checks` says."""

Rate = Annotated[
    Any,
    Told(
        anyOf=[
            {"type": "number", "minimum": float(SLOWEST), "maximum": float(FASTEST)},
            {"type": "string", "pattern": r"^\s*\+?\d+(\.\d*)?(/\d+)?\s*$"},
        ]
    ),
]


class ShotDocument(Document):
    renamed: ClassVar[Mapping[str, str]] = {"stride": "max_step"}

    title: str
    extends: str | None = None
    intent: str = ""
    frames: Frames
    rate: Rate = 24
    subject: SubjectDocument
    resample: Resample = Field("off", validate_default=False)
    flows: list[FlowDocument] = Field(default_factory=list)
    substeps: Count | None = None
    integrator: Annotated[str, one_of(("rk4", "adaptive"), "integrator")] = "rk4"
    tolerance: Positive | None = None
    max_step: Positive | None = None
    speed: NumberField = 1.0
    look: Annotated[
        Annotated[str, one_of(LOOKS, "look"), Tag("by name")] | Annotated[LookDocument, Tag("spelt out")],
        Discriminator(_named_or_spelt_out),
    ] = "clay"
    smooth: SmoothDocument = SmoothDocument()
    camera: CameraDocument = CameraDocument()
    lights: Annotated[
        Annotated[str, one_of(LIGHTS, "light rig"), Tag("by name")]
        | Annotated[LightsDocument, Tag("spelt out")],
        Discriminator(_named_or_spelt_out),
    ] = "studio"
    stage: Annotated[
        Annotated[str, one_of(STAGES, "stage"), Tag("by name")] | Annotated[StageDocument, Tag("spelt out")],
        Discriminator(_named_or_spelt_out),
    ] = "cyclorama"
    shutter: ShutterDocument | None = None
    aovs: LayersField = Field(default_factory=list)
    view: ViewDocument = ViewDocument()
    quality: QualitiesDocument = QualitiesDocument()


CardSeconds = Annotated[float, Field(ge=0, le=60)]
DissolveFrames = Annotated[int, Field(ge=0, le=1000)]
Seconds = Annotated[float, Field(ge=0, le=86400)]


class ClipDocument(Document):
    """A shot, of which the film shows all or a part."""

    shot: str
    frames: str | None = None
    dissolve: DissolveFrames = 0


class CardDocument(Document):
    """Words between shots."""

    card: str
    subtitle: str = ""
    seconds: Annotated[float, Field(gt=0, le=60)] = 2.0
    dissolve: DissolveFrames = 0


class SoundDocument(Document):
    """What is heard with a film; its file lies beside the edit."""

    file: str
    start: Annotated[float, Field(ge=-86400, le=86400)] = 0.0
    gain: Annotated[float, Field(ge=-60, le=24)] = 0.0
    fade_in: Seconds = 0.0
    fade_out: Seconds = 0.0


def _entry_form(value: Any) -> str:
    return ("a card" if "card" in value else "a shot") if isinstance(value, dict) else "by name"


class FilmDocument(Document):
    """Shots are names of files beside the film's, without their ending, in the order of the edit."""

    title: str
    subtitle: str = ""
    credits: list[str] = Field(default_factory=list)
    shots: list[
        Annotated[
            Annotated[str, Tag("by name")]
            | Annotated[ClipDocument, Tag("a shot")]
            | Annotated[CardDocument, Tag("a card")],
            Discriminator(_entry_form),
        ]
    ] = Field(min_length=1)
    sound: SoundDocument | None = None
    rate: Rate = 24
    title_seconds: CardSeconds = 3.0
    credits_seconds: CardSeconds = 3.0
