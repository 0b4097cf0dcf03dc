"""`python -m benchmarks.field_windows [NODES TIMES FRAMES [SHARE [APART]]] [--zstd]`: a streamed field.

Writes a Zarr store of TIMES times of NODES³ float32 velocities in chunks of 50³ without compression, or
with `--zstd` of 100³ with it and some noise, of which only SHARE (1) of the chunks is there; then, each in
a process of its own, plans FRAMES frames twice, moves 10,000 and 200,000 points through them, simulates a
ball that is resampled, grows a path surface, whose new vertices come from their seeds through all times,
and reads the chunks of the times once with zarr alone; APART (4) frames are from one time to the next.
Prints CPU seconds, the share of them in which velocities are read and checked, the most memory of each
process, and the size of the store as it would be whole. The store lies among temporary files.
"""

from __future__ import annotations

import json
import math
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from itertools import product
from pathlib import Path
from time import process_time, thread_time, time_ns
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.report import Row, keep, show

CHUNK = 50
FPS = 24.0
LINE = "[[-0.6, 0.1, 0.2], [0.6, 0.1, 0.2]]"
ALONE, BALL, SURFACE = -1, -2, -3  # in place of a number of points


def write_store(folder: Path, nodes: int, times: int, share: float, is_compressed: bool = False) -> Path:
    """Write a store of a turn that changes its direction; chunks are written as plain files."""
    import numcodecs
    import zarr

    store = folder / "field.zarr"
    root = zarr.open_group(store, mode="w", zarr_format=3)
    root.attrs["written"] = time_ns()  # else the user's cache would have its slopes from the last run
    axis = np.linspace(-1.0, 1.0, nodes)
    chunk, noise, codec = min(2 * CHUNK if is_compressed else CHUNK, nodes), 0.0, None
    if is_compressed:  # as measured data, which hardly shrink
        noise, codec = (
            1e-3 * np.random.default_rng(3).normal(size=[chunk] * 3),
            zarr.codecs.ZstdCodec(level=3),
        )
    for name, units in (("x", "m"), ("y", "m"), ("z", "m"), ("time", "s")):
        values = np.arange(times, dtype=float) if name == "time" else axis
        array = root.create_array(name, data=values, dimension_names=[name])
        array.attrs.update({"units": units} if name == "time" else {"units": units, "axis": name.upper()})
    generator = np.random.default_rng(1)
    for name in "uvw":
        array = root.create_array(
            name,
            shape=(times, nodes, nodes, nodes),
            chunks=(1, chunk, chunk, chunk),
            dtype="f4",
            compressors=codec,
            fill_value=np.nan,
            dimension_names=["time", "z", "y", "x"],
        )
        array.attrs["units"] = "m s-1"
        for t, *place in np.ndindex(times, *[-(-nodes // chunk)] * 3):
            if generator.random() > share:
                continue
            z, y, x = np.ix_(*(axis[chunk * k : chunk * (k + 1)] for k in place))
            turn = 0.3 * t
            numbers = {"u": np.cos(turn) * z - y, "v": x, "w": -np.cos(turn) * x}[name]
            whole = np.full([chunk] * 3, np.nan, np.float32)
            whole[: z.size, : y.size, : x.size] = numbers
            whole += noise
            path = store / name / "c" / "/".join(map(str, (t, *place)))
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(numcodecs.Zstd(3).encode(whole) if is_compressed else whole.tobytes())
    return store


def read_alone(store: Path, times: int) -> None:
    """Print CPU seconds of reading the chunks of the first times with zarr alone, and the most memory."""
    import zarr

    begin, root = process_time(), zarr.open_group(store, mode="r")
    for t, name in product(range(min(times, root["time"].shape[0])), "uvw"):
        array = root[name]
        for first in range(0, array.shape[1], array.chunks[1]):
            array[t, first : first + array.chunks[1]]
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps([process_time() - begin, process_time() - begin, most]))


def measured(store: Path, frames: int, count: int, apart: float) -> None:
    """Print CPU seconds, those of reading, and the most memory (MiB) of moving points.

    With 0 points those of planning, with BALL and SURFACE those of simulating a shot.
    """
    from flowsculpt.pipeline.animation import animate
    from flowsculpt.pipeline.plugins.fields.chunked_times import TimeChunks
    from flowsculpt.pipeline.plugins.fields.windowed_samples import WindowedSamples
    from flowsculpt.pipeline.shot import read_shot

    reading = [0.0]

    def timed(function: Callable[..., Any]) -> Callable[..., Any]:
        def measuring(*arguments: Any) -> Any:
            began = thread_time()  # other threads move points
            try:
                return function(*arguments)
            finally:
                reading[0] += thread_time() - began

        return measuring

    for kind, name in ((WindowedSamples, "chunks"), (TimeChunks, "_fill")):
        patch.object(kind, name, timed(getattr(kind, name))).start()  # until the process ends

    pace = FPS / apart
    field = f"[{{sampled: {{file: {store.name}, time_scale: {pace:.9g}, strength: {0.3 / pace:.9g}}}}}]"
    text = f"title: Windows\nframes: 1-{frames}\n"
    if count == SURFACE:
        text += f"subject: {{path_surface: {{line: {LINE}}}, max_edge_length: 0.02, velocity: {field}}}\n"
    elif count == BALL:
        text += "subject: {solid: icosphere, radius: 0.8}\nresample: {max_edge_length: 0.03}\n"
        text += f"flows: {field}\n"
    else:
        text += f"subject: {{solid: icosphere}}\nresample: off\nflows: {field}\n"
    begin = process_time()
    shot = read_shot(store.parent / "windows.yaml", text)
    if count in (BALL, SURFACE):
        for _ in animate(shot):
            pass
    elif count:
        points = np.random.default_rng(2).uniform(-0.9, 0.9, (count, 3))
        for frame in range(2, frames + 1):
            points = shot.motion.flow.displace(points, *shot.motion.clock.step(frame))
    else:
        for frame in range(2, frames + 1):
            shot.motion.step_data(frame)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps([process_time() - begin, reading[0], most]))


def main() -> None:
    """Print a table, and write `benchmarks/out/field_windows.json`."""
    given = [float(number) for number in sys.argv[1:] if not number.startswith("-")]
    nodes, times, frames, share, apart = [*given, *(100, 12, 45, 1.0, 4.0)[len(given) :]]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        begin = process_time()
        store = write_store(Path(folder), int(nodes), int(times), share, "--zstd" in sys.argv)
        written = process_time() - begin
        steps = {"plan": 0, "plan again": 0, "move 10,000 points": 10_000, "move 200,000 points": 200_000}
        steps |= {"simulate a ball": BALL, "path surface": SURFACE, "zarr alone": ALONE}
        for name, count in steps.items():
            command = [sys.executable, "-m", "benchmarks.field_windows", "--measure"]
            command += [str(store), str(int(frames)), str(count), str(apart)]
            answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            seconds, reading, most = json.loads(answer.splitlines()[-1])
            share = round(100 * reading / seconds)
            row = {"step": name, "CPU s": round(seconds, 1), "reading %": share, "most MiB": round(most)}
            rows.append(row)
        size = 12 * nodes**3 * times / (1 << 30)
        on_disk = sum(file.stat().st_size for file in store.rglob("*") if file.is_file()) / (1 << 30)
    show(
        f"{size:.2f} GiB of velocities, {on_disk:.2f} GiB on disk, written in {written:.0f} CPU s",
        rows,
    )
    keep("field_windows", rows)


if __name__ == "__main__":
    if "--measure" in sys.argv:
        place, frame_count, point_count, between = sys.argv[sys.argv.index("--measure") + 1 :]
        if int(point_count) == ALONE:  # as many times as the frames pass, and the first
            read_alone(Path(place), 1 + math.ceil((int(frame_count) - 1) / float(between) - 1e-9))
        else:
            measured(Path(place), int(frame_count), int(point_count), float(between))
    else:
        main()
