"""The flows that a shot can name, each with the document of what it takes: the one list of them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from pipeline.flow import catalogue
from pipeline.flow.parameters import shot_name
from pipeline.shot.documents.generated import FlowParameters, document_of
from pipeline.shot.documents.special_flows import OWN

BARE = BeforeValidator(lambda value: {} if value is None else value)
"""`- enright:` is the same as `- enright: {}`."""

DOCUMENTS: dict[str, type[FlowParameters]] = {
    **{shot_name(flow): document_of(flow) for flow in catalogue.FLOWS},
    **{name: document_of(base.flow, base) for name, base in OWN.items()},
}


def entries(base: type) -> dict[str, Any]:
    """Fields of a document, one for each flow that is a `base`, all of them optional."""
    return {
        name: (Annotated[document | None, BARE], Field(None, validate_default=False))
        for name, document in DOCUMENTS.items()
        if issubclass(document.flow, base)
    }
