"""The flow `become`, which carries its subject onto a model or a solid along the path of a fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flowsculpt import Flow, FrameError, UsageError
from flowsculpt.api.flows import Keyframes, Number, number_at
from flowsculpt.api.meshes import Floats
from flowsculpt.api.shots import Model, Solid
from flowsculpt.pipeline.plugins.become.fitting import Detail
from flowsculpt.pipeline.plugins.become.stored_fits import (
    DOUBTFUL,
    REFUSED,
    VERSION,
    Fit,
    PlacedShape,
    fit_between,
    path_of,
)

MOTION = 2
"""Raised when the same fit moves a surface in another way."""

REST_INTERVAL = 8
"""Frames after which the present surface becomes the one at rest: over half a fit, limbs grow from so small a
patch that distances at rest of a thousandth of it decide which faces fold."""


@dataclass(frozen=True)
class Become(Flow):
    """Carries the subject onto a model or a solid.

    The fit is computed when the first point moves, which takes a minute or two, and is stored.

    target    where it arrives
    progress  share of the way over time: 0 the subject as it begins, 1 the target
    start     the shape that begins; None before a subject is known
    others    names of other flows that move the subject before this one
    """

    target: PlacedShape
    progress: Number
    detail: Detail = "medium"
    start: PlacedShape | None = None
    others: tuple[str, ...] = ()

    def displace(self, points: Floats, time: float, dt: float) -> Floats:
        """Carry points along the path. Raises FrameError where they are outside of the cube of the fit."""
        before, after = self._shares(time, dt)
        if before == after:
            return points.copy()
        fit = self.fit()
        if not fit.holds(points):
            far = points[np.argmax(np.abs(points - fit.low - 0.5 * fit.side).max(axis=1))]
            where = ", ".join(f"{x:.3g}" for x in far)
            raise FrameError(
                f"flow {self.name}: the subject is at ({where}), outside of the cube around "
                f"{self._start.name} and {self.target.name}, where no path is known. Let others act after it."
            )
        return fit.displace(points, before, after)

    def cache_data(self, time: float, dt: float) -> Any:
        before, after = self._shares(time, dt)
        if before == after:
            return {"become": None, "motion": MOTION}
        shapes, shares = [self._start.data(), self.target.data()], [before, after]
        versions = {"version": VERSION, "motion": MOTION}
        return {"become": shapes, "detail": self.detail, "shares": shares, **versions}

    def _shares(self, time: float, dt: float) -> tuple[float, float]:
        return number_at(self.progress, time), number_at(self.progress, time + dt)

    @property
    def _start(self) -> PlacedShape:
        """The shape that begins. Raises UsageError where none is known."""
        if self.start is None:
            raise UsageError(
                "become acts on one closed surface, as an entry of flows. Take it out of its composition."
            )
        return self.start

    def of_subject(self, subject: Any, place: tuple[float, float, float], before: Sequence[Flow]) -> Become:
        """Return the flow that begins where the one before it arrives, or with the subject at rest."""
        body = subject.body  # the fit is one of space, in which points lie
        start = PlacedShape(body, place) if isinstance(body, Solid | Model) else None
        for flow in before:
            if isinstance(flow, Become) and number_at(flow.progress, self._begin) > 0.5:
                start = flow.target
        others = tuple(flow.name for flow in before if not isinstance(flow, Become))
        return replace(self, start=start, others=others)

    @property
    def _begin(self) -> float:
        """Seconds of the shot before which nothing moves."""
        return self.progress.times[0] if isinstance(self.progress, Keyframes) else 0.0

    def fit(self) -> Fit:
        """Return the fit. Raises UsageError where it arrives too far from its target."""
        fit = fit_between(self._start, self.target, self.detail)
        if fit.residual.worst > REFUSED:
            raise UsageError(
                f"parts of the surface end over {fit.residual.worst:.1%} of the diagonal "
                f"away from {self.target.name}; {REFUSED:.0%} is the most. {self._remedy}"
            )
        return fit

    @property
    def _is_fitted(self) -> bool:
        """True if the fit is in the user's cache."""
        return path_of(self._start, self.target, self.detail).is_file()

    @property
    def _remedy(self) -> str:
        finer = "" if self.detail == "fine" else "Write detail: fine, or begin"
        return f"{finer or 'Begin'} with a shape that is more like it."

    def findings(self) -> Iterator[tuple[str, bool]]:
        """Yield how far from its target it arrives, and warnings. Raises as `fit`."""
        fit, name = self.fit(), self.target.name
        mean, most, back, far, patch, least = fit.residual
        yield (
            f"{self._start.name} becomes {name}: it ends {mean:.2%} of the diagonal away on average, 95 % "
            f"within {most:.2%}; {name} is {back:.2%} and {far:.2%} from it. The worst part is {patch:.2%} "
            f"away. Volumes shrink to {least:.2g}.",
            False,
        )
        if fit.residual.worst > DOUBTFUL:
            yield (
                f"{name} is reached within {fit.residual.worst:.1%} of its diagonal only. {self._remedy}",
                True,
            )
        for remark in fit.remarks:
            yield remark, True
        if self.others:
            first = self.others[0]
            yield (
                f"become begins with {self._start.name} at rest; what {first} does before is carried along.",
                True,
            )

    def facts(self, time: float) -> Mapping[str, Any]:
        """Return what `findings` notes, once the flow has begun: shares of the target's diagonal.

        Nothing where the cache has no fit: a machine that only renders meshes would compute it for a note.
        """
        if number_at(self.progress, time) == 0.0 or not self._is_fitted:
            return {}
        names = ("mean", "within_95", "mean_of_target", "within_95_of_target", "worst_part", "least_volume")
        numbers = dict(zip(names, self.fit().residual, strict=True))
        return {"becomes": self.target.name, "detail": self.detail, "residual": numbers}

    @property
    def faces_follow_normals(self) -> bool:
        return True

    @property
    def rest_interval(self) -> int:
        return REST_INTERVAL

    @property
    def name(self) -> str:
        return f"become {self.target.name}"
