"""The entry `python` of flows in a shot file."""

import ast
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from flowsculpt import UsageError
from flowsculpt.api import quote, shorten
from flowsculpt.api.files import InputFile
from flowsculpt.api.flows import ParameterDoc
from flowsculpt.api.shots import Clock, FlowParameters, ParseContext
from flowsculpt.pipeline.plugins.python.python_flow import MOST_CODE, PythonFlow


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
            raise UsageError(f"{quote(function)} names no function; {remedy}.")
        return function

    @model_validator(mode="after")
    def _is_python(self, info: ValidationInfo) -> Self:
        context = ParseContext.of(info)
        self._path, self._allowed = context.file(self.file), context.allow_code
        self._digest = context.digests[self._path]
        self._reads = {path: context.digests[path] for path in map(context.file, self.reads)}
        _require_python(self._path)
        return self

    def own_values(self, clock: Clock) -> dict[str, Any]:
        file = {"digest": self._digest, "path": self._path, "allowed": self._allowed}
        opened = {"files": tuple(self._reads), "reads": tuple(self._reads.values())}
        return {"function": self.function, **file, **opened}


def _require_python(path: Path) -> None:
    """Raise UsageError for a file that is not Python."""
    try:
        ast.parse(InputFile(path, MOST_CODE).content(), str(path))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = f" (line {error.lineno})" if isinstance(error, SyntaxError) and error.lineno else ""
        reason = shorten(error if not isinstance(error, SyntaxError) else ValueError(error.msg))
        raise UsageError(f"{path}: this is not Python{line}: {reason}. Correct it there.") from None
