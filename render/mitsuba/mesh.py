"""Surfaces as Mitsuba's meshes. Needs a started engine (`render.mitsuba.engine.Engine.start`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.scene.surface import Surface


def mesh(
    name: str,
    surface: Surface,
    material: Any,
    uv: NDArray[np.floating],
    medium: dict[str, Any] | None = None,
) -> Any:
    """Return a mesh for a scene.

    material  a BSDF, or its description
    uv        texture coordinates (V, 2), or (2,) for all; see `render.mitsuba.texture_coordinates`
    medium    description of the medium inside, or None
    """
    import mitsuba as mi

    properties = mi.Properties()
    properties["material"] = mi.load_dict(material) if isinstance(material, dict) else material
    if medium is not None:
        properties["interior"] = mi.load_dict(medium)
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
    values["vertex_texcoords"] = _ravel(np.broadcast_to(uv, (len(surface.vertices), 2)))
    values["faces"] = np.ascontiguousarray(surface.faces, dtype=np.uint32).ravel()
    values.update()
    for attribute, array in surface.attributes.items():
        made.add_attribute(f"vertex_{attribute}", array.shape[1], _ravel(array))
    return made


def _ravel(array: NDArray[Any]) -> Any:
    return np.ascontiguousarray(array, dtype=np.float32).ravel()
