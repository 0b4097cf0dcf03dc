"""Warns of surfaces that grow out of hand, before they are simulated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flowsculpt.api import ShotExtras

if TYPE_CHECKING:
    from flowsculpt.api.frames import RenderRequest


class AuthoringExtras(ShotExtras):
    """The growth of a shot's surfaces."""

    def warnings(self, request: RenderRequest, last: int) -> Iterator[str]:
        from flowsculpt.pipeline.plugins.authoring.growth_forecast import GrowthForecast

        for part in request.shot.parts:
            forecast = GrowthForecast.at_rest(part.motion, last)
            if forecast is not None and (warning := forecast.warning()):
                yield warning[1]
