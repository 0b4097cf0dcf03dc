"""Makes the animation that the review page plays."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flowsculpt.api import Animation, ShotExtras

if TYPE_CHECKING:
    from flowsculpt.api.frames import RenderRequest, Store


class InterchangeExtras(ShotExtras):
    """The motion of a shot as glTF."""

    def animation(self, request: RenderRequest, store: Store, most_vertices: int) -> Animation:
        from flowsculpt.pipeline.plugins.interchange.animation_export import animation

        return animation(request, store, most_vertices)
