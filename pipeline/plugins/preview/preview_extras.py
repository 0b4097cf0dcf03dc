"""Gives `schema` the model of takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flowsculpt.api import ShotExtras

if TYPE_CHECKING:
    from pydantic import BaseModel


class PreviewExtras(ShotExtras):
    """The takes that were performed of a shot."""

    def schemas(self) -> dict[str, type[BaseModel]]:
        from flowsculpt.pipeline.plugins.preview.performed_takes import Take

        return {"take": Take}
