"""Auxiliary features by Mitsuba's `aov` integrator, where our feature tracer cannot trace them.

The scalar variant compiles no code, and drawn materials bring a picture instead of light.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float64]

BLOCK_SIZE = 16
"""Pixels along a block of the scalar variant. Each block has its own random numbers; by default Mitsuba cuts
the picture by the number of threads."""

VERTEX_AOV = "dye"
"""Name of the vertex attribute (V, 3) that a scene of attributes shows."""

_WANTED = "albedo:albedo,depth:depth,position:position,normal:sh_normal,matte:uv"
_CHANNELS = {
    "albedo": slice(0, 3),
    "depth": slice(3, 4),
    "position": slice(4, 7),
    "normal": slice(7, 10),
    "matte": slice(11, 12),
}
"""Channels of each feature. The matte is the second texture coordinate."""


@dataclass(frozen=True, eq=False)
class MitsubaFeatures:
    """Mitsuba's features of one scene.

    attribute_scene  the scene with the attribute VERTEX_AOV as the albedo of subjects, or None
    attributes       by the name of an AOV, values (V, 3) of each subject's points by its shape's name
    """

    scene: Any
    attribute_scene: Any
    attributes: Mapping[str, Mapping[str, NDArray[np.float32]]]

    continues_sequence: ClassVar[bool] = False

    def render(self, samples: int, first: int, seed: int) -> dict[str, Picture]:
        """Return albedo, normal, position, depth, matte and attributes (H, W, channels) as means.

        samples  multijitter rounds them up
        first    samples that were taken before; they have no influence
        """
        picture = render(self.scene, load_integrator(_WANTED), samples, seed)
        features = {name: picture[..., channels] for name, channels in _CHANNELS.items()}
        return features | (self._attributes(samples, seed) if self.attributes else {})

    def _attributes(self, samples: int, seed: int) -> dict[str, Picture]:
        """Return means (H, W, 3) of attributes over the pixels, 0 where the subject is not.

        Mitsuba has an AOV for albedo, but none for attributes. A scene with the attribute as its subject's
        colour is rendered with the samples of the other features, so that coverage is the same. Minus the
        scene with the attribute 0, it shows the attribute alone.
        """
        integrator = load_integrator("albedo:albedo")

        def shown(values: Mapping[str, NDArray[np.float32]]) -> Picture:
            self._show(values)
            return render(self.attribute_scene, integrator, samples, seed)[..., :3]

        some = next(iter(self.attributes.values()))
        others = shown({shape: np.zeros_like(values) for shape, values in some.items()})
        return {name: shown(values) - others for name, values in self.attributes.items()}

    def _show(self, values: Mapping[str, NDArray[np.float32]]) -> None:
        import mitsuba as mi

        parameters = mi.traverse(self.attribute_scene)
        for shape, array in values.items():
            parameters[f"{shape}.vertex_{VERTEX_AOV}"] = np.ascontiguousarray(array, dtype=np.float32).ravel()
        parameters.update()


def load_integrator(aovs: str) -> Any:
    """Return Mitsuba's integrator of AOVs."""
    import mitsuba as mi

    description = {"type": "aov", "aovs": aovs, "block_size": BLOCK_SIZE}
    return mi.load_dict(description, parallel=False, optimize=False)


def render(scene: Any, integrator: Any, samples: int, seed: int) -> Picture:
    """Return means (H, W, channels) over `samples`, which multijitter rounds up."""
    import drjit as dr
    import mitsuba as mi

    rendered = mi.render(scene, integrator=integrator, spp=samples, seed=seed)
    picture = np.array(rendered, dtype=np.float64)
    dr.flush_malloc_cache()
    return picture
