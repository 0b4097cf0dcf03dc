"""The size that flows and looks are made for, and how a shot gives it to a model of another size."""

from __future__ import annotations

from pipeline.shot import Motion
from pipeline.shot.model_subjects import Model

TYPICAL_EXTENT = 2.0
"""Units: the extent of the solids, for which flows have their defaults."""

SMALL, LARGE = 0.1, 10.0
"""Extents over TYPICAL_EXTENT between which flows and looks work as they are."""

COARSE, FINE, FINEST = 12, 24, 150
"""Edges along the largest extent: with fewer than COARSE a subject loses its shape, FINE are suggested, and
with more than FINEST a frame takes long."""


def is_usual_size(extent: float) -> bool:
    """Tell whether flows and looks work as they are for a subject of this extent."""
    return SMALL * TYPICAL_EXTENT <= extent <= LARGE * TYPICAL_EXTENT


def fit_remedy(motion: Motion, extent: float) -> str:
    """Return the settings that fit a model to the typical extent; an empty text for other subjects.

    `subject.fit: 2 in place of scale, and max_edge_length: 0.04`. A maximum edge length that suits the
    typical extent stays; another is scaled with the model.
    """
    if not isinstance(motion.subject, Model):
        return ""
    fit = f"subject.fit: {TYPICAL_EXTENT:g}" + " in place of scale" * (motion.subject.scale != 1.0)
    resampling = motion.resampling_at(motion.frames.first)
    longest = None if resampling is None else resampling.thresholds.max_edge_length
    if not isinstance(longest, float) or COARSE <= TYPICAL_EXTENT / longest <= FINEST:
        return fit
    edges = extent / longest
    suited = edges if FINE <= edges <= FINEST else FINE
    return f"{fit}{',' * ('scale' in fit)} and max_edge_length: {TYPICAL_EXTENT / suited:.2g}"
