"""The entries `subject` and `subjects` of a shot file: a solid, model, cloud or net, or several by name.

Each of several subjects has a place, a look and flows of its own.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping
from functools import reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, create_model, model_validator

from flowsculpt.pipeline.errors import UsageError, suggest
from flowsculpt.pipeline.plugin import Plugin, plugins
from flowsculpt.pipeline.plugin_contracts import require_class
from flowsculpt.pipeline.shot.copies import MOST_COPIES, Copies, OrderedPlaces
from flowsculpt.pipeline.shot.documents.field_types import (
    LARGEST,
    ORIGIN,
    ByForm,
    Document,
    OneOfSeveral,
    Positive,
    Triple,
    exactly_one,
    is_number,
    one_of,
    optional,
)
from flowsculpt.pipeline.shot.documents.flow_entries import DASHES, FlowDocument, RegionDocument
from flowsculpt.pipeline.shot.documents.look_documents import LookField
from flowsculpt.pipeline.shot.documents.resampling import ResampleField
from flowsculpt.pipeline.shot.documents.subject_kinds import (
    CopyLayout,
    MovingKind,
    NamedKind,
    PointsKind,
    SizedDocument,
    SubjectKind,
)
from flowsculpt.pipeline.shot.motion import Clock
from flowsculpt.pipeline.shot.subjects import Measure, Model, PluginSurface, Solid
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where
from flowsculpt.render.base.input_files import joint_digest
from flowsculpt.render.base.plural import indefinite, plural


def _measures_by_solid(schema: dict[str, Any]) -> None:
    """Add the measures of each solid to the JSON Schema, as `subject_checks.check_solid` checks them."""
    every = {measure for kind in Solid.KINDS.values() for measure in kind.measures}
    schema["allOf"] = [
        {
            "if": {"properties": {"solid": {"const": name}}, "required": ["solid"]},
            "then": {"properties": _of_solid(kind.measures, every)},
        }
        for name, kind in Solid.KINDS.items()
    ]


def _of_solid(measures: Mapping[str, Any], every: set[str]) -> dict[str, Any]:
    """Return lengths of the lists that are measures of a solid, and refuse the measures of others."""
    many = {name: len(value) for name, value in measures.items() if isinstance(value, tuple)}
    exact = {name: {"minItems": n, "maxItems": n} for name, n in many.items()}
    return exact | dict.fromkeys(sorted(every - measures.keys()), False)


def _coarsest(solid: str, given: Mapping[str, Any]) -> object:
    return Solid.of(solid, given).build(100 * LARGEST)


class SolidDocument(Document):
    """A solid and its measures; `faults` checks that they are those of its kind."""

    example = "{solid: box}"

    model_config = ConfigDict(json_schema_extra=_measures_by_solid)

    solid: Annotated[str, one_of(Solid.KINDS, "solid")] = Field(description="its name")
    size: list[Positive] | None = optional("its sides (units)", min_length=2, max_length=3)
    radius: Positive | None = optional(
        "from the middle to the surface, or of a torus to the middle of its tube (units)"
    )
    length: Positive | None = optional("from end to end (units)")
    tube_radius: Positive | None = optional("of the tube of a torus; below its radius (units)")
    spacing: Positive | None = optional("of a lattice: between the middles of its bars (units)")
    thickness: Positive | None = optional("of a lattice's bars (units)")
    caps: Literal["round", "flat"] | None = optional("the ends of a rod")

    def build(self, folder: Path = Path()) -> Solid:
        return Solid.of(self.solid, self.model_dump(exclude_none=True, include=_MEASURES))

    @staticmethod
    def faults(
        where: Where,
        given: Mapping[str, Any],
        kinds: Mapping[str, Any] = Solid.KINDS,
        build: Callable[[str, Mapping[str, Any]], object] = _coarsest,
    ) -> Iterator[Problem]:
        """Yield what is wrong with the measures of a solid, as a file has them: its place, and a message.

        where  the place of the solid
        kinds  solids by name, whose `measures` are their defaults by name
        build  makes a solid of its name and measures. Raises UsageError where these contradict each other
        """
        name = given.get("solid")
        if not isinstance(name, str) or name not in kinds:
            return  # the document reports it
        measures: Mapping[str, Measure] = kinds[name].measures
        unknown = [m for m in given if m in _MEASURES and m not in measures]
        yield from (
            ((*where, m), f"{m} is not a measure of {indefinite(name)}. {suggest(m, measures)}")
            for m in unknown
        )
        size, wanted = given.get("size"), np.size(measures.get("size", ()))
        if wanted and (meant := _meant_size(size, wanted)):
            yield (
                (*where, "size"),
                f"size of {indefinite(name)} has {plural(wanted, 'number')}. Write {meant}.",
            )
        elif not unknown:
            known = {m: given[m] for m in measures if m in given}
            if all(_has_form(value, measures[m]) for m, value in known.items()):
                try:
                    build(name, known)
                except UsageError as error:
                    yield where, f"{error}"


_MEASURES = {name for name in SolidDocument.model_fields if name != "solid"}


def _meant_size(size: Any, wanted: int) -> list[Any] | None:
    """Return the size that one with another number of sides means; None for a good one, or another type."""
    if is_number(size):
        return [size] * wanted
    if not isinstance(size, list) or len(size) == wanted:
        return None
    if len(size) == 1 and isinstance(size[0], list):
        return size[0]
    return [*size, *[size[-1] if size else 1] * wanted][:wanted]


def _has_form(value: Any, default: Measure) -> bool:
    """Tell whether a measure has the form of its default; the document reports others."""
    if isinstance(default, str):
        return isinstance(value, str)
    parts = value if isinstance(default, tuple) and isinstance(value, list) else [value]
    return all(is_number(part) and 0 < part <= LARGEST for part in parts)


class ModelDocument(SizedDocument):
    """A model that is read from a file."""

    example = "{model: FILE.obj}"

    model: str = Field(description="an OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD beside the shot file")
    prim: str | None = optional("of a USD stage: the path of the prim to read, as /World/Chair")
    time_code: float | None = optional("of a USD stage: when to read it, in place of its start")
    up: Literal["y", "z"] | None = optional(
        "the axis of the file that points up: what the file states, else y"
    )
    repair: Literal["on", "off"] = Field(
        "on", description="mends faults such as third faces on an edge; off refuses them"
    )
    paint: Literal["on", "off"] = Field(
        "off", description="keeps texture coordinates, vertex colours and materials for the look to show"
    )

    def build(self, folder: Path) -> Model:
        return Model.of_file(
            folder / self.model,
            self.up,
            self.paint == "on",
            repair=self.repair == "on",
            prim=self.prim,
            time_code=None if self.time_code is None else float(self.time_code),
            **self.placing(),
        )


class PluginSurfaceDocument(OneOfSeveral, SizedDocument):
    """A surface that a plug-in makes of its settings, by the name of its kind."""

    noun: ClassVar[str] = "a subject of a plug-in"
    versions: ClassVar[Mapping[str, str]] = {}
    """The version of the plug-in by the name of each kind."""

    def build(self, folder: Path) -> PluginSurface:
        (name,) = self.named
        digest, mesh = getattr(self, name).made((name, self.versions[name]))
        return PluginSurface(digest, path=Path(name), name=name, mesh=mesh, **self.placing())


def _part_of_plugin(plugin: Plugin, name: str, kind: Any) -> tuple[type[Document], str, Any]:
    """Return a kind of subject or a layout of copies, its plug-in's version, and its field in documents.

    Raises ContractError for a class that is neither, and for points whose name another plug-in may take.
    """
    require_class(kind, SubjectKind, CopyLayout, PointsKind, MovingKind)
    if issubclass(kind, NamedKind) and not kind.__module__.startswith("flowsculpt."):
        kind.require_word_of(plugin.name)
    description = inspect.cleandoc(kind.__doc__ or name).partition("\n")[0]
    return kind, plugin.version, (kind | None, optional(description))


def _add_parts(document: type[OneOfSeveral], contract: type[Document], *own: str) -> Any:
    """Return a document with a field for each part of plug-ins of a contract; shots name one of them.

    own  names of the document that shots may write in their place
    """
    parts = {name: part for name, part in _PARTS.items() if issubclass(part[0], contract)}
    added: dict[str, Any] = {name: field for name, (_, _, field) in parts.items()}
    made: Any = create_model(document.__name__, __base__=document, **added)
    made.versions = {name: version for name, (_, version, _) in parts.items()}
    made.several = (*own, *parts)
    made.model_config |= exactly_one(*made.several) if made.several else {}
    return made


_PARTS = plugins().parts("subjects", _part_of_plugin)


if not TYPE_CHECKING:
    PluginSurfaceDocument = _add_parts(PluginSurfaceDocument, SubjectKind)


NAMED: dict[str, type[NamedKind]] = {
    kind.word(): kind for kind, _, _ in _PARTS.values() if issubclass(kind, NamedKind)
}
"""The kinds of subjects whose settings stand in the subject itself, by the names that shots write."""

POINTS: dict[str, type[PointsKind]] = {
    word: kind for word, kind in NAMED.items() if issubclass(kind, PointsKind)
}
"""Those of them that are points."""


def named_kind(subject: Mapping[str, Any]) -> type[NamedKind] | None:
    """Return the kind of a subject, as the file has it, whose settings stand there; None for any other."""
    return next((kind for word, kind in NAMED.items() if word in subject), None)


def points_kind(subject: Mapping[str, Any]) -> type[PointsKind] | None:
    """Return the kind of a subject, as the file has it, that is points; None for any other."""
    kind = named_kind(subject)
    return kind if kind is not None and issubclass(kind, PointsKind) else None


def subject_form(value: Any) -> int:
    """Return which member of `SubjectDocument` a subject is, by the name that only it has."""
    if isinstance(value, str):  # is wrong; the message proposes what it looks like
        return int("." in value)
    names = value if isinstance(value, dict) else ()
    made = (len(NAMED) + 2) * any("." in str(name) for name in names)
    return next((i for i, name in enumerate(("model", *NAMED), 1) if name in names), made)


if TYPE_CHECKING:
    SubjectDocument = SolidDocument | ModelDocument | PointsKind | MovingKind | PluginSurfaceDocument
else:
    _FORMS = (SolidDocument, ModelDocument, *NAMED.values(), PluginSurfaceDocument)
    SubjectDocument = Annotated[reduce(or_, _FORMS), ByForm(subject_form)]
"""Each has `build(folder)`, with the folder of the shot file; those that are given take the clock too."""


class CopiesDocument(OneOfSeveral):
    """Copies of a subject, in a region or a layout of a plug-in."""

    example = "{count: 12, region: {sphere: {radius: 2}}}"
    noun, several = "the place of copies", ("region",)
    versions: ClassVar[Mapping[str, str]] = {}
    """The version of the plug-in by the name of each layout."""

    count: Annotated[int, Field(ge=1, le=MOST_COPIES)] = Field(description="how many there are")
    seed: Annotated[int, Field(ge=0)] = Field(0, description="another one scatters them differently")
    region: RegionDocument | None = optional("holds all of them whole in the first frame, at random places")
    rigid: bool = Field(False, description="keeps their shape: the flow carries and turns each as a whole")
    size: list[Positive] = Field(
        [1.0, 1.0], min_length=2, max_length=2, description="the smallest and the largest, by chance between"
    )
    turn: Literal["none", "upright", "random"] = Field(
        "none", description="by chance: each about its own vertical axis, or in any way"
    )

    @model_validator(mode="after")
    def _grows(self) -> Self:
        if self.size[0] > self.size[1]:
            raise ValueError(
                f"size goes from {self.size[0]:g} to {self.size[1]:g}; write the smallest first."
            )
        return self

    def build(self, clock: Clock) -> Copies:
        (name,) = self.named
        region, layout = None if self.region is None else self.region.build(clock), None
        if region is None:
            entry = getattr(self, name)
            settings = entry.model_dump_json(exclude_defaults=True)
            digest = joint_digest([name, self.versions[name], settings, *entry.digests()])
            layout = OrderedPlaces(digest, entry.places)
        size = float(self.size[0]), float(self.size[1])
        return Copies(self.count, self.seed, region, layout, self.rigid, size, self.turn)


if not TYPE_CHECKING:
    CopiesDocument = _add_parts(CopiesDocument, CopyLayout, "region")


class SubjectSettings(Document):
    """Names in an entry of `subjects`, besides those of its solid, model, cloud or net."""

    place: Triple = Field(ORIGIN, description="where its origin is before it moves (units)")
    copies: CopiesDocument | None = optional("copies of it, scattered in a region")
    look: LookField | None = optional("its material, by name or spelt out; by default the shot's")
    flows: Annotated[list[FlowDocument], DASHES] = Field(
        default_factory=list, description="what moves it after the flows of the shot, which move all subjects"
    )
    resample: ResampleField | None = optional("thresholds of its edges; by default those of the shot")


class SubjectOfSolidDocument(SubjectSettings, SolidDocument):
    """A solid among several subjects."""


class SubjectOfModelDocument(SubjectSettings, ModelDocument):
    """A model among several subjects."""


class SubjectOfPluginDocument(SubjectSettings, PluginSurfaceDocument):
    """A surface of a plug-in among several subjects."""


def _among_several(kind: type[NamedKind]) -> Any:
    """Return the document of a kind among several subjects."""
    return create_model(f"SubjectOf{kind.__name__}", __base__=(SubjectSettings, kind), __doc__=kind.__doc__)


if TYPE_CHECKING:

    class SubjectOfPoints(SubjectSettings, PointsKind):
        """Points among several subjects."""

    class SubjectOfAnimated(SubjectSettings, MovingKind):
        """A surface that is given, among several subjects."""

    SubjectEntry = (
        SubjectOfSolidDocument
        | SubjectOfModelDocument
        | SubjectOfPoints
        | SubjectOfAnimated
        | SubjectOfPluginDocument
    )
else:
    _ENTRIES = (SubjectOfSolidDocument, SubjectOfModelDocument, *map(_among_several, NAMED.values()))
    SubjectEntry = reduce(or_, (*_ENTRIES, SubjectOfPluginDocument))

SubjectsField = dict[str, Annotated[SubjectEntry, ByForm(subject_form)]]
