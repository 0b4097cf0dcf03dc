"""Lets `clean` delete fits of `become` that nothing needs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from flowsculpt.api import ShotExtras

if TYPE_CHECKING:
    from flowsculpt.api.frames import RenderRequest


class BecomeExtras(ShotExtras):
    """The fits in the cache of the user."""

    def unneeded(self, root: Path, requests: Iterable[RenderRequest]) -> tuple[str, list[Path]]:
        from flowsculpt.pipeline.plugins.become.unneeded_fits import unneeded_fits

        return unneeded_fits(root, requests)
