"""Palettes: rows of colours that show numbers, by name or made of a few colours."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.serialise import Triple
from flowsculpt.render.scene.rgb_spaces import linear_of_srgb, srgb_of_linear

_OF_MATPLOTLIB = ("viridis", "plasma", "inferno", "magma", "cividis", "turbo", "coolwarm")
"""viridis, plasma, inferno, magma (N. Smith and S. van der Walt, 2015) and cividis (J. Nuñez et al., PLOS ONE
13(7), 2018) grow lighter with the number, by equal perceived steps; turbo (A. Mikhailov, 2019) is a smooth
rainbow; coolwarm (K. Moreland, *Diverging Color Maps for Scientific Visualization*, 2009) is for numbers on
both sides of a middle."""

_OF_CMOCEAN = (
    *("thermal", "haline", "solar", "ice", "gray", "oxy", "deep", "dense", "algae", "matter", "turbid"),
    *("speed", "amp", "tempo", "rain", "phase", "topo", "balance", "delta", "curl", "diff", "tarn"),
)
"""K. Thyng et al., *True colors of oceanography*, Oceanography 29(3), 2016. Steps are perceived as equal."""

REVERSED = "_r"
"""The end of the name of a palette that runs backwards."""

COLOUR_MAPS = (*_OF_MATPLOTLIB, *_OF_CMOCEAN)
"""Names of palettes."""

DIVERGING = ("coolwarm", "balance", "delta", "curl", "diff", "tarn", "topo")
"""Palettes with a middle, which stands for a number of its own, mostly 0."""

_COUNT = 256


def is_diverging(name: str) -> bool:
    """Tell whether a palette has a middle."""
    return name.removesuffix(REVERSED) in DIVERGING


def require_installed(name: str) -> Path | None:
    """Return the file of a palette of cmocean; None for others. Raises BadInputError where it is missing."""
    plain = name.removesuffix(REVERSED)
    if plain not in _OF_CMOCEAN:
        return None
    found = find_spec("cmocean")
    if found is None or found.origin is None:
        raise BadInputError(
            f"palette {plain} is one of cmocean's, which is not installed. Install flowsculpt[fields] or "
            f"take one of {', '.join(_OF_MATPLOTLIB[:5])}"
        )
    return Path(found.origin).parent / "rgb" / f"{plain}-rgb.txt"


@cache
def colour_map(name: str) -> NDArray[np.float32]:
    """Return linear Rec.709 reflectances (256, 3) of a palette, from the lowest number to the highest.

    Raises BadInputError where it is one of cmocean's, and that is not installed.
    """
    plain, table = name.removesuffix(REVERSED), require_installed(name)
    srgb = _of_matplotlib(plain) if table is None else _of_cmocean(table)
    return _row(srgb if plain == name else srgb[::-1])


@cache
def blended(colours: tuple[Triple, ...]) -> NDArray[np.float32]:
    """Return linear Rec.709 reflectances (256, 3) that go evenly, in sRGB, from colour to colour."""
    stops, places = srgb_of_linear(np.array(colours)), np.linspace(0.0, 1.0, _COUNT)
    knots = np.linspace(0.0, 1.0, len(colours))
    return _row(np.stack([np.interp(places, knots, part) for part in stops.T], axis=1))


def _row(srgb: NDArray[np.floating]) -> NDArray[np.float32]:
    linear = linear_of_srgb(np.asarray(srgb, np.float64)).astype(np.float32)
    linear.setflags(write=False)
    return linear


def _of_matplotlib(name: str) -> NDArray[np.floating]:
    from matplotlib import colormaps

    return np.asarray(colormaps[name](np.linspace(0.0, 1.0, _COUNT)))[:, :3]


def _of_cmocean(file: Path) -> NDArray[np.floating]:
    """Read the table of a palette, sRGB; importing the package takes matplotlib, whose versions it lags."""
    table = np.loadtxt(file)
    places = np.linspace(0.0, len(table) - 1.0, _COUNT)
    return np.stack([np.interp(places, np.arange(len(table)), part) for part in table.T], axis=1)
