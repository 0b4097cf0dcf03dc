"""`python -m benchmarks.remote_store [SHOTS [FRAMES]]`: planning and transfer with a remote store.

Ten shots of 1000 frames are planned in a fresh root while the bucket holds nothing, half of their files, and
all of them, from a server that answers at once and from one that takes 50 ms longer for every request; and,
for comparison, while the same files are on this disk. Files are dummies under the right keys and digests.
Then files of the size of a frame are uploaded and fetched, by S3 and by a folder.

The server is moto's, in this process, behind the tests' proxy: its work is part of the seconds by the clock,
so a real server takes less. `requests` is what it was asked.
"""

from __future__ import annotations

import os
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import chdir, contextmanager
from pathlib import Path

from moto.s3.models import s3_backends

from benchmarks.orchestration import CORES, command, fill, write_shots
from benchmarks.report import Row, keep, show
from flowsculpt.pipeline.plugins.remote.push_command import lacking_names
from flowsculpt.pipeline.plugins.remote.remote_files import RemoteFiles
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.store.digests import digest_of
from flowsculpt.pipeline.production.store.paths import STATE
from flowsculpt.pipeline.production.store.store import Store
from tests.plugins.remote.s3 import BUCKET, CREDENTIALS, Proxy, serving

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
    words, here = ("--dry-run", "render", *names, "-q", "draft"), Store(Path.cwd(), url=None)
    for state, part in STATES.items():
        files = list(_files(here, plan.requests, part))
        with _begun_root(*words) as root:
            for kind, key in files:
                place = Store(root, url=None).path(kind, key)
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(here.path(kind, key), place)
            yield {"files": state, "where": "this disk", **_spent("--root", str(root), *words)}
        url = f"s3://{BUCKET}/{state.replace(' ', '')}"
        _fill_bucket(url, here, files)
        for latency in LATENCIES:
            with _begun_root(*words) as root:
                proxy.seconds = latency
                proxy.requests.clear()
                spent = _spent("--root", str(root), "--store", url, *words)
                proxy.seconds = 0.0
                where = f"S3, {1000 * latency:.0f} ms"
                yield {"files": state, "where": where, **spent, "requests": float(len(proxy.requests))}


@contextmanager
def _begun_root(*words: str) -> Iterator[Path]:
    """Yield a root that has nothing but its planning cache, as where work has begun."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, STATE).mkdir()
        command("--root", folder, *words)
        yield Path(folder)


def _spent(*words: str) -> Row:
    """Return the seconds of a command, without those that the server works."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command(*words)
    clock, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return {"s of a core": cpu, "s by the clock": clock}


def _files(store: Store, requests: Sequence[RenderRequest], part: float) -> Iterator[tuple[str, str]]:
    """Yield kind and key of the files of a part of the frames of requests."""
    for request in requests:
        keys = request.keys.pictures(store)
        assert keys is not None, "cameras are filled in"
        held = [n for n in request.requested if n <= part * len(request.requested)]
        yield from [("cameras", request.keys.cameras)] if held else []
        for n in held:
            yield from [("mesh", request.keys.mesh(n)), ("normals", request.keys.normals(n))]
            yield from [("raw", keys[n].raw), ("frame", keys[n].frame)]


def _fill_bucket(url: str, store: Store, files: Iterable[tuple[str, str]]) -> None:
    """Put stored files into the bucket, past the network."""
    objects, home = s3_backends["123456789012"]["aws"], url.split("/", 3)[3]
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
        RemoteFiles.of(url).fault()  # connects
        begun = time.perf_counter()
        whole = Store(here.root, url)
        assert whole.upload_missed(lacking_names(whole)).sent == FILES
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
