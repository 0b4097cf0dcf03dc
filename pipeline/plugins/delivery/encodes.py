"""The encodes of deliverables by name: movies, stills, a GIF, and those of plug-ins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flowsculpt import UsageError
from flowsculpt.api import Plugin, plugins, quote, suggest
from flowsculpt.api.pictures import ENCODES, Encode
from flowsculpt.pipeline.plugins.delivery.gain_map import GAIN_MAP
from flowsculpt.pipeline.plugins.delivery.gif import GIF
from flowsculpt.pipeline.plugins.delivery.png_still import PNG

KINDS = {
    ".mp4": "movie",
    ".jpg": "jpeg",
    ".png": "png16",
    **{end: end[1:] for end in (".mov", ".mkv", ".webp", ".avif", ".gif")},
}
"""Kinds of files in the store by the suffix of an encode."""


def _encode_of_plugin(plugin: Plugin, name: str, encode: Any) -> Encode:
    """Return the encode of a plug-in under its full name. Raises TypeError or ValueError for what is none."""
    if not isinstance(encode, Encode):
        raise TypeError("it is not an Encode")
    if encode.suffix not in KINDS:
        raise ValueError(f"its files end in {encode.suffix}; they can end in {', '.join(KINDS)}")
    return replace(encode, name=name)


DELIVERABLES: Mapping[str, Encode] = {
    **ENCODES,
    GAIN_MAP.name: GAIN_MAP,
    PNG.name: PNG,
    GIF.name: GIF,
    **plugins().parts("encodes", _encode_of_plugin),
}
"""The encodes of deliverables by name, those of plug-ins last."""

MEANT = {
    "apng": "webp",
    "dnxhd": "prores4444",
    "exr": "ffv1",
    "hdr": "hdr10",
    "hevc": "h265",
    "lossless": "ffv1",
    "instagram": "phone",
    "m4v": "phone",
    "mkv": "ffv1",
    "mobile": "phone",
    "mov": "prores4444",
    "mp4": "h264",
    "poster": "png",
    "pq": "hdr10",
    "preview": "review",
    "prores": "prores4444",
    "quicktime": "prores4444",
    "social": "phone",
    "tiktok": "phone",
    "webm": "av1",
    "x264": "h264",
    "x265": "h265",
}
"""Words for movie formats, and the deliverables that are suggested for them."""


def encode_named(name: str) -> Encode:
    """Return a deliverable by its name. Raises UsageError, with the names there are."""
    if name not in DELIVERABLES:
        meant = MEANT.get(name.lower().lstrip("."))
        close = f"Did you mean {meant!r}?" if meant else suggest(name, DELIVERABLES)
        known = "" if close.startswith("There are") else f" There are: {', '.join(DELIVERABLES)}."
        raise UsageError(f"{quote(name)} is not a deliverable. {close}{known}")
    return DELIVERABLES[name]
