"""The layout of shot files and of edits."""

import inspect
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    SkipValidation,
    ValidationInfo,
    create_model,
    model_validator,
)

from flowsculpt.pipeline.errors import FlowsculptError, quote
from flowsculpt.pipeline.frames import FASTEST, SLOWEST
from flowsculpt.pipeline.mesh.normals import MOST_PIECES
from flowsculpt.pipeline.plugin import PictureTask, Plugin, named, plugins
from flowsculpt.pipeline.plugin_contracts import ContractError, require_function
from flowsculpt.pipeline.shot.documents.camera_documents import CameraDocument, ShutterDocument
from flowsculpt.pipeline.shot.documents.curves import NumberField, Start
from flowsculpt.pipeline.shot.documents.field_types import (
    MAPPING_IS_SECOND,
    ByForm,
    Colour,
    Count,
    Document,
    Positive,
    SchemaKeywords,
    is_number,
    no_bare_colour,
    one_of,
    optional,
)
from flowsculpt.pipeline.shot.documents.flow_documents import BARE
from flowsculpt.pipeline.shot.documents.flow_entries import DASHES, FlowDocument
from flowsculpt.pipeline.shot.documents.light_documents import LightGroupsField, StageDocument
from flowsculpt.pipeline.shot.documents.look_documents import ALL_LOOKS, LookField
from flowsculpt.pipeline.shot.documents.picture_documents import (
    LightsField,
    OverrideDocument,
    PictureShapeDocument,
    QualitiesDocument,
    ViewDocument,
)
from flowsculpt.pipeline.shot.documents.resampling import ResampleField
from flowsculpt.pipeline.shot.documents.subject_documents import SubjectDocument, SubjectsField
from flowsculpt.pipeline.shot.shot import Card, SoundTrack
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext, finding
from flowsculpt.pipeline.shot.yaml.messages import number_in
from flowsculpt.pipeline.shot.yaml.synonyms import synonym
from flowsculpt.pipeline.shot.yaml.yaml_source import in_yaml
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.graphics.title_card import PLAIN, POSITIONS, CardStyle
from flowsculpt.render.scene.aovs import AOVS
from flowsculpt.render.scene.render_quality import CONVENTIONS
from flowsculpt.render.scene.rgb_spaces import REC709, WORKING_SPACES
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_sets import SETS
from flowsculpt.render.scene.scene_stage import STAGES

PRESETS: Mapping[str, Mapping[str, Any]] = {"look": ALL_LOOKS, "lights": LIGHTS, "stage": STAGES, "set": SETS}
"""What shot files can name by a word, by the entry: looks, light rigs, stages and sets."""

StageField = Annotated[
    Annotated[str, one_of(STAGES, "stage")] | StageDocument,
    MAPPING_IS_SECOND,
    no_bare_colour("stage", "kind: cyclorama"),
]


def _no_light_groups(name: Any) -> Any:
    if name == "light_groups":
        raise ValueError("light groups are not an AOV. Write light_groups: each, at the top of the file.")
    return name


AovName = Annotated[str, BeforeValidator(_no_light_groups), one_of(AOVS, "AOV")]
Precision = Literal["half", "float"]

AovsField = Annotated[
    dict[AovName, Precision] | list[AovName], ByForm(lambda value: not isinstance(value, dict))
]
"""`[velocity, noise]`, or `{velocity: half, position: half}`."""

Layers = Annotated[str, one_of(CONVENTIONS, "program whose channel names are known")]

_PIXELS = r"^\s*(\d+\.?\d*|\.\d+)\s*px\s*$"


def _pixels(value: Any) -> Any:
    """Parse `2px` as 2.0."""
    if not isinstance(value, str):
        return value
    match = re.match(_PIXELS, value)
    if not match:
        raise ValueError(f"{quote(value)} is not a length in pixels. Write 2px.")
    return float(match[1])


Pixels = Annotated[
    float,
    BeforeValidator(_pixels),
    Field(ge=0.25, le=1000),
    SchemaKeywords(type=["number", "string"], pattern=_PIXELS),
]


class SmoothDocument(Document):
    """Segments of each edge, by their number or by their length in the picture."""

    example = "{tessellate: 2}"

    tessellate: Annotated[int, Field(ge=1, le=MOST_PIECES)] | None = optional(
        "segments that each edge is cut into; 1 is off. By default as many as smooth outlines need"
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


Seconds = Annotated[float, Field(ge=0, le=86400)]


class SoundDocument(Document):
    """A sound that is heard."""

    example = "{file: music.wav}"

    file: str = Field(description="beside this file: WAV, FLAC, or another format that FFmpeg reads")
    start: Start = Field(0.0, description="when it begins; a negative start cuts its beginning (s)")
    gain: Annotated[float, Field(ge=-60, le=24)] = Field(0.0, description="louder above 0, softer below (dB)")
    fade_in: Seconds = Field(0.0, description="duration of the fade at its beginning (s)")
    fade_out: Seconds = Field(0.0, description="duration of the fade at its end or the pictures' (s)")

    @model_validator(mode="after")
    def _can_be_read(self, info: ValidationInfo) -> Self:
        """Read the sound of a shot; `film_reader` reads that of an edit."""
        if (info.context or {}).get("parse_context") is not None:
            from flowsculpt.render.movie.movie_sound import require_sound

            path = ParseContext.of(info).file(self.file)
            require_sound(path)
        return self

    def build(self, folder: Path) -> SoundTrack:
        """Return the sound; its file is relative to `folder`.

        Raises MissingInputError or BadInputError where it cannot be read.
        """
        from flowsculpt.render.movie.movie_sound import silence_in

        file = (folder / self.file).absolute()
        values = {name: float(value) for name, value in self.model_dump(exclude={"file"}).items()}
        return SoundTrack(file, InputFile(file).digest(), **values, silence=silence_in(file))


def _require_mapping(value: Any) -> Any:
    """Refuse the name of a file alone, with the mapping that it belongs in."""
    if isinstance(value, str) and value != "off":
        raise ValueError(f"a sound is a mapping, or off. Write {in_yaml({'file': value})}.")
    return value


SoundField = Annotated[
    Annotated[str, one_of(("off",), "sound")] | SoundDocument,
    MAPPING_IS_SECOND,
    BeforeValidator(_require_mapping),
]
"""`{file: music.wav}`, or `off`."""


def _frame_count(value: Any) -> Any:
    """Refuse seconds, with the frames that they are."""
    seconds = float(value) if isinstance(value, float) else None
    if isinstance(value, str) and value.endswith("s"):
        seconds = number_in(value)
    if seconds and math.isfinite(seconds):
        raise ValueError(
            f"{value} is not a count of frames. Write {round(24 * seconds)} for {seconds:g} s at 24 a second."
        )
    return value


DissolveFrames = Annotated[int, BeforeValidator(_frame_count), Field(ge=0, le=1000)]


class LoopDocument(Document):
    """The last frames dissolve into the first, while both move; movies begin after the dissolve."""

    example = "{dissolve: 24}"

    dissolve: Annotated[DissolveFrames, Field(ge=1)] = Field(description="its length (frames)")


LoopField = Annotated[
    bool | Annotated[str, one_of(("turns",), "loop")] | LoopDocument,
    ByForm(lambda value: 2 if isinstance(value, dict) else isinstance(value, str)),
]
"""`true`, `turns`, or `{dissolve: 24}`, as `motion.Loop.of` reads them."""


def require_range(value: Any) -> Any:
    """Refuse numbers and lists, with the range that they mean."""
    if isinstance(value, str):
        return value
    if value is None:
        raise finding("frames is empty; it must be a range. Write it as 1-48.")
    numbers = (
        list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else [value]
    )
    numbers = [number if is_number(number) and math.isfinite(number) else 0.5 for number in numbers]
    whole = [int(number) for number in numbers if number == int(number)]
    if len(whole) != len(numbers) or len(whole) not in (1, 2):
        raise finding("frames has no first and last frame. Write it as 1-48.")
    first, last = (1, whole[0]) if len(whole) == 1 else whole
    raise finding(f"frames is {in_yaml(value)}; it must be a range. Write {first}-{last}.")


Frames = Annotated[
    str, BeforeValidator(require_range), SchemaKeywords(pattern=r"^\s*-?\d+(--?\d+)?(,-?\d+(--?\d+)?)*\s*$")
]
"""A range without gaps, which `motion.parse_frames` checks."""

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
    """All that a shot file may hold, as values that are checked one by one."""

    title: str = Field(description="the name of the shot")
    extends: str | None = optional("the shot beside this file from which it inherits what it leaves out")
    intent: str = Field("", description="what the shot should show, in a sentence")
    frames: Frames = Field(description="as in 1-96; the first shows the subject at rest")
    rate: Rate = Field(24, description="24, 23.976 or 24000/1001 (frames per second)")
    subject: SubjectDocument | None = optional(
        "a solid by name, a model from a file, a moving mesh, a cloud or a net"
    )
    subjects: SubjectsField | None = optional(
        "several subjects by name in place of one, each a solid, model, moving mesh, cloud or net"
    )
    resample: ResampleField = Field(
        "off",
        validate_default=False,
        description="thresholds of the surface's edges while it flows; off for comparisons",
    )
    flows: Annotated[list[FlowDocument], DASHES] = Field(
        default_factory=list, description="what moves the subjects, in order within each frame"
    )
    substeps: Count | None = optional("steps that a frame is cut into; by default as many as the flow needs")
    integrator: Annotated[str, one_of(("rk4", "adaptive"), "integrator")] = Field(
        "rk4", description="of velocity fields: rk4, or adaptive for fields that are steep somewhere"
    )
    tolerance: Positive | None = optional("error of a sub-step of the adaptive integrator, at most (units)")
    max_step: Positive | None = optional(
        "longest move of a vertex in a sub-step (maximum edges); by default what the flow allows"
    )
    speed: NumberField = Field(
        1.0, description="rate of the flow's time: 0 stands still, below 0 runs backwards"
    )
    loop: LoopField = Field(
        False,
        description="the last frame meets the first: true runs the flows there and back; turns, where flows "
        "return by themselves; or a dissolve",
    )
    picture: PictureShapeDocument | None = optional(
        "the shape of the pictures: an aspect or a size; by default 16:9, 1920×1080 in `final`"
    )
    look: LookField = Field("clay", description="the material, by name or spelt out")
    looks: dict[str, SkipValidation[LookField]] = Field(
        default_factory=dict, description="names of your own for looks; in defaults.yaml for all shots"
    )
    smooth: SmoothDocument = Field(
        default=SmoothDocument.model_construct(), description="curved patches over the triangles"
    )
    camera: CameraDocument = Field(
        default=CameraDocument.model_construct(), description="framing finds distance and target"
    )
    lights: LightsField = Field("studio", description="the light rig, by name or spelt out")
    rigs: dict[str, SkipValidation[LightsField]] = Field(
        default_factory=dict, description="names of your own for light rigs; in defaults.yaml for all shots"
    )
    light_groups: LightGroupsField = Field(
        "off", description="the light of emitters as layers: off, each, or groups of lights by name"
    )
    overrides: list[OverrideDocument] = Field(
        default_factory=list, description="look, lights and quality of some frames, in place of the shot's"
    )
    set: str | None = optional(
        f"a place that decides stage, lights and camera where the shot does not: {', '.join(SETS)}"
    )
    sets: dict[str, SkipValidation[dict[str, Any]]] = Field(
        default_factory=dict, description="places of your own by name: stage, lights and camera of each"
    )
    stage: StageField = Field("cyclorama", description="the ground below the subject, by name or spelt out")
    sound: SoundField | None = optional(
        "what is heard in movies; by default the sounds that values follow; off for none"
    )
    shutter: ShutterDocument | None = optional("exposure of a frame in time: motion blur")
    aovs: AovsField = Field(default_factory=list, description="AOVs by name, or by name with half or float")
    layers: Layers | None = optional(
        "layers for compositing in finished frames, by the channel names of blender, arnold or nuke"
    )
    view: ViewDocument = Field(
        default=ViewDocument.model_construct(),
        description="a view of an OpenColorIO config; by default ACES 2.0",
    )
    working_space: Annotated[str, one_of(tuple(WORKING_SPACES), "working space")] = Field(
        REC709.name, description="linear colours in which light is computed and pictures are written"
    )
    quality: QualitiesDocument = Field(
        default=QualitiesDocument.model_construct(), description="settings that this shot replaces"
    )


CardSeconds = Annotated[float, Field(ge=0, le=60)]


ClipFrames = Annotated[str, BeforeValidator(require_range)]


class ClipDocument(Document):
    """All of a shot, or a part of it."""

    @model_validator(mode="before")
    @classmethod
    def _names_a_shot(cls, value: Any) -> Any:
        """Refuse `A010: 1-24`, with the names that belong there."""
        name = next(iter(value)) if isinstance(value, dict) and len(value) == 1 else None
        known = (*cls.model_fields, *CardDocument.model_fields)
        if isinstance(value, dict) and value and value.keys() <= {"frames", "dissolve"}:
            raise finding(
                f"{' and '.join(value)} {'stands' if len(value) == 1 else 'stand'} beside the shot. "
                f"Write {in_yaml({'shot': 'NAME', **value})}."
            )
        if name is not None and name not in known and synonym(name, known) is None:
            part = f", frames: {value[name]}" if isinstance(value[name], str) else ""
            raise finding(f"{name} has no name before it. Write {{shot: {name}{part}}}.")
        return value

    shot: str = Field(description="its name")
    frames: ClipFrames | None = optional(
        "frames to show, as in 10-40, or 10-40x2 for every second; by default all"
    )
    dissolve: DissolveFrames = Field(0, description="overlap with the entry before (frames)")


def _require_font(name: str) -> str:
    from flowsculpt.render.graphics.typesetting import require_font  # OpenImageIO, which takes time

    try:
        return require_font(name)
    except FlowsculptError as error:
        raise ValueError(str(error)) from None


Font = Annotated[str, AfterValidator(_require_font)]


class CardStyleDocument(Document):
    """How cards look."""

    font: Font | None = optional("of titles: DroidSans, DroidSerif, or another font of this machine")
    subtitle_font: Font | None = optional("of subtitles")
    colour: Colour | None = optional("of the words")
    size: Annotated[float, Field(ge=0.25, le=4)] | None = optional("of the words, as a factor")
    ground: Annotated[Literal["picture"] | Colour | None, ByForm(lambda value: value != "picture")] = (
        optional(
            "the colour behind the words; picture lays them over the pictures, so the card takes no time"
        )
    )
    position: Annotated[str, one_of(POSITIONS, "position")] | None = optional(
        "of the words: low, middle, high, left or right; by default low over pictures, else middle"
    )

    def style(self, base: CardStyle = PLAIN) -> CardStyle:
        """Return a style with what is written here in place of its own."""
        return base.with_values(**{name: getattr(self, name) for name in CardStyleDocument.model_fields})


class CardDocument(CardStyleDocument):
    """A title card between shots."""

    card: str = Field(description="its words")
    subtitle: str = Field("", description="words below them")
    seconds: Annotated[float, Field(gt=0, le=60)] = Field(2.0, description="its duration (s)")
    dissolve: DissolveFrames = Field(0, description="overlap with the entry before (frames)")

    def build(self, style: CardStyle) -> Card:
        """Return the card, which looks as the film's cards do, `style`, where it says nothing else."""
        return Card(self.card, self.subtitle, self.seconds, self.dissolve, self.style(style))


_ENTRY = ByForm(lambda value: 0 if not isinstance(value, dict) else 2 if "card" in value else 1)


class FilmDocument(Document):
    """All that an edit may hold."""

    what = "an edit"

    title: str = Field(description="the name of the film, on its first card")
    subtitle: str = Field("", description="below the title")
    credits: list[str] = Field(default_factory=list, description="lines of the last card")
    shots: list[Annotated[str | ClipDocument | CardDocument, _ENTRY]] = Field(
        min_length=1, description="names of shot files beside this one, and cards, in the order of the edit"
    )
    sound: SoundDocument | None = optional("sound from a file beside this one")
    rate: Rate | None = optional(
        "24, 23.976 or 24000/1001: the same for all shots; by default that of the first (frames per second)"
    )
    picture: PictureShapeDocument | None = optional(
        "the shape of the pictures of all shots, in place of their own; by default they share one"
    )
    cards: CardStyleDocument = Field(
        default=CardStyleDocument.model_construct(), description="how title, cards and credits look"
    )
    title_seconds: CardSeconds = Field(3.0, description="duration of the title; 0 leaves it out (s)")
    credits_seconds: CardSeconds = Field(3.0, description="duration of the credits; 0 leaves them out (s)")

    def cards_at_the_ends(self) -> tuple[Card, Card]:
        """Return title and credits; those that are left out take no time."""
        style, (line, *lines) = self.cards.style(), self.credits or [""]
        title = Card(self.title, self.subtitle, self.title_seconds if self.title else 0.0, style=style)
        return title, Card(line, " · ".join(lines), self.credits_seconds if line else 0.0, style=style)


def _entry_of_plugin(plugin: Plugin, name: str, model: Any) -> Any:
    """Return the field of a shot file's entry. Raises ContractError for what cannot be one."""
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        raise ContractError("its model is not a pydantic model; write a class that extends Document")
    if plugin.name in _OWN_ENTRIES:
        raise ContractError(f"shots have an entry {plugin.name} of their own; give the plug-in another name")
    if stage := plugin.stages.get(name.rpartition(".")[2]):
        require_function(named(stage.task), "task", PictureTask.__call__)
    return Annotated[model | None, BARE], optional(inspect.cleandoc(model.__doc__ or name).partition("\n")[0])


def _of_plugins() -> dict[str, Any]:
    """Return the entries of shot files that plug-ins add, a mapping for each plug-in, by its name."""
    fields: dict[str, dict[str, Any]] = {}
    for name, field in plugins().parts("entries", _entry_of_plugin).items():
        plugin, _, part = name.partition(".")
        fields.setdefault(plugin, {})[part] = field
    return {
        plugin: (
            create_model(f"{plugin}Document", __base__=Document, **parts) | None,
            optional("of this plug-in"),
        )
        for plugin, parts in fields.items()
    }


_OWN_ENTRIES = frozenset(ShotDocument.model_fields)

if not TYPE_CHECKING:
    ShotDocument = create_model("ShotDocument", __base__=ShotDocument, **_of_plugins())

DOCUMENTS: dict[str, type[Document]] = {"shot": ShotDocument, "edit": FilmDocument}
"""All that the files of shots and edits may hold."""


def entries_of_plugins(document: ShotDocument) -> dict[str, BaseModel]:
    """Return what a shot writes for plug-ins, by names such as `marbling.mist`."""
    named = type(document).model_fields.keys() - _OWN_ENTRIES
    given = {name: getattr(document, name) for name in sorted(named) if getattr(document, name) is not None}
    found = {
        f"{name}.{part}": getattr(entry, part)
        for name, entry in given.items()
        for part in entry.model_fields_set
    }
    return {name: entry for name, entry in found.items() if entry is not None}
