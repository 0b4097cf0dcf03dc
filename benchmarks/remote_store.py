"""`python -m benchmarks.remote_store [SHOTS [FRAMES]]`: what a remote store costs, in planning and in transfer.

Ten shots of 1000 frames are planned in a fresh root while the bucket holds nothing, half of their files, and
all of them, from a server that answers at once and from one that takes 50 ms longer for every request. Files
are dummies under the right keys and digests. For comparison the same is planned with a store on this disk.
Then files of the size of a frame are uploaded and fetched, by S3 and by a folder.

The server is moto's, in this process, behind the tests' proxy: its work is part of the seconds by the clock,
so a real server takes less. `requests` is what it was asked.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

from moto.s3.models import s3_backends

from benchmarks.orchestration import CORES, Spent, command, fill, timed, write_shots
from benchmarks.report import Row, keep, show
from pipeline.production.execution.project import Project
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.digests import digest_of
from pipeline.production.store.remote import RemoteStore
from pipeline.production.store.remote_url import VARIABLE
from pipeline.production.store.store import Store
from pipeline.production.store.uploads import upload_lacking
from tests.production.store.s3 import BUCKET, CREDENTIALS, Proxy, serving

LATENCIES = (0.0, 0.05)
"""Seconds that a request takes longer."""

FILES, MEGABYTES = 48, 8
"""Files that are transferred, and the size of each: of a frame of 1920 × 1080 with its layers."""

STATES = {"empty": 0.0, "half full": 0.5, "full": 1.0}
"""The part of the frames that the bucket holds."""


def main(shots: int = 10, frames: int = 1000) -> None:
    """Measure, print two tables and write the numbers."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder), serving() as proxy:
        os.environ |= {**CREDENTIALS, "AWS_ENDPOINT_URL": proxy.url}
        rows = list(planning(proxy, shots, frames))
        show(f"Planning {shots} × {frames} frames with a remote store", rows)
        keep("remote_store_planning", rows)
        rows = list(transfer(proxy))
        show(f"{FILES} files of {MEGABYTES} MB", rows)
        keep("remote_store_transfer", rows)


def planning(proxy: Proxy, shots: int, frames: int) -> Iterator[Row]:
    """Plan with a remote store in every state, and with the same files in the local store."""
    names = write_shots(shots, frames)
    plan = Project(Path.cwd(), CORES).pictures(names, "draft")
    fill(plan)
    words = ("--dry-run", "render", *names, "-q", "draft")
    yield _row("all on this disk, no remote store", 0.0, timed(lambda: command(*words)), 0)
    for state, part in STATES.items():
        url = f"s3://{BUCKET}/{state.replace(' ', '')}"
        _fill_bucket(url, Store(Path.cwd()), plan.requests, part)
        for latency in LATENCIES:
            with tempfile.TemporaryDirectory() as root:
                asked = ("--root", root, *words)
                os.environ.pop(VARIABLE, None)
                Path(root, ".flowsculpt").mkdir()
                command(*asked)  # so that shots are read, as in a root in which work has begun
                proxy.seconds = latency
                proxy.requests.clear()
                spent = timed(lambda: command(*asked, "--store", url))  # noqa: B023
                proxy.seconds = 0.0
                yield _row(state, latency, spent, len(proxy.requests))


def _row(state: str, latency: float, spent: Spent, requests: int) -> Row:
    return {
        "the remote store is": state,
        "latency, ms": 1000.0 * latency,
        "s by the clock": spent.clock,
        "s of a core, server included": spent.cpu,
        "requests": float(requests),
    }


def _fill_bucket(url: str, store: Store, requests: tuple[RenderRequest, ...], part: float) -> None:
    """Put the files of a part of the frames of requests into the bucket, past the network."""
    objects, home = s3_backends["123456789012"]["aws"], url.split("/", 3)[3]
    for request in requests:
        keys = request.picture_keys(store)
        assert keys is not None, "cameras are filled in"
        held = [n for n in request.requested if n <= part * len(request.requested)]
        files = [("cameras", request.cameras_key)] if held else []
        files += [("mesh", request.mesh_key(n)) for n in held]
        files += [("normals", request.normals_key(n)) for n in held]
        files += [(kind, getattr(keys[n], kind)) for n in held for kind in ("raw", "frame")]
        for kind, key in files:
            path = store.path(kind, key)
            name = f"{home}/{kind}/{key[0]}/{key}.{digest_of(path)}{path.suffix}"
            objects.put_object(BUCKET, name, path.read_bytes())


def transfer(proxy: Proxy) -> Iterator[Row]:
    """Upload and fetch files of the size of frames."""
    Path("share").mkdir()
    for kind, url in (("S3", f"s3://{BUCKET}/transfer"), ("folder", f"file://{Path.cwd()}/share")):
        here, there = Store(Path.cwd() / f"{kind}_a", None), Store(Path.cwd() / f"{kind}_b", url)
        keys = [f"{number:032x}" for number in range(FILES)]
        for key in keys:
            here.put("raw", key, lambda path: path.write_bytes(os.urandom(MEGABYTES * 1_000_000)))
        RemoteStore.of(url).fault()  # connects
        begun = time.perf_counter()
        assert upload_lacking(Store(here.root, url)).sent == FILES
        sent = time.perf_counter()
        assert there.bring_all([("raw", key) for key in keys]) == FILES
        fetched = time.perf_counter()
        megabytes = FILES * MEGABYTES
        yield {
            "remote store": kind,
            "upload, MB/s": megabytes / (sent - begun),
            "fetch, MB/s": megabytes / (fetched - sent),
        }


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3]))
