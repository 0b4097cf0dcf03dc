"""Qualities that end where a picture is quiet enough: whether there is a pass to be saved."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.shot.checks.file_checks import Problem
from pipeline.shot.documents.fields import is_number
from pipeline.shot.yaml.source import Source
from render.scene.quality import FEWEST_ADAPTIVE, QUALITIES


def saves_passes(source: Source) -> Iterator[Problem]:
    """A threshold needs samples enough to stop at fewer."""
    for name, quality in QUALITIES.items():
        place = ("quality", name, "noise_threshold")
        samples = source.get("quality", name, "samples")
        samples = quality.samples if samples is None else samples
        if is_number(source.get(*place)) and is_number(samples) and samples < FEWEST_ADAPTIVE:
            yield (
                place,
                f"{name} takes {samples} samples, of which no pass could be saved; noise_threshold needs "
                f"{FEWEST_ADAPTIVE} or more. Write samples: 256 beside it.",
            )
