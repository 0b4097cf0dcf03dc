"""The entry `overrides` of a shot file: look, lights and quality of some of its frames."""

from collections.abc import Callable
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, model_validator

from pipeline.frames import FrameRange
from pipeline.shot.documents.fields import MAPPING_IS_SECOND, Document, one_of, optional
from pipeline.shot.documents.lights import LightsDocument, require_rig
from pipeline.shot.documents.look import LookField, look_of
from pipeline.shot.documents.quality import QualitiesDocument
from pipeline.shot.shot import FrameOverride
from pipeline.shot.yaml.validation import finding
from render.scene.lights import LIGHTS, LightRig

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
    """A look, lights and a quality of some frames, in place of the shot's; see `override_checks`."""

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
        qualities = self.quality.model_dump(exclude_none=True) if self.quality else {}
        return FrameOverride(
            frames=FrameRange.parse(self.frames),
            look=None if self.look is None else look_of(self.look),
            lights=None if self.lights is None else grouped(built_lights(self.lights)),
            qualities={name: _settings(settings) for name, settings in qualities.items() if settings},
        )


def _settings(written: dict[str, Any]) -> dict[str, Any]:
    """Return settings as `Quality` has them."""
    off = {"noise_threshold": None} if written.get("noise_threshold") == "off" else {}
    return {**written, **off}
