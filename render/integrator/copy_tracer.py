"""The copy tracer: which copy of a subject each sample of the picture sees, by the rays of the path tracer.

Importing this imports Mitsuba, so an engine of a compiled variant must have been started.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from render.integrator.path import camera_vertex
from render.integrator.path_tracer import film_pixels
from render.integrator.sampler import OwenSampler
from render.scene.aovs import COPY


@dataclass(frozen=True, eq=False)
class CopyTracer:
    """A tracer of the copies that the lens sees in one scene.

    integrator     Mitsuba's, which is used only to look past hidden emitters
    hide_emitters  True if the lens sees neither emitters nor the sky
    shapes         pointers to the shapes of subjects with copies, whose vertices have the attribute COPY
    """

    scene: Any
    integrator: Any
    hide_emitters: bool
    shapes: Sequence[Any]

    def render(
        self, samples: int, first: int, seed: int, pixels: NDArray[np.integer[Any]] | None = None
    ) -> NDArray[np.int32]:
        """Return the number of the copy (pixels, samples) that each sample sees, 0 where it sees none.

        The arguments are those of `PathTracer.render`, and so are the rays.
        """
        film = self.scene.sensors()[0].film()
        number, corner, size = film_pixels(film, pixels)
        sampler = OwenSampler(number, first, samples, seed)
        seen = []
        for sample in range(samples):
            sampler.sample = dr.opaque(mi.UInt32, sample)  # one compiled kernel for all samples
            seen.append(np.array(self._copy(sampler, corner, size), dtype=np.int32))
        dr.flush_malloc_cache()
        return np.stack(seen, axis=1)

    def _copy(self, sampler: OwenSampler, corner: Any, size: Any) -> Any:
        si, _ = camera_vertex(self, sampler, corner, size)
        is_on = mi.Bool(False)
        for shape in self.shapes:
            is_on |= si.shape == shape
        is_on &= si.is_valid()
        value = si.shape.eval_attribute_1(f"vertex_{COPY}", si, is_on)
        return dr.select(is_on, mi.UInt32(dr.round(value)), 0)
