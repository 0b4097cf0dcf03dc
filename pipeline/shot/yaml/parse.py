"""A file as a document, or everything that is wrong with it, each with line and column."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import ValidationError

from pipeline.errors import FlowsculptError, MissingInputError, ShotError
from pipeline.shot.documents.fields import Document
from pipeline.shot.yaml.messages import findings
from pipeline.shot.yaml.source import Source, Where

D = TypeVar("D", bound=Document)


def parsed(
    source: Source,
    kind: type[D],
    problems: list[tuple[Where, str]],
    missing: list[tuple[Where, str]],
    failed: list[FlowsculptError] | None = None,
    context: Mapping[str, Any] | None = None,
) -> D:
    """The file as a document, or all problems together; only missing files make a MissingInputError."""
    wrong, document = [*source.problems, *problems], None
    try:
        document = kind.model_validate(source.data, context=dict(context or {}))
    except ValidationError as error:
        wrong += findings(error, source, kind)
    told = {where for where, _ in wrong}
    absent = [f"{source.place(where)}: {text}" for where, text in missing if where not in told]
    others = failed or []
    absent += [str(error) for error in others if isinstance(error, MissingInputError)]
    lines = [
        f"{source.place(where)}: {text}"
        for where, text in sorted(wrong, key=lambda problem: source.order(problem[0]))
    ]
    lines += [line for error in others if isinstance(error, ShotError) for line in error.messages]
    if lines:
        raise ShotError(*dict.fromkeys([*lines, *absent]))
    if absent:
        raise MissingInputError("\n".join(absent))
    assert document is not None
    return document
