"""How pictures are shown: from linear light to display values and pixels, by an exposure and a view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.post.view import ACES, ColourView

if TYPE_CHECKING:
    from flowsculpt.render.post.colour import ViewTable


@dataclass(frozen=True)
class PictureDisplay:
    """The exposure (stops) and the view by which pictures are shown.

    Displays are rec709 (movies), srgb (pages), and pq and hlg (high dynamic range). Methods raise
    BadInputError for others, and where the view cannot be computed.
    """

    exposure: float = 0.0
    view: ColourView = ACES

    @property
    def data(self) -> dict[str, Any]:
        """Everything that decides the colours, as plain data."""
        return {"exposure": self.exposure, "view": self.view.recipe}

    def values(self, light: NDArray[np.float32], display: str = "rec709") -> NDArray[np.float32]:
        """Return the display values 0 … 1 of light (H, W, 3) in the view's working space."""
        from flowsculpt.render.post.colour import to_display  # imports numba, which takes long

        return to_display(light, self.exposure, display, self.view)

    def pixels(self, light: NDArray[np.float32], display: str = "rec709", bits: int = 16) -> NDArray[Any]:
        """Return the same as uint16, or as uint8 where `bits` is 8, dithered."""
        from flowsculpt.render.post.colour import quantise

        return quantise(self.values(light, display), bits)

    def table(self, display: str = "srgb") -> ViewTable:
        """Return the view, without the exposure, as a table for programs that show light themselves."""
        from flowsculpt.render.post.colour import view_table

        return view_table(display, self.view)
