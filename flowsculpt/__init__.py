"""Shapes that flow like putty: the library's public names, each imported from its module when first used.

    from flowsculpt import Resampler, Thresholds, icosphere

Everything else lies in the packages `flowsculpt.pipeline` and `flowsculpt.render`, and may change with any
version.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flowsculpt.pipeline.mesh import TriangleMesh as TriangleMesh
    from flowsculpt.pipeline.mesh import box as box
    from flowsculpt.pipeline.mesh import icosphere as icosphere
    from flowsculpt.pipeline.resample import Resampler as Resampler
    from flowsculpt.pipeline.resample import Thresholds as Thresholds
    from flowsculpt.pipeline.resample import resample as resample

_HERE = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120  # a Path takes time to import
if not os.path.exists(os.path.join(_HERE, "render", "__init__.py")):  # noqa: PTH110, PTH118
    __path__.append(os.path.dirname(_HERE))  # noqa: PTH120  # in a checkout they lie beside this folder

_MODULES = {
    "flowsculpt.pipeline.mesh": ("TriangleMesh", "box", "icosphere"),
    "flowsculpt.pipeline.resample": ("Resampler", "Thresholds", "resample"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)
