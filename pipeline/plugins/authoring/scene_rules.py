"""Rules for a shot's scene, beyond the form of its file.

Vertices, edges, camera, size and precision; of the flows, where they act, how they stretch, and how long a
frame takes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from contextlib import suppress
from time import perf_counter
from typing import Any, NamedTuple

import numba
import numpy as np

from flowsculpt import Flow, FrameError, VelocityField
from flowsculpt.api.flows import MotionForecast, number_at, vector_at
from flowsculpt.api.frames import Framer
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import Model, Motion, Shot
from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrame, small_parts
from flowsculpt.pipeline.plugins.authoring.growth_forecast import GrowthForecast

Where = tuple[Any, ...]

SAMPLED_FRAMES = 8
"""Frames at which cameras and flows are checked."""


class Finding(NamedTuple):
    """Something that is wrong with a scene, or that should be known.

    where     the path of the setting in the shot file
    text      fact, rule and remedy
    is_error  True if a frame would fail
    """

    where: Where
    text: str
    is_error: bool = False


def sampled_frames(shot: Shot) -> list[int]:
    """Return up to SAMPLED_FRAMES frames, the first and the last among them."""
    frames = list(shot.frames)
    picks = np.linspace(0, len(frames) - 1, min(SAMPLED_FRAMES, len(frames))).round().astype(int)
    return [frames[k] for k in picks]


FAR_OFF = 5.0
"""Extents from a flow's centre to the middle of the subject: farther off it moves the subject as a whole."""

SLOW_SECONDS = 60.0
"""Seconds of a frame from which on its flow is named."""

STRETCH, STRETCHED = 2.0, 0.1
"""Length of edges over that of the frame before from which on a flow tears the surface apart, and the share
of the edges that are so long."""

MOST_MEASURED = 500
"""Sub-steps up to which edges are followed to measure their stretch."""

LOOP_GAP, LOOP_SAMPLE = 0.01, 1000
"""Distance, over the subject's size, from which on a loop jumps; and points that are followed, at most."""

FLOOR_SAMPLE, FLOOR_MOVES = 300, 20.0
"""Points that are followed, and thousandths of the subject's height by which a floor is seen to move."""

LONG, SAMPLE = 1e8, 256
"""Vertices × sub-steps from which on a frame may be slow, and vertices that are moved to find out."""


def acts_elsewhere(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that flows act where the subject is."""
    if not shot.motion.subject.is_surface:
        return
    time = shot.motion.clock.time(shot.frames.first)
    for k, flow in enumerate(shot.motion.flow.members):
        for name, offset in _offsets(flow, first.middle, time):
            sizes = float(np.linalg.norm(offset)) / first.extent
            if sizes <= FAR_OFF:
                continue
            middle = ", ".join(f"{x:.4g}" for x in first.middle)
            fit = MotionForecast(shot.motion).size_remedy(first.extent)
            fits = f"{fit}, which moves the model to the origin, or " if fit else ""
            yield Finding(
                ("flows", k),
                f"{name} acts about a place {sizes:.3g} times the size of the subject away from it. Write "
                f"{fits}centre: [{middle}] under {name}.",
            )
            break


def _deforms_nothing(shot: Shot, _: FirstFrame) -> Iterator[Finding]:
    """Check that the amount of a deformation changes."""
    for k, text in MotionForecast(shot.motion).constant_deformations():
        yield Finding(("flows", k), text)


def takes_long(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that flows take few enough sub-steps, and say where a frame takes long."""
    forecast, place, costs = MotionForecast(shot.motion), "", []
    for number in _moved_frames(shot):
        try:
            of_frame = forecast.costs(number, first.points)
            place = of_frame[0].place if of_frame else ""
            for each in of_frame:
                if each.gradient > each.MOST_SUBSTEPS:
                    each.flow.step_plan(*each.step)  # raises the error of the frame
        except FrameError as error:
            yield Finding(_where(place), str(error.of(number)), is_error=True)
            return
        if of_frame:
            costs.append((number, of_frame[0]))
    if not costs:
        return
    number, cost = max(costs, key=lambda item: item[1].substeps)
    where = _where(cost.place)
    if costs[0][1].length > cost.MOST_SUBSTEPS:
        number, cost = costs[0]
        most = f"{cost.MOST_SUBSTEPS} sub-steps are the most"
        yield Finding(where, f"frame {number} fails, for {most}: {cost}", True)
        return
    seconds = _seconds(shot, number, first, cost.substeps)
    if seconds > SLOW_SECONDS:
        yield Finding(where, f"frame {number} takes about {seconds:.0f} s: {cost}")


def stretches(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that no flow multiplies the length of edges in one frame: vertices grow in number alike."""
    motion = shot.motion
    if motion.resampling is None or not len(first.faces) or any(acts_elsewhere(shot, first)):
        return  # far from the subject a flow may well stretch it, which the other finding mends
    corners = first.points[first.faces[:: max(1, len(first.faces) // SAMPLE)][:SAMPLE]].reshape(-1, 3)
    for number in _moved_frames(shot):
        for k, flow in enumerate(motion.flow.members):
            try:
                if _substeps(motion, number, first, k) > MOST_MEASURED:
                    continue
                moved = motion.step_into(flow, number).apply(corners)
            except FrameError:
                continue  # `takes_long` tells what fails for certain
            ratio = float(np.quantile(_lengths(moved) / _lengths(corners), 1.0 - STRETCHED))
            if ratio > STRETCH:
                forecast = MotionForecast(motion)
                fit = "" if forecast.is_usual(first.extent) else forecast.size_remedy(first.extent)
                remedy = f"Write {fit}, lower" if fit else "Lower"
                yield Finding(
                    ("flows", k),
                    f"{flow.name} makes edges {ratio:.3g} times as long in the one frame {number}, so that "
                    f"vertices multiply and frames take long. {remedy} its amount or strength, or "
                    "spread its keys over more frames.",
                )
                return


def grows(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that the surface does not multiply in the course of the shot."""
    if first.exceeds:
        return
    if warning := GrowthForecast(shot.motion, first.points, first.faces, first.vertices).warning():
        place, text = warning
        yield Finding(_where(place), text)


def _lengths(corners: Floats) -> Floats:
    """Return the lengths of the edges of triangles, whose corners stand one after another."""
    triangles = corners.reshape(-1, 3, 3)
    lengths: Floats = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2) + 1e-300
    return lengths


def _substeps(motion: Motion, number: int, first: FirstFrame, k: int) -> float:
    """Return the most sub-steps of the flow with index k on the way into a frame; 0 of a map."""
    costs = MotionForecast(motion).costs(number, first.points)
    return max((cost.substeps for cost in costs if cost.place == motion.place_of_flow(k)), default=0.0)


def _moved_frames(shot: Shot) -> list[int]:
    """Return the first frame that a flow moves, and the sampled ones after it."""
    return list(dict.fromkeys([*list(shot.frames)[1:2], *sampled_frames(shot)[1:]]))


def _where(place: str) -> Where:
    """Return the path of `flows.0`; of all flows for an empty place."""
    return tuple(int(step) if step.isdigit() else step for step in place.split(".")) if place else ("flows",)


def _seconds(shot: Shot, number: int, first: FirstFrame, substeps: float) -> float:
    """Return about how long the flow into a frame takes: a few vertices are moved for it."""
    resampling = shot.motion.resampling
    carries = resampling is not None and resampling.placement == "exact" and resampling.normals == "carried"
    moved = first.vertices * (3 if carries else 1)
    if moved * substeps < LONG:
        return 0.0
    sample = first.points[:: max(1, len(first.points) // SAMPLE)][:SAMPLE]
    step = shot.motion.step_into(shot.motion.flow, number)
    started = perf_counter()
    with suppress(FrameError):  # frame by frame it may fail for other reasons
        step.apply(sample)
    return (perf_counter() - started) * moved / len(sample) / numba.get_num_threads()


def _offsets(flow: Any, point: Floats, time: float) -> Iterator[tuple[str, Floats]]:
    """Yield the name of each flow with a centre, and the vector from it to a point; fields: across the axis.

    Flows in a coordinate frame of their own are left out.
    """
    if isinstance(flow, tuple):
        for part in flow:
            yield from _offsets(part, point, time)
    if hasattr(flow, "transform") or not dataclasses.is_dataclass(flow) or isinstance(flow, type):
        return
    if isinstance(flow, Flow | VelocityField) and hasattr(flow, "centre"):
        offset = point - np.array(vector_at(flow.centre, time))
        if isinstance(flow, VelocityField) and hasattr(flow, "axis"):
            axis = np.array(flow.axis) / np.linalg.norm(flow.axis)
            offset = offset - (offset @ axis) * axis
        yield flow.name, offset
        return
    for field in dataclasses.fields(flow):
        yield from _offsets(getattr(flow, field.name), point, time)


PICTURE_WIDTH, SHARP = 1920, 2.0
"""Width of a picture in pixels, and the width of blur there up to which a point is sharp."""

LEAST_SHARP, WANTED_SHARP, SMALLEST_STOP = 0.08, 0.3, 45.0
"""Share of the near half of a subject that must be sharp, and the share for which an f-number is suggested,
up to the largest f-number of usual lenses."""

SINGLE_PRECISION = 2.0**-24
"""The relative error of the positions that are rendered."""


def findings(shot: Shot, first: FirstFrame) -> list[Finding]:
    """Return all findings about a shot with this first frame."""
    rules = (
        _budget,
        _edges,
        _camera,
        _below_floor,
        _hidden_sun,
        _sharpness,
        _size,
        _parts,
        _openness,
        acts_elsewhere,
        _deforms_nothing,
        _precision,
        _coordinates,
        takes_long,
        stretches,
        _stage_floor,
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
        fit = MotionForecast(shot.motion).size_remedy(first.extent) if _should_fit(shot, first) else ""
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
    if isinstance(longest, float) and longest > first.extent / MotionForecast.COARSE * (1.0 + 1e-9):
        yield Finding(
            ("resample", "max_edge_length"),
            f"max_edge_length {longest:g} is coarse for a subject {first.extent:.3g} units large: over "
            f"1/{MotionForecast.COARSE} of its largest extent. Write max_edge_length: "
            f"{rounded(first.extent / MotionForecast.FINE):g}.",
        )


def _camera(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that the camera is outside of the subject."""
    camera = shot.picture.camera
    if camera.position is None and camera.distance is None and camera.dolly == 1.0:
        return  # framing keeps it outside
    if shot.subject and camera.position is None:
        return  # it aims at all of several subjects
    names = ("position", "distance", "dolly")
    setting = next(name for name in names if getattr(camera, name) not in (None, 1.0))
    aspect = shot.picture.qualities["draft"].aspect
    for number in sampled_frames(shot):
        view = camera.at(shot.motion.clock.time(number))
        (framing,) = Framer([view], lambda _: first.points, aspect).all()
        if is_inside(np.array(framing.camera.origin), first):
            when = "" if number == shot.frames.first else f", where it was on frame {shot.frames.first}"
            at = ", ".join(f"{x:.3g}" for x in framing.camera.origin)
            yield Finding(
                ("camera", setting),
                f"on frame {number} the camera is inside the subject{when}: it is at ({at}). Move it "
                f"outside, or leave {setting} out.",
            )
            return


def _below_floor(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check the camera against the floor. That of several subjects is under the lowest of all."""
    if not shot.subject:
        yield from below_floor(shot, first.points)


def below_floor(shot: Shot, points: Floats) -> Iterator[Finding]:
    """Check that the camera is above the floor, from below which a stage is dark and hides the subject.

    points  (N, 3), of all subjects on the first frame
    """
    camera, clock = shot.picture.camera, shot.motion.clock
    if shot.picture.stage.kind == "none":
        return
    setting = "elevation" if camera.position is None else "position"
    aspect = shot.picture.qualities["draft"].aspect
    for number in sampled_frames(shot):
        view = camera.at(clock.time(number))
        if view.position is None and view.elevation >= 0.0:
            continue  # framing looks at a place above the floor
        (framing,) = Framer([view], lambda _: points, aspect).all()
        height, floor = framing.camera.origin[1], framing.placement.origin[1]
        if height > floor:
            continue
        remedy = f"Raise its second number above {floor:.3g}"
        if view.position is None:
            away = math.dist(framing.camera.origin, framing.camera.target)
            least = -math.degrees(math.asin(min(1.0, (framing.camera.target[1] - floor) / away)))
            remedy = f"Write elevation: {math.ceil(least) + 1:d} or more"
        yield Finding(
            ("camera", setting),
            f"on frame {number} the camera is below the floor, at the height {height:.3g}: the floor is at "
            f"{floor:.3g}, under the lowest point of {'all subjects' if shot.subjects else 'the subject'} on "
            f"frame {shot.frames.first}. {remedy}, or write stage: none.",
        )
        return


def _hidden_sun(shot: Shot, _: FirstFrame) -> Iterator[Finding]:
    """Check that the wall of a cyclorama does not hide the sun."""
    sun, wall = shot.picture.lights.daylight, shot.picture.stage.wall_elevation
    if sun and 0.0 < sun.elevation < wall:
        yield Finding(
            ("lights",),
            f"the sun stands {math.degrees(sun.elevation):.2g}° high, and the wall of the stage "
            f"{shot.picture.stage.kind} hides the sky up to {math.degrees(wall):.2g}°: no sunlight "
            "reaches the subject. Write stage: ground, or raise the sun.",
        )


def _sharpness(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that some of the subject is in focus."""
    camera, number = shot.picture.camera, shot.frames.first
    if camera.aperture is None or camera.projection.is_wide or shot.subject:
        return  # of several subjects, framing sees all
    aspect = shot.picture.qualities["draft"].aspect
    (framing,) = Framer([camera.at(shot.motion.clock.time(number))], lambda _: first.points, aspect).all()
    lens, depths = framing.camera, framing.camera.project(first.points, aspect)[:, 2]
    facing = depths[(depths > lens.near) & (depths <= np.median(depths))]
    if not len(facing):
        return
    blur = np.abs(1.0 / facing - 1.0 / lens.focus_distance) * lens.lens_radius
    pixels = blur / math.tan(lens.field_of_view / 2.0) * PICTURE_WIDTH
    if (sharp := float((pixels < SHARP).mean())) >= LEAST_SHARP:
        return
    stop = number_at(camera.aperture, shot.motion.clock.time(number))
    needed = stop * float(np.quantile(pixels, WANTED_SHARP)) / SHARP
    remedy = f"aperture: {rounded_up(needed):g}" if needed <= SMALLEST_STOP else "focus: front"
    yield Finding(
        ("camera", "aperture"),
        f"at f/{stop:g} {'nothing' if sharp < 0.005 else f'{sharp:.0%}'} of the side of the subject that "
        f"faces the lens is sharp on frame {number}. Write {remedy}.",
    )


def _stage_floor(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that the stage's floor stands still where a flow has a floor: only then things fall on it."""
    camera, motion = shot.picture.camera, shot.motion
    has_floor = any("floor" in flow.facts(0.0) for flow in motion.flow.members)
    if not has_floor or camera.follow == 0.0 or not len(first.points):
        return
    order = np.argsort(first.points[:, 1])
    points = first.points[order[:: -(-len(order) // FLOOR_SAMPLE)]].astype(np.float64)
    sets, height = [points], float(np.ptp(points[:, 1])) or 1.0
    for number in list(shot.frames)[1:]:
        sets.append(motion.step_into(motion.flow, number).apply(sets[-1]))
    views = [camera.at(motion.clock.time(number)) for number in shot.frames]
    aspect = shot.picture.qualities["draft"].aspect
    framings = Framer(views, lambda i: sets[i], aspect, camera.follow).all()
    floors = [framing.placement.origin[1] for framing in framings]
    moved = 1000.0 * (max(floors) - min(floors)) / height
    if moved > FLOOR_MOVES:
        yield Finding(
            ("camera", "follow"),
            f"the stage's floor follows the subject's lowest point: it moves by {moved:.0f} thousandths of "
            "the subject's height, so nothing is seen to fall or land. Write follow: 0.",
        )


def loop_report(shot: Shot, first: FirstFrame) -> tuple[str, list[Finding]]:
    """Return how near a loop comes to its first frame, in words, and what is wrong with it; "" for no loop.

    Vertices of the first frame are moved on to the frame after the last, which shows the first again.
    Raises FrameError where a frame fails.
    """
    motion, frames, loop = shot.motion, shot.frames, shot.loop
    if loop is None:
        return "", []
    if loop.kind == "dissolve":
        last = f"{frames.last - loop.count + 1}-{frames.last}"
        into = f"{frames.first}-{frames.first + loop.count - 1}"
        count = len(frames) - loop.count
        return f"loop: frames {last} dissolve into {into}; movies have {count} frames", []
    start = first.points[:: -(-len(first.points) // LOOP_SAMPLE)]
    points = start.astype(np.float64)
    for number in range(frames.first + 1, frames.last + 2):
        points = motion.step_into(motion.flow, number).apply(points)
    away = np.linalg.norm(points - start, axis=1) / first.extent
    found, again = [*_unlike_cameras(shot)], frames.last + 1
    text = f"loop: frame {again}, the first again, is {away.mean():.2%} of the subject's size from it"
    if away.max() > LOOP_GAP:
        remedy = "Write loop: true, or a dissolve" if loop.kind == "turns" else "Write integrator: adaptive"
        found.append(
            Finding(
                ("loop",),
                f"the flows do not return: in frame {again} points are up to {away.max():.2%} of the "
                f"subject's size from where they began. {remedy}, unless the subject looks the same there.",
            )
        )
    return f"{text}, at most {away.max():.2%}", found


def _unlike_cameras(shot: Shot) -> Iterator[Finding]:
    """Check that the camera of a loop returns."""
    camera, clock = shot.picture.camera, shot.motion.clock
    before, after = (
        camera.at(clock.time(number))._asdict() for number in (shot.frames.first, shot.frames.last + 1)
    )
    for view in (before, after):
        around = view.pop("azimuth") + view.pop("orbit")
        view["azimuth"] = [math.cos(around), math.sin(around)]
        view["roll"] = [math.cos(view["roll"]), math.sin(view["roll"])]
    for name, value in before.items():
        is_number = isinstance(value, int | float | list | tuple) and None not in np.ravel(value)
        if not (np.allclose(value, after[name], atol=1e-6) if is_number else value == after[name]):
            yield Finding(
                ("camera",),
                f"the camera does not return: {name} differs between frame {shot.frames.last + 1} of the "
                f"loop and frame {shot.frames.first}. End its keys at frame {shot.frames.last + 1} as they "
                "begin, and let orbit go around in whole turns.",
            )


def _size(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that a model has about the size that flows and looks are made for."""
    if _should_fit(shot, first) and not first.exceeds:
        remedy = MotionForecast(shot.motion).size_remedy(first.extent)
        yield Finding(
            ("subject", "model"),
            f"the model is {first.extent:.3g} units large; flows and looks are made for about "
            f"{MotionForecast.TYPICAL:g}. Write {remedy}, or choose max_edge_length and the lengths of the "
            "flows for this size.",
        )


def _parts(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that no small parts decide the size of a model."""
    subject = shot.motion.subject
    if not isinstance(subject, Model) or not subject.files:  # or a surface of a plug-in
        return
    if parts := small_parts(subject.imported().mesh):
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
    forecast = MotionForecast(shot.motion)
    return bool(forecast.size_remedy(first.extent)) and not forecast.is_usual(first.extent)


def _precision(shot: Shot, first: FirstFrame) -> Iterator[Finding]:
    """Check that renderers, which compute in single precision, resolve the subject where it is."""
    detail, fit = first.extent / 1000.0, MotionForecast(shot.motion).size_remedy(first.extent)
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


def is_inside(point: Floats, first: FirstFrame) -> bool:
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
