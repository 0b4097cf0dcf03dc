"""A small picture of every flow of the catalogue: streamlines, or a block before and after."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from examples.drawing import COOL, FAINT, INK, PICTURES, WARM, save
from flowsculpt.pipeline.arrays import AnyArray, Points
from flowsculpt.pipeline.flow import Streamlines, VelocityField, keyed
from flowsculpt.pipeline.flow.catalogue import FLOWS
from flowsculpt.pipeline.flow.catalogue.basic import (
    DoubleGyre,
    Rotation,
    Scaling,
    Squeeze,
    Strain,
    Translation,
)
from flowsculpt.pipeline.flow.catalogue.deformations import Bend, Deformation
from flowsculpt.pipeline.flow.catalogue.lorenz import Lorenz
from flowsculpt.pipeline.flow.catalogue.sampled_field import Sampled
from flowsculpt.pipeline.plugins.attractors import attractor_flows as attractors
from flowsculpt.pipeline.plugins.contact.squash import Squash
from flowsculpt.pipeline.plugins.fields.attraction import Attraction, Target, Wind
from flowsculpt.pipeline.plugins.fields.curl_noise import CurlNoise
from flowsculpt.pipeline.plugins.fields.formula_field import FormulaField
from flowsculpt.pipeline.plugins.fields.grid_files import read_samples
from flowsculpt.pipeline.plugins.waves.wave_flows import Kneading, TaylorGreen
from flowsculpt.pipeline.shot import read_shot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE, REACH, SEEDS, STEPS = 1.6, 1.45, 260, 30
"""Width in inches, scene units from the middle to the edge, streamlines, and pieces of each."""

LINE_LENGTH = 0.8
"""Length of a streamline at common speed, scene units."""

SHOWN: dict[type, VelocityField] = {
    Translation: Translation((1.0, 0.4, 0.0)),
    Rotation: Rotation(),
    Scaling: Scaling(rate=(0.6, 0.2, -0.5)),
    Strain: Strain(),
    Squeeze: Squeeze(),
    DoubleGyre: DoubleGyre(scale=1.2),
}
"""Flows that do little by default, with the parameters of their pictures."""

ATTRACTORS = (Lorenz, attractors.Attractor)

OF_PLUGINS = (
    *(attractors.Rossler, attractors.Aizawa, attractors.Thomas),
    *(attractors.Chua, attractors.Halvorsen, attractors.Chen, TaylorGreen, Kneading),
)
"""Velocity fields of plug-ins whose parameters are numbers."""

CURVE = ((-1.3, -0.6, 0.0), (-0.5, 0.7, 0.4), (0.5, -0.4, -0.4), (1.3, 0.6, 0.0))

WRITTEN: tuple[VelocityField, ...] = (
    FormulaField(("-y - 0.5 * z", "x * cos(2 * z)", "0.4 * sin(3 * x)")),
    CurlNoise(octaves=2),
    Attraction(Target.curve(np.array(CURVE)), rate=4.0, radius=1.2),
    Wind(CURVE, radius=0.7),
)
"""Flows with parameters other than numbers; those of samples come from a file."""

AMOUNTS = {"twist": 0.9, "taper": -0.5, "stretch": 1.35, "shear": 0.6, "bend": 0.9}


def view(turn: float = 28.0, tilt: float = 22.0) -> AnyArray:
    """Return the (3, 2) projection from the scene to the picture, from the right and above; degrees."""
    a, e = math.radians(turn), math.radians(tilt)
    right = (math.cos(a), 0.0, -math.sin(a))
    up = (-math.sin(a) * math.sin(e), math.cos(e), -math.cos(a) * math.sin(e))
    return np.array([right, up]).T


def streamlines_of(field: VelocityField) -> AnyArray:
    """Return streamlines (STEPS + 1, N, 3) from all over a ball, LINE_LENGTH long at common speeds.

    Those of an attractor begin on it and are longer.
    """
    seeds = np.random.default_rng(1).normal(size=(SEEDS, 3))
    seeds *= (np.linspace(0.02, 1, SEEDS) ** (1 / 3) * 1.1 / np.linalg.norm(seeds, axis=1))[:, None]
    flow, duration, start = Streamlines(field), 0.0, seeds
    if isinstance(field, ATTRACTORS):
        start, duration = _displace(flow, 0.3 * seeds[:24] + 0.1), 6 * LINE_LENGTH
    speeds = np.linalg.norm(field.velocity(start, 0.3), axis=1)
    dt = max(duration, LINE_LENGTH) / float(np.quantile(speeds, 0.6)) / (STEPS * (8 if duration else 1))
    places = [start]
    for step in range(STEPS * (8 if duration else 1)):
        places.append(flow.displace(places[-1], 0.3 + step * dt, dt))
    return np.stack(places)


def _displace(flow: Streamlines, points: Points) -> Points:
    return flow.displace(points, 0.0, 60.0 / flow.field.gradient_bound(0.0))


def _draw_streamlines(panel: Axes, places: AnyArray, seen: AnyArray) -> None:
    """Draw streamlines that begin faint and thin, and end dark and thick; far ones first."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgb

    towards = np.cross(seen[:, 0], seen[:, 1])
    order = np.argsort((places @ towards).mean(axis=0))
    flat = (places @ seen)[:, order]
    pieces = np.stack([flat[:-1], flat[1:]], axis=2).reshape(-1, 2, 2)
    age = np.linspace(0.05, 1, len(places) - 1).repeat(places.shape[1])
    colours = np.array([*to_rgb(COOL), 0.0]) + age[:, None] * np.array([0, 0, 0, 0.85])
    panel.add_collection(LineCollection(list(pieces), colors=colours, linewidths=0.25 + 0.9 * age))


def _fit_axes(panel: Axes, least: float) -> None:
    """Fit the axes to all streamlines. least: from the middle to the edge"""
    (strands,) = panel.collections
    points = np.concatenate([path.vertices for path in strands.get_paths()])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, max(least, 1.05 * (high - low).max() / 2)
    panel.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))


def _draw_block(panel: Axes, flow: Any, seen: AnyArray) -> None:
    """Draw the lines on the faces of a block, before and after."""
    amount = AMOUNTS[flow.name]
    moving = replace(flow, amount=keyed((0.0, 1.0), (1.0 if flow.name == "stretch" else 0.0, amount)))
    for points in _block_lines():
        panel.plot(*(points @ seen).T, color=FAINT, linewidth=0.7)
    for points in _block_lines():
        moved = moving.displace(points, 0.0, 1.0)
        on_edge = np.isclose(np.abs(points), (0.4, 0.9, 0.4)).all(axis=0).sum() >= 2
        panel.plot(*(moved @ seen).T, color=INK if on_edge else WARM, linewidth=1.0 if on_edge else 0.5)


def _draw_contact() -> None:
    """Draw the block before, and as a floor squashes it."""
    _draw_map("contact", Squash.of(-0.45, 0.9, 0.001, -0.9).apply)


LATE = {
    "move": [
        "- move: {turn: {ease: linear, keys: {0s: 0, 1s: -69}}, axis: z, centre: [0, -0.9, 0], lag: 0.45}"
    ],
    "lag": [
        "- bend: {centre: [0, -0.9, 0], length: 3.6, amount: {keys: {0s: 0, 0.4s: 28, 0.8s: -46}}}",
        "- lag: {seconds: 0.4, leads: [0, -0.9, 0]}",
    ],
}
"""Entries of flows whose far parts are late."""


def _draw_late(name: str) -> None:
    """Draw the block before, and as it is thrown over, or bends, with its top late."""
    block = "frames: 1-25\nresample: off\nsubject: {solid: box, size: [0.8, 1.8, 0.8]}"
    flow = read_shot("a.yaml", "\n".join([f"title: A\n{block}\nflows:", *LATE[name]])).motion.flow
    _draw_map(name, lambda points: flow.displace(points, 0.0, 0.8))


def _draw_map(name: str, moved: Callable[[Points], Points]) -> None:
    """Draw the block before and after a map."""
    panel, figure = _panel()
    for points in _block_lines():
        panel.plot(*(points @ view()).T, color=FAINT, linewidth=0.7)
    for points in _block_lines():
        panel.plot(*(moved(points) @ view()).T, color=WARM, linewidth=0.6)
    save(figure, f"flows/{name}.png")


def _block_lines(across: float = 0.4, high: float = 0.9) -> list[Points]:
    t = np.linspace(-1, 1, 61)[:, None]
    marks = np.linspace(-across, across, 5)
    upright = [
        np.hstack([x + 0 * t, high * t, z + 0 * t])
        for x in marks
        for z in marks
        if max(abs(x), abs(z)) == across
    ]
    corners = across * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    ring = np.concatenate([np.linspace(a, b, 21) for a, b in pairwise(corners)])
    level = [
        np.stack([ring[:, 0], np.full(len(ring), y), ring[:, 1]], axis=1)
        for y in np.linspace(-high, high, 10)
    ]
    return upright + level


def _random_samples() -> Sampled:
    """Return random velocities on a coarse grid."""
    axis = np.linspace(-1.5, 1.5, 4)
    velocity = np.random.default_rng(7).normal(size=(4, 4, 4, 3))
    with TemporaryDirectory() as folder:
        file = Path(folder) / "dice.npz"
        np.savez(file, x=axis, y=axis, z=axis, velocity=velocity)
        samples = read_samples((file,)).samples
    return Sampled(samples, between="cubic")


def draw() -> None:
    """Draw all flows to `docs/pictures/flows`."""
    (PICTURES / "flows").mkdir(exist_ok=True)
    for kind in (*FLOWS, *OF_PLUGINS):
        _draw(SHOWN[kind] if kind in SHOWN else Bend(length=1.8) if kind is Bend else kind())
    for field in (*WRITTEN, _random_samples()):
        _draw(field)
    _draw_contact()
    for name in LATE:
        _draw_late(name)


def _panel() -> tuple[Axes, Figure]:
    """Return empty axes that fill a figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(SIZE, SIZE), facecolor="white")
    FigureCanvasAgg(figure)
    panel = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    panel.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH), aspect="equal")
    panel.set_axis_off()
    return panel, figure


def _draw(flow: VelocityField | Deformation) -> None:
    panel, figure = _panel()
    seen = view(0.0, 0.0) if isinstance(flow, DoubleGyre) else view()
    if isinstance(flow, Deformation):
        _draw_block(panel, flow, seen)
    else:
        _draw_streamlines(panel, streamlines_of(flow), seen)
        _fit_axes(panel, 0.0 if isinstance(flow, ATTRACTORS) else REACH)
    save(figure, f"flows/{flow.name}.png")


if __name__ == "__main__":
    draw()
