"""GIF for pages that take nothing else: one palette of all frames, dithered, played without end.

FFmpeg finds the palette and dithers. Frames are read twice, so that memory holds the file and few frames.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.filter import Graph

from flowsculpt.api.files import atomic_write
from flowsculpt.api.pictures import ENCODES, Encode, to_pixel_format
from flowsculpt.pipeline.plugins.delivery.hdr_frames import Frame

_DITHER = {"dither": "sierra2_4a", "diff_mode": "rectangle"}

_CONTAINER = replace(ENCODES["avif"].container, format="gif", suffix=".gif")

GIF = Encode("gif", _CONTAINER, "gif", "pal8", _DITHER, display="srgb")
"""GIF; its options are those of FFmpeg's filter `paletteuse`."""

_TICKS = 100  # of GIF's clock, a second
_BASE = Fraction(1, _TICKS)

_SHORTEST = 2  # ticks of a frame: browsers show one of less for ten


def write_gif(
    path: Path, frames: Callable[[], Iterator[Frame]], rate: Fraction, encode: Encode = GIF
) -> None:
    """Encode display frames (H, W, 3), which are read twice, as a GIF that plays round and round.

    rate    frames per second; GIF counts hundredths of a second, so times are rounded, and frames left out
            that would follow in less than two
    encode  of GIF, for its dithering

    Raises MachineError where the disk refuses.
    """
    palette, last = _palette(frames()), -_SHORTEST
    content = io.BytesIO()
    with av.open(content, "w", format="gif", options={"loop": "0"}) as movie:  # 0: without end
        stream: Any = None
        for count, frame in enumerate(_dither(frames(), palette, encode.options)):
            if stream is None:
                stream = movie.add_stream("gif", rate=rate, options={})
                stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, "pal8"
                stream.codec_context.time_base = _BASE
            frame.pts, frame.time_base = round(count * _TICKS / rate), _BASE
            if frame.pts - last < _SHORTEST:
                continue
            last = frame.pts
            movie.mux(stream.encode(frame))
        movie.mux(stream.encode(None))
    with atomic_write(path) as draft:
        draft.write_bytes(content.getvalue())


def _palette(frames: Iterator[Frame]) -> av.VideoFrame:
    """Return the 255 colours, and a transparent one, that suit all frames."""
    graph: Any = Graph()
    source: Any = None
    for frame in frames:
        if source is None:
            source, sink = _input(graph, frame), graph.add("buffersink")
            _link(source, graph.add("palettegen"), sink)
            graph.configure()
        source.push(_video_frame(frame))
    source.push(None)
    return sink.pull()


def _dither(
    frames: Iterator[Frame], palette: av.VideoFrame, options: Mapping[str, str]
) -> Iterator[av.VideoFrame]:
    """Yield frames in the colours of a palette."""
    graph: Any = Graph()
    source: Any = None
    for number, frame in enumerate(frames):
        if source is None:
            source, sink = _input(graph, frame), graph.add("buffersink")
            use = graph.add("paletteuse", **options)
            size = {"width": palette.width, "height": palette.height}
            colours = graph.add_buffer(**size, format="rgb32", time_base=_BASE)
            _link(source, use, sink)
            colours.link_to(use, 0, 1)
            graph.configure()
            palette.pts, palette.time_base = 0, _BASE
            colours.push(palette)
            colours.push(None)
        source.push(_video_frame(frame, number))
        yield from _pull(sink)
    source.push(None)
    yield from _pull(sink)


def _input(graph: Any, frame: Frame) -> Any:
    height, width = frame.shape[:2]
    return graph.add_buffer(width=width, height=height, format="bgra", time_base=_BASE)


def _link(*filters: Any) -> None:
    for one, other in pairwise(filters):
        one.link_to(other)


def _pull(sink: Any) -> Iterator[av.VideoFrame]:
    """Yield the frames that a graph has ready."""
    while True:
        try:
            yield sink.pull()
        except (av.error.BlockingIOError, av.error.EOFError):
            return


def _video_frame(frame: Frame, number: int = 0) -> av.VideoFrame:
    shown = av.VideoFrame.from_ndarray(np.ascontiguousarray(to_pixel_format(frame, "bgra")), format="bgra")
    shown.pts, shown.time_base = number, _BASE
    return shown
