"""Names of array types; docstrings give the shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
"""float64, the type of all geometry in memory."""

Points = NDArray[np.float64]
"""(N, 3) positions in scene units."""

Vectors = NDArray[np.float64]
"""(N, 3) directions, normals or velocities."""

Faces = NDArray[np.int32]
"""(F, 3) vertex indices, counter-clockwise seen from outside."""

Indices = NDArray[np.int32]
"""int32: numbers of vertices, such as edges (E, 2)."""

AnyArray = NDArray[Any]
"""An array of any type."""
