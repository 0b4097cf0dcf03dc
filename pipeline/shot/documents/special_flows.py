"""What flows take beyond their own parameters: formulas, targets, curves, samples and Python."""

from __future__ import annotations

import ast
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import CoreSchema

from pipeline.flow.catalogue.attraction import Attraction, Target, Wind
from pipeline.flow.catalogue.formula import MAX_NUMBERS, FormulaField
from pipeline.flow.catalogue.noise import CurlNoise
from pipeline.flow.catalogue.sampled import Sampled, SampledFiles
from pipeline.flow.parameters import Sense
from pipeline.flow.python_file import PythonFlow
from pipeline.formula import FUNCTIONS
from pipeline.formula.compiled import NAMES
from pipeline.formula.words import CONSTANTS
from pipeline.mesh.io.read import read_mesh
from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import NumberField, number
from pipeline.shot.documents.fields import A_NUMBER_TOO, Positive, Triple, exactly_one, readable, vector
from pipeline.shot.documents.flow_parameters import FlowParameters
from pipeline.shot.yaml.parse_context import Surroundings, finding, told


def _names_a_number(word: str) -> str:
    if not word.isidentifier() or word in {*NAMES, *CONSTANTS, *FUNCTIONS}:
        raise finding(f"{word!r} cannot name a number: it is no word, or has a meaning. Choose another.")
    return word


def _readable(text: str, info: ValidationInfo) -> str:
    if "numbers" not in info.data:
        return text  # what is wrong with these is told; who knows which words they were to be
    return readable(text, (*NAMES, *info.data["numbers"]))


Text = Annotated[str, A_NUMBER_TOO, AfterValidator(_readable)]


class FormulaDocument(FlowParameters):
    """`[-y, x, 0.3 * sin(t)]`, or with words of its own under `with`; these are read first."""

    flow = FormulaField

    numbers: Annotated[
        dict[Annotated[str, AfterValidator(_names_a_number)], NumberField],
        Field(default_factory=dict, alias="with", max_length=MAX_NUMBERS),
        Sense("numbers for the formulas by their names, each constant or keyed"),
    ]
    velocity: Annotated[
        list[Text], Field(min_length=3, max_length=3), Sense("along x, y and z, over these", "units/s")
    ]

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        """`formula: [a, b, c]` is `formula: {velocity: [a, b, c]}`."""
        if isinstance(value, str | int | float):
            raise finding(f"formula is {value!r}; it must be three of them. Write them as [-y, x, 0].")
        return {"velocity": value} if isinstance(value, list) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        bare = {"type": "array", "items": {"type": ["string", "number"]}, "minItems": 3, "maxItems": 3}
        return {"anyOf": [handler(core), bare]}

    def more(self, clock: Clock) -> dict[str, Any]:
        words = tuple((name, number(value, clock)) for name, value in self.numbers.items())
        return {"texts": tuple(self.velocity), "words": words, **self._beginning(clock)}

    @staticmethod
    def _beginning(clock: Clock) -> dict[str, Any]:
        """What `frame` is counted by."""
        return {"fps": float(clock.rate.fps), "first": clock.frames.first}

    @model_validator(mode="after")
    def _fits(self) -> FormulaDocument:
        """There is room for all numbers, and for `frame`."""
        told(lambda: FormulaField(tuple(self.velocity), tuple((name, 0.0) for name in self.numbers)))  # type: ignore[arg-type]  # three, as the field says
        return self


class CurlNoiseDocument(FlowParameters):
    """Nothing beyond."""

    flow = CurlNoise


class AttractionDocument(FlowParameters):
    """To points, a curve or a mesh: exactly one of them."""

    model_config = exactly_one("points", "curve", "mesh")

    flow = Attraction

    points: Annotated[
        list[Triple] | None, Field(min_length=1), Sense("the nearest of these attracts", "units")
    ] = None
    curve: Annotated[
        list[Triple] | None, Field(min_length=2), Sense("a smooth curve through these attracts", "units")
    ] = None
    mesh: Annotated[str | None, Sense("the surface in this file attracts")] = None
    closed: Annotated[bool, Sense("from its last point the curve goes on to the first")] = False
    scale: Annotated[Positive, Sense("factor on the mesh")] = 1.0

    _target: Target = PrivateAttr()

    @model_validator(mode="after")
    def _to_one(self, info: ValidationInfo) -> AttractionDocument:
        given = [name for name in ("points", "curve", "mesh") if getattr(self, name) is not None]
        if not given:
            raise finding("attraction needs a place to go to; write one of points, curve and mesh")
        if len(given) > 1:
            raise finding(
                f"attraction goes to one of points, curve and mesh, not to {' and '.join(given)}; write one"
            )
        if self.points is not None:
            self._target = Target.points(np.array(self.points))
        elif self.curve is not None:
            self._target = Target.curve(np.array(self.curve), self.closed)
        else:
            file = Surroundings.of(info).file(str(self.mesh))
            self._target = told(lambda: Target.surface(read_mesh(file), float(self.scale)))
        return self

    def more(self, clock: Clock) -> dict[str, Any]:
        return {"target": self._target}


class WindDocument(FlowParameters):
    flow = Wind

    through: Annotated[list[Triple], Field(min_length=2), Sense("points of the curve", "units")]

    @field_validator("through")
    @classmethod
    def _goes_somewhere(cls, through: list[list[float]]) -> list[list[float]]:
        for here, there in pairwise(through):
            if here == there:
                raise finding(
                    f"the curve goes through {here} twice in a row; it stands still there. Remove one."
                )
        return through

    def more(self, clock: Clock) -> dict[str, Any]:
        return {"through": tuple(vector(point) for point in self.through)}


class SampledDocument(FlowParameters):
    """Files are read when the shot is: what is wrong with them is told with the shot."""

    flow = Sampled

    file: Annotated[str, Sense("where the samples are; with a * a sequence of files")]
    array: Annotated[str | None, Sense("the name of the velocities in a VTK file that holds several")] = None
    interval: Annotated[Positive, Sense("from file to file", "s")] = 1.0

    _files: SampledFiles = PrivateAttr()

    @model_validator(mode="after")
    def _sound(self, info: ValidationInfo) -> SampledDocument:
        surroundings = Surroundings.of(info)
        paths = surroundings.files(self.file)
        self._files = told(lambda: SampledFiles.of(paths, self.array, float(self.interval)))
        surroundings.digests.update(zip(paths, self._files.samples.digests, strict=True))
        return self

    def more(self, clock: Clock) -> dict[str, Any]:
        return {"files": self._files}


class PythonDocument(FlowParameters):
    """Only looked at here, whether it is Python; to run it needs permission."""

    flow = PythonFlow

    file: Annotated[str, Sense("a Python file")]
    function: Annotated[str, Sense("the name of a function in it")]

    _path: Path = PrivateAttr()
    _digest: str = PrivateAttr()
    _allowed: bool = PrivateAttr()

    @field_validator("function")
    @classmethod
    def _is_a_name(cls, function: str) -> str:
        if not function.isidentifier():
            raise finding(f"{function!r} names no function; write it as in the file, without brackets.")
        return function

    @model_validator(mode="after")
    def _there(self, info: ValidationInfo) -> PythonDocument:
        surroundings = Surroundings.of(info)
        self._path, self._allowed = surroundings.file(self.file), surroundings.allow_code
        self._digest = surroundings.digests[self._path]
        try:
            ast.parse(self._path.read_bytes(), str(self._path))
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            line = f" (line {error.lineno})" if isinstance(error, SyntaxError) and error.lineno else ""
            raise finding(
                f"{self._path}: it is no Python{line}: {getattr(error, 'msg', error)}. Mend it there."
            ) from None
        return self

    def more(self, clock: Clock) -> dict[str, Any]:
        of_file = {"digest": self._digest, "path": self._path, "allowed": self._allowed}
        return {"function": self.function, **of_file}


OWN: dict[str, type[FlowParameters]] = {
    "formula": FormulaDocument,
    "curl_noise": CurlNoiseDocument,
    "attraction": AttractionDocument,
    "wind": WindDocument,
    "sampled": SampledDocument,
    "python": PythonDocument,
}
"""Flows of a shot's own making, in the order of the docs."""
