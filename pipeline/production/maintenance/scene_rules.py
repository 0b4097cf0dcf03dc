"""Rules for a shot's scene, beyond the form of its file: vertices, edges, camera, size and precision."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.animation.fit_remedy import COARSE, FINE, TYPICAL_EXTENT, fit_remedy, is_usual_size
from pipeline.arrays import Points
from pipeline.mesh.parts import find_small_parts
from pipeline.production.maintenance.finding import Finding, sampled_frames
from pipeline.production.maintenance.first_frame import FirstFrame
from pipeline.production.maintenance.flow_rules import (
    acts_elsewhere,
    deforms_nothing,
    grows,
    stretches,
    takes_long,
)
from pipeline.production.render_inputs.framing import frame_all
from pipeline.shot import Shot
from pipeline.shot.model_subjects import Model

SINGLE_PRECISION = 2.0**-24
"""The relative error of the positions that are rendered."""


def findings(shot: Shot, first: FirstFrame) -> list[Finding]:
    """Return all findings about a shot with this first frame."""
    rules = (
        _budget,
        _edges,
        _camera,
        _size,
        _parts,
        _openness,
        acts_elsewhere,
        deforms_nothing,
        _precision,
        _coordinates,
        takes_long,
        stretches,
    )
    found = [finding for rule in rules for finding in rule(shot, first)]
    if not any(finding.where[0] == "flows" for finding in found):  # their remedies change the growth
        found += grows(shot, first)
    return found


def _budget(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that the first frame has no more vertices than the shot allows."""
    resampling = shot.motion.resampling
    if first.exceeds and resampling is not None and first.longest is not None:
        budget = resampling.thresholds.max_vertices
        more = 10 ** math.ceil(math.log10(2.0 * max(first.vertices, budget)))
        fits = rounded_up(first.longest * math.sqrt(4.0 * first.vertices / budget))
        fit = fit_remedy(shot.motion, first.extent) if _should_fit(shot, first) else ""
        remedy = fit or f"max_edge_length: {fits:g}, or max_vertices: {more}"
        yield Finding(
            ("resample", "max_edge_length"),
            f"max_edge_length {first.longest:g} takes about {first.vertices:,} vertices on frame "
            f"{shot.frames.first}, for a subject {first.extent:.3g} units large; max_vertices is {budget:,}. "
            f"Write {remedy}.",
            is_error=True,
        )


def _edges(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that edges are short against the subject. Polyhedra are meant to have few.

    A model to be fitted has another size then.
    """
    resampling = shot.motion.resampling_at(shot.frames.first)
    if resampling is None or resampling.method != "triangles" or _should_fit(shot, first):
        return
    longest = resampling.thresholds.max_edge_length
    if isinstance(longest, float) and longest > first.extent / COARSE * (1.0 + 1e-9):
        yield Finding(
            ("resample", "max_edge_length"),
            f"max_edge_length {longest:g} is coarse for a subject {first.extent:.3g} units large: over "
            f"1/{COARSE} of its largest extent. Write max_edge_length: {rounded(first.extent / FINE):g}.",
        )


def _camera(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that the camera is outside of the subject."""
    camera = shot.picture.camera
    if camera.position is None and camera.distance is None and camera.dolly == 1.0:
        return  # framing keeps it outside
    if shot.subject and camera.position is None:
        return  # it aims at all of several subjects
    setting = next(name for name in ("position", "distance", "dolly") if _is_set(camera, name))
    aspect = shot.picture.qualities["draft"].aspect
    for number in sampled_frames(shot):
        view = camera.at(shot.motion.clock.time(number))
        (framing,) = frame_all([view], lambda _: first.points, aspect)
        if is_inside(np.array(framing.camera.origin), first):
            when = "" if number == shot.frames.first else f", where it was on frame {shot.frames.first}"
            at = ", ".join(f"{x:.3g}" for x in framing.camera.origin)
            yield Finding(
                ("camera", setting),
                f"on frame {number} the camera is inside the subject{when}: it is at ({at}). Move it "
                f"outside, or leave {setting} out.",
            )
            return


def _is_set(camera: Any, name: str) -> bool:
    return getattr(camera, name) not in (None, 1.0)


def _size(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that a model has about the size that flows and looks are made for."""
    if _should_fit(shot, first) and not first.exceeds:
        fit = fit_remedy(shot.motion, first.extent)
        yield Finding(
            ("subject", "model"),
            f"the model is {first.extent:.3g} units large; flows and looks are made for about "
            f"{TYPICAL_EXTENT:g}. Write {fit}, or choose max_edge_length and the lengths of the flows for "
            "this size.",
        )


def _parts(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that no small parts decide the size of a model."""
    subject = shot.motion.subject
    if isinstance(subject, Model) and (parts := find_small_parts(subject.imported().mesh)) is not None:
        yield Finding(("subject", "model"), f"{subject.path.name} has {parts}")


def _openness(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that the surface is closed if light goes into it."""
    look = shot.picture.look
    goes_in = look.model in ("glass", "smoke") or getattr(look, "subsurface", None) is not None
    if not goes_in or not len(first.faces):
        return
    sides = np.sort(np.concatenate([first.faces[:, [0, 1]], first.faces[:, [1, 2]], first.faces[:, [2, 0]]]))
    edges, counts = np.unique(sides, axis=0, return_counts=True)
    boundary = edges[counts == 1]
    if len(boundary):
        at = ", ".join(f"{x:.3g}" for x in first.points[boundary[0]].mean(axis=0))
        yield Finding(
            ("look",),
            f"the surface is open: it has {len(boundary):,} boundary edges on frame {shot.frames.first}, the "
            f"first at ({at}). Glass, honey, smoke and subsurface need a closed one; the picture will be "
            "wrong. Close the surface, or choose another look, such as look: glaze.",
        )


def _should_fit(shot: Shot, first: FirstFrame) -> bool:
    """Tell whether fitting the subject gives it a usual size."""
    return bool(fit_remedy(shot.motion, first.extent)) and not is_usual_size(first.extent)


def _precision(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that renderers, which compute in single precision, resolve the subject where it is."""
    detail, fit = first.extent / 1000.0, fit_remedy(shot.motion, first.extent)
    if float(np.abs(first.middle).max()) * SINGLE_PRECISION > 0.1 * detail:
        yield Finding(
            ("subject",),
            f"the subject is {np.abs(first.middle).max():.3g} units from the origin and {first.extent:.3g} "
            "large; pictures resolve positions to a 16-millionth of their distance from the origin. "
            f"{f'Write {fit}, which moves it there' if fit else 'Move it nearer'}.",
        )


def _coordinates(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that the file of a model holds its detail where the model lies."""
    if isinstance(subject := shot.motion.subject, Model):
        yield from (Finding(("subject", "model"), line) for line in subject.rounded_coordinates())


def is_inside(point: Points, first: FirstFrame) -> bool:
    """Tell whether a point (3,) is inside of a closed surface: by the solid angle that its faces fill."""
    low, high = first.points.min(axis=0), first.points.max(axis=0)
    if not len(first.faces) or not ((point > low) & (point < high)).all():
        return False
    a, b, c = (first.points[corner] - point for corner in first.faces.T)
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    turns = float(np.arctan2(volume, below).sum()) / (2.0 * math.pi)
    return abs(turns) > 0.5


def rounded(value: float) -> float:
    """Return a value with two digits."""
    return float(f"{value:.2g}")


def rounded_up(value: float) -> float:
    """Return the least number with two digits that is not below a value."""
    unit_of_last = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit_of_last) * unit_of_last:.2g}")
