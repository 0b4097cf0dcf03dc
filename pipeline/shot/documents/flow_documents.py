"""Documents made from the dataclasses of flows, which alone define the parameters.

Angles are degrees in the file and radians in the code.
"""

import ast
import typing
from dataclasses import MISSING
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)
from pydantic_core import CoreSchema

from flowsculpt.pipeline.errors import quote, reason_of
from flowsculpt.pipeline.flow import Flow, VelocityField, catalogue
from flowsculpt.pipeline.flow.catalogue.external_fields import (
    MAX_NUMBERS,
    Attraction,
    FormulaField,
    Target,
    Wind,
)
from flowsculpt.pipeline.flow.catalogue.vortices import CurlNoise
from flowsculpt.pipeline.flow.compiled_formulas import NAMES
from flowsculpt.pipeline.flow.flow import MOST_CODE, PluginMap, PythonFlow
from flowsculpt.pipeline.flow.parameters import (
    Parameter,
    ParameterDoc,
    parameter,
    parameters_of,
    shot_name,
    summary,
)
from flowsculpt.pipeline.flow.velocity import PluginField
from flowsculpt.pipeline.formula import CONSTANTS, FUNCTIONS
from flowsculpt.pipeline.mesh.read import read_mesh
from flowsculpt.pipeline.plugin import Plugin, plugins
from flowsculpt.pipeline.plugin_contracts import require_class
from flowsculpt.pipeline.shot.documents import curves
from flowsculpt.pipeline.shot.documents.curves import NumberField, number
from flowsculpt.pipeline.shot.documents.field_types import (
    Axis,
    Document,
    NumberOrText,
    OneOfSeveral,
    Positive,
    Real,
    Triple,
    axis,
    parsed_formula,
    vector,
)
from flowsculpt.pipeline.shot.motion import Clock
from flowsculpt.pipeline.shot.yaml.document_validation import ParseContext, finding
from flowsculpt.render.base.input_files import InputFile


class FlowParameters(Document):
    """Base of the documents of flows.

    parameters  those of the flow's dataclass
    own         those that the document adds, such as a file to read
    origin      of a plug-in's flow, the plug-in, its version and the flow's name
    """

    flow: ClassVar[type[Flow] | type[VelocityField]]
    origin: ClassVar[tuple[str, str, str] | None] = None
    parameters: ClassVar[tuple[Parameter, ...]]
    own: ClassVar[tuple[Parameter, ...]]

    def build(self, clock: Clock) -> Any:
        """Return the flow; parameters that the file leaves out take the defaults of the code."""
        given = [p for p in self.parameters if p.name in self.model_fields_set]
        flow = self.flow(
            **{p.name: _value(p, getattr(self, p.name), clock) for p in given}, **self.own_values(clock)
        )
        if self.origin is None:
            return flow
        return PluginMap(flow, self.origin) if isinstance(flow, Flow) else PluginField(flow, self.origin)

    def own_values(self, clock: Clock) -> dict[str, Any]:
        """Return the arguments of the flow that come from the document's own fields."""
        return {}


def document_of(flow: type, base: type[FlowParameters] = FlowParameters) -> type[FlowParameters]:
    """Return the document of a flow: the fields of `base`, and then the parameters of the dataclass."""
    parameters = parameters_of(flow)
    entries: dict[str, Any] = {p.name: (_kind(p), _field(p)) for p in parameters}
    document = create_model(f"{flow.__name__}Parameters", __base__=base, __doc__=summary(flow), **entries)
    document.flow, document.parameters, document.own = flow, parameters, _own(base)
    return document


def _document_of_plugin(plugin: Plugin, name: str, flow: Any) -> type[FlowParameters]:
    """Return the document of a plug-in's flow, or of its base document. Raises ContractError."""
    base = FlowParameters
    if isinstance(flow, type) and issubclass(flow, FlowParameters):
        base, flow = flow, flow.flow
    require_class(flow, VelocityField, Flow)
    document = document_of(flow, base)
    if not flow.__module__.startswith("flowsculpt.pipeline.flow."):  # ours is decided by its data alone
        document.origin = (plugin.name, plugin.version, name)
    return document


def _own(base: type[FlowParameters]) -> tuple[Parameter, ...]:
    kinds = typing.get_type_hints(base, include_extras=True)
    return tuple(
        parameter(
            field.alias or name,
            kinds[name],
            MISSING if field.is_required() else field.get_default(call_default_factory=True),
        )
        for name, field in base.model_fields.items()
    )


def _kind(p: Parameter) -> Any:
    """Return the type of a parameter in a document."""
    if p.bounds:
        return Annotated[p.kind, Field(ge=p.bounds.low, le=p.bounds.high)]
    kinds = {
        "number": curves.PositiveField if p.positive else curves.NumberField,
        "constant": Positive if p.positive else Real,
        "vector": curves.PlaceField,
        "point": Triple,
        "direction": Axis,
    }
    return kinds.get(p.form, p.kind)


def _field(p: Parameter) -> Any:
    about = p.description
    return Field(description=about) if p.needed else Field(p.default_in_file, description=about)


def _value(p: Parameter, value: Any, clock: Clock) -> Any:
    """Return a parsed value as the flow takes it."""
    match p.form:
        case "number":
            return curves.number(value, clock, p.doc.factor)
        case "constant":
            return float(value) * p.doc.factor
        case "vector":
            return curves.place(value, clock)
        case "point":
            return vector(value)
        case "direction":
            return axis(value)
        case _:
            return value


def _check_name(word: str) -> str:
    if not word.isidentifier() or word in {*NAMES, *CONSTANTS, *FUNCTIONS}:
        rule = "it is not a word, or has a meaning"
        raise finding(f"{quote(word)} cannot name a number: {rule}. Choose another.")
    return word


def _check_formula(text: str, info: ValidationInfo) -> str:
    if "numbers" not in info.data:
        return text  # the names are wrong themselves, so the formula's words are unknown
    return parsed_formula(text, (*NAMES, *info.data["numbers"]))


Text = Annotated[NumberOrText, AfterValidator(_check_formula)]


class FormulaDocument(FlowParameters):
    """`[-y, x, 0.3 * sin(t)]`, or with numbers of its own under `with`, which are validated first."""

    flow = FormulaField

    numbers: Annotated[
        dict[Annotated[str, AfterValidator(_check_name)], NumberField],
        Field(default_factory=dict, alias="with", max_length=MAX_NUMBERS),
        ParameterDoc("numbers for the formulas by their names, each constant or keyed"),
    ]
    velocity: Annotated[
        list[Text], Field(min_length=3, max_length=3), ParameterDoc("along x, y and z, over these", "units/s")
    ]

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        """`formula: [a, b, c]` is `formula: {velocity: [a, b, c]}`."""
        given = value.get("velocity", []) if isinstance(value, dict) else value
        if isinstance(given, str | int | float):
            raise finding(f"formula: {quote(given)} is not a list of three, such as [-y, x, 0]")
        return {"velocity": value} if isinstance(value, list) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        bare = {"type": "array", "items": {"type": ["string", "number"]}, "minItems": 3, "maxItems": 3}
        return {"anyOf": [handler(core), bare]}

    def own_values(self, clock: Clock) -> dict[str, Any]:
        words = tuple((name, number(value, clock)) for name, value in self.numbers.items())
        rate = {"fps": float(clock.rate.fps), "first": clock.frames.first}  # which `frame` counts by
        return {"texts": tuple(self.velocity), "words": words, **rate}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        """Check that all numbers and `frame` fit the flow."""
        x, y, z = self.velocity
        ParseContext.attempt(lambda: FormulaField((x, y, z), tuple((name, 0.0) for name in self.numbers)))
        return self


class CurlNoiseDocument(FlowParameters):
    flow = CurlNoise


class AttractionDocument(OneOfSeveral, FlowParameters):
    """Attraction to points, a curve or a mesh."""

    noun, several = "the target of attraction", ("points", "curve", "mesh")

    flow = Attraction

    points: Annotated[
        list[Triple] | None, Field(min_length=1), ParameterDoc("the nearest of these attracts", "units")
    ] = None
    curve: Annotated[
        list[Triple] | None,
        Field(min_length=2),
        ParameterDoc("a smooth curve through these attracts", "units"),
    ] = None
    mesh: Annotated[str | None, ParameterDoc("the surface in this file attracts")] = None
    closed: Annotated[bool, ParameterDoc("joins the last point of the curve to the first")] = False
    scale: Annotated[Positive, ParameterDoc("factor on the mesh")] = 1.0

    _target: Target = PrivateAttr()

    @model_validator(mode="after")
    def _to_one(self, info: ValidationInfo) -> Self:
        if self.points is not None:
            self._target = Target.points(np.array(self.points))
        elif self.curve is not None:
            self._target = Target.curve(np.array(self.curve), self.closed)
        else:
            file = ParseContext.of(info).mesh(str(self.mesh))
            self._target = ParseContext.attempt(lambda: Target.surface(read_mesh(file), float(self.scale)))
        return self

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"target": self._target}


class WindDocument(FlowParameters):
    flow = Wind

    through: Annotated[list[Triple], Field(min_length=2), ParameterDoc("points of the curve", "units")]

    @field_validator("through")
    @classmethod
    def _has_directions(cls, through: list[list[float]]) -> list[list[float]]:
        for point, following in pairwise(through):
            if point == following:
                raise finding(
                    f"the curve goes through {point} twice in a row, so it has no direction there. "
                    "Remove one."
                )
        return through

    def own_values(self, clock: Clock) -> dict[str, Any]:
        return {"through": tuple(vector(point) for point in self.through)}


class PythonDocument(FlowParameters):
    """A Python function, which is only parsed here; running it needs permission."""

    flow = PythonFlow

    file: Annotated[str, ParameterDoc("a Python file")]
    function: Annotated[str, ParameterDoc("the name of a function in it")]
    reads: Annotated[
        list[str],
        Field(default_factory=list),
        ParameterDoc("files that it opens; their contents decide frames too"),
    ]

    _path: Path = PrivateAttr()
    _digest: str = PrivateAttr()
    _allowed: bool = PrivateAttr()
    _reads: dict[Path, str] = PrivateAttr(default_factory=dict)

    @field_validator("function")
    @classmethod
    def _is_a_name(cls, function: str) -> str:
        if not function.isidentifier():
            remedy = "write it as in the file, without brackets"
            raise finding(f"{quote(function)} names no function; {remedy}.")
        return function

    @model_validator(mode="after")
    def _is_python(self, info: ValidationInfo) -> Self:
        context = ParseContext.of(info)
        self._path, self._allowed = context.file(self.file), context.allow_code
        self._digest = context.digests[self._path]
        self._reads = {path: context.digests[path] for path in map(context.file, self.reads)}
        code = ParseContext.attempt(lambda: InputFile(self._path, MOST_CODE).content())
        try:
            ast.parse(code, str(self._path))
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            line = f" (line {error.lineno})" if isinstance(error, SyntaxError) and error.lineno else ""
            reason = reason_of(error if not isinstance(error, SyntaxError) else ValueError(error.msg))
            raise finding(f"{self._path}: this is not Python{line}: {reason}. Correct it there.") from None
        return self

    def own_values(self, clock: Clock) -> dict[str, Any]:
        file = {"digest": self._digest, "path": self._path, "allowed": self._allowed}
        opened = {"files": tuple(self._reads), "reads": tuple(self._reads.values())}
        return {"function": self.function, **file, **opened}


_WRITTEN_OUT: dict[str, type[FlowParameters]] = {
    "formula": FormulaDocument,
    "curl_noise": CurlNoiseDocument,
    "attraction": AttractionDocument,
    "wind": WindDocument,
    "python": PythonDocument,
}

FLOW_DOCUMENTS: dict[str, type[FlowParameters]] = {
    **{shot_name(flow): document_of(flow) for flow in catalogue.FLOWS},
    **{name: document_of(base.flow, base) for name, base in _WRITTEN_OUT.items()},
    **plugins().parts("flows", _document_of_plugin),
}
"""The flows that a shot can name, in the order of the docs; those of plug-ins last."""

BARE = BeforeValidator(lambda value: {} if value is None else value)
"""`- enright:` is the same as `- enright: {}`."""


def entries(base: type) -> dict[str, Any]:
    """Return optional fields of a document, one for each flow that is a `base`."""
    return {
        name: (Annotated[document | None, BARE], Field(None, validate_default=False))
        for name, document in FLOW_DOCUMENTS.items()
        if issubclass(document.flow, base)
    }
