"""Lets `clean` delete what interrupted runs of `breed` left."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from flowsculpt.api import ShotExtras

if TYPE_CHECKING:
    from flowsculpt.api.frames import RenderRequest


class BreedExtras(ShotExtras):
    """The trials and drafts of generations."""

    def unneeded(self, root: Path, requests: Iterable[RenderRequest]) -> tuple[str, list[Path]]:
        from flowsculpt.pipeline.plugins.breed.generation import unneeded_trials

        return unneeded_trials(root, requests)
