"""Arrays become Mitsuba's meshes. The one module that knows them.

An engine must have been started (`render.mitsuba.engine.Engine.start`) before anything here is called.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.scene.surface import Surface


def mesh(
    name: str,
    surface: Surface,
    material: Any,
    marks: NDArray[np.floating],
    filling: dict[str, Any] | None = None,
) -> Any:
    """A shape of a scene.

    material  described, or made
    marks     (V, 2) texture coordinates, or one for all; see `render.mitsuba.texture_coordinates`
    """
    import mitsuba as mi

    properties = mi.Properties()
    properties["material"] = mi.load_dict(material) if isinstance(material, dict) else material
    if filling is not None:
        properties["interior"] = mi.load_dict(filling)
    made = mi.Mesh(
        name,
        vertex_count=len(surface.vertices),
        face_count=len(surface.faces),
        has_vertex_normals=True,
        has_vertex_texcoords=True,
        props=properties,
    )
    values = mi.traverse(made)
    values["vertex_positions"] = _ravel(surface.vertices)
    values["vertex_normals"] = _ravel(surface.normals)
    values["vertex_texcoords"] = _ravel(np.broadcast_to(marks, (len(surface.vertices), 2)))
    values["faces"] = np.ascontiguousarray(surface.faces, dtype=np.uint32).ravel()
    values.update()
    for attribute, array in surface.attributes.items():
        made.add_attribute(f"vertex_{attribute}", array.shape[1], _ravel(array))
    return made


def _ravel(array: NDArray[Any]) -> Any:
    return np.ascontiguousarray(array, dtype=np.float32).ravel()
