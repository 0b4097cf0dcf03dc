"""How each flow is staged to begin with: on what, how strongly and when, in the words of shot files.

Values that a flow is not given here are its defaults. Flows that are not in the table are staged by what
their parameters are called.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.shot.documents.flow_catalogue import facts

FRAMES = 72

STRENGTHS = ("time_scale", "strength", "speed", "rate", "amount", "flux")
"""What says how much a flow does, where it is not in the table."""


@dataclass(frozen=True)
class Staging:
    """A flow on a subject that suits it.

    subject, resample, look  as in a shot file
    values                   parameters of the flow as in a shot file; others take their defaults
    within                   a region that the flow is limited to, where it would move everything alike
    beside                   the ending and the maker of a file that the flow reads: `beside[1](path)`
    azimuth                  of the camera, degrees, at the first and the last frame
    """

    subject: str = "{solid: icosphere, radius: 1}"
    values: Mapping[str, str] = field(default_factory=dict)
    max_edge_length: float = 0.08
    look: str = "clay"
    within: str = ""
    beside: tuple[str, Callable[[Path], None]] | None = None
    azimuth: tuple[float, float] = (-30.0, 0.0)


def there_and_back(strength: str, rest: str = "0") -> str:
    """From nothing to a strength, and back to nothing in the end."""
    quarter = FRAMES // 4
    keys = f"1: {rest}, {quarter}: {strength}, {FRAMES - quarter}: {strength}, {FRAMES}: {rest}"
    return f"{{keys: {{{keys}}}}}"


def towards(amount: str, rest: str = "0") -> str:
    """From rest to an amount, with time to look at it."""
    return f"{{ease: sine_in_out, keys: {{1: {rest}, {FRAMES - 8}: {amount}}}}}"


BLOCK, SLAB, TOWER = (f"{{solid: box, size: [{size}]}}" for size in ("2, 2, 2", "2.2, 0.6, 2.2", "1, 3, 1"))
ROD = "{solid: rod, length: 3.2, radius: 0.5}"
SMALL = "{solid: icosphere, radius: 0.6}"


def _attractor(speed: str, look: str = "glaze", subject: str = "{solid: icosphere, radius: 1}") -> Staging:
    return Staging(subject, {"time_scale": there_and_back(speed)}, 0.09, look)


def _samples(path: Path) -> None:
    """Velocities on a grid, here of two eddies: yours come from a simulation."""
    axis = np.linspace(-1.5, 1.5, 13)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    velocity = np.stack([-np.sin(2 * y), np.sin(2 * x), 0.3 * np.cos(2 * x) + 0.0 * z], axis=-1)
    with path.open("wb") as file:
        np.savez_compressed(file, x=axis, y=axis, z=axis, velocity=velocity)


_FUNCTION = '''\
"""A flow of one's own: it moves each point by itself, whatever the others do."""

import numpy as np


def swirl(points, time, dt):
    """Where points (N, 3) are `dt` seconds after `time`, seconds from the start of the shot."""
    x, y, z = points.T
    turn = dt * 1.2 * np.sin(np.pi * time / 3.0) * np.exp(-(x**2) - z**2 + 0.5 * y)
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([c * x + s * z, y, c * z - s * x], axis=1)
'''


def _function(path: Path) -> None:
    path.write_text(_FUNCTION, encoding="utf-8")


STAGED: Mapping[str, Staging] = {
    "translation": Staging(
        BLOCK,
        {"rate": there_and_back("[0, 0.7, 0]", "[0, 0, 0]")},
        within="{sphere: {centre: [0.5, 1, 0.5], radius: 0.4}, falloff: 0.9}",
    ),
    "rotation": Staging(
        TOWER,
        {"speed": there_and_back("70")},
        within="{half_space: {centre: [0, 0.4, 0], normal: [0, -1, 0]}, falloff: 1.2}",
    ),
    "scaling": Staging(
        ROD,
        {"centre": "[0, 0.9, 0]", "rate": there_and_back("[0.5, 0, 0.5]", "[0, 0, 0]")},
        within="{sphere: {centre: [0, 0.9, 0], radius: 0.4}, falloff: 0.8}",
        look="pearl",
    ),
    "strain": Staging(BLOCK, {"rate": there_and_back("0.4")}, look="taffy"),
    "squeeze": Staging(ROD, {"rate": there_and_back("0.5")}, look="taffy"),
    "kneading": Staging(
        "{solid: icosphere, radius: 1}", {"amount": there_and_back("0.9")}, 0.07, look="taffy"
    ),
    "vortex": Staging(BLOCK, {"radius": "0.8", "strength": there_and_back("5"), "centre": "[0.5, 0.3, 0]"}),
    "vortex_pair": Staging(BLOCK, {"strength": there_and_back("5")}),
    "vortex_ring": Staging(SLAB, {"radius": "0.8", "strength": there_and_back("2.5")}, 0.07, "pearl"),
    "spiral_vortex": Staging(SLAB, {"strength": there_and_back("4"), "inflow": there_and_back("0.3")}),
    "source": Staging(BLOCK, {"centre": "[0.5, 0.5, 0.5]", "flux": there_and_back("3")}, 0.1),
    "sink": Staging(BLOCK, {"centre": "[0.3, 1.3, 0.3]", "flux": there_and_back("0.8")}),
    "expansion": Staging(
        BLOCK, {"centre": "[0.6, 0.6, 0.6]", "radius": "0.9", "rate": there_and_back("0.6")}
    ),
    "abc": Staging(
        "{solid: icosphere, radius: 1}",
        {"a": there_and_back("0.8"), "b": there_and_back("0.65"), "c": there_and_back("0.46")},
        look="pearl",
    ),
    "taylor_green": Staging(
        "{solid: icosphere, radius: 0.9}",
        {"centre": "[0.2, 0, 0.1]", "speed": there_and_back("0.8")},
        look="glaze",
    ),
    "double_gyre": Staging("{solid: box, size: [1.8, 0.8, 0.4]}", {"speed": there_and_back("0.5")}, 0.06),
    "enright": Staging(
        "{solid: icosphere, radius: 0.3}", {"centre": "[0.3, 0.3, 0.3]"}, 0.03, "glaze", azimuth=(-60, -20)
    ),
    "lorenz": Staging(
        "{solid: icosphere, radius: 1}",
        {"scale": "16", "time_scale": there_and_back("0.12")},
        0.09,
        "glaze",
        azimuth=(5, 40),
    ),
    "rossler": _attractor("0.5", "chrome", "{solid: icosphere, radius: 0.4}"),
    "aizawa": _attractor("1", subject="{solid: icosphere, radius: 0.9}"),
    "thomas": _attractor("2.5", "pearl"),
    "chua": _attractor("0.35", subject=SMALL),
    "halvorsen": _attractor("0.25", "chrome", SMALL),
    "chen": _attractor("0.03", subject=SMALL),
    "twist": Staging(TOWER, {"amount": towards("80")}),
    "taper": Staging(BLOCK, {"amount": towards("0.7")}),
    "stretch": Staging(SMALL, {"amount": towards("2.4", "1")}, look="taffy"),
    "shear": Staging(BLOCK, {"amount": towards("0.8")}),
    "bend": Staging(ROD, {"amount": towards("70")}, look="taffy"),
    "formula": Staging(
        BLOCK,
        {
            "with": f"{{k: {there_and_back('1.5')}}}",
            "velocity": '["-k * y * exp(-z * z)", "k * x * exp(-z * z)", "0.3 * k * sin(2 * x)"]',
        },
    ),
    "curl_noise": Staging(
        "{solid: icosphere, radius: 1}",
        {"size": "0.9", "strength": there_and_back("0.45"), "octaves": "2"},
        look="pearl",
    ),
    "attraction": Staging(
        "{solid: icosphere, radius: 0.9}",
        {
            "points": "[[1.5, 0.4, 0], [-0.8, 1.3, 0.4], [0, -0.4, 1.6]]",
            "rate": there_and_back("0.9"),
            "radius": "1.4",
        },
        look="taffy",
    ),
    "wind": Staging(
        BLOCK,
        {
            "through": "[[-1.8, -0.4, 1.2], [0, 0.6, 0.4], [1.2, 1.2, -0.6]]",
            "speed": there_and_back("0.8"),
            "radius": "0.8",
        },
    ),
    "sampled": Staging(
        BLOCK, {"file": "NAME.npz", "strength": there_and_back("0.8")}, beside=(".npz", _samples)
    ),
    "python": Staging(
        TOWER,
        {"file": "NAME.py", "function": "swirl"},
        beside=(".py", _function),
    ),
}


def staging_of(flow: str) -> Staging:
    """How a flow is staged. Raises UsageError for a name that is not known."""
    fact = facts(flow)
    if flow in STAGED:
        return STAGED[flow]
    values = {}
    for parameter in fact["parameters"]:
        name, default = parameter["name"], parameter["default"]
        if not parameter["keyed"] or not (parameter["needed"] or name in STRENGTHS):
            continue
        if parameter["form"] == "vector":
            values[name] = there_and_back("[0.5, 0, 0]", "[0, 0, 0]")
        elif fact["kind"] == "map":
            values[name] = towards("2", "1") if parameter["above_nought"] else towards("0.5")
        else:
            rest = "0.01" if parameter["above_nought"] else "0"
            values[name] = there_and_back(f"{0.5 if default is None else default:g}", rest)
    return Staging(values=values)
