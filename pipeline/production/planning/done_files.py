"""Done-files: by them Snakemake sees that jobs are done, and each lists the keys of what its job has made."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.production.stages import STAGES
from pipeline.production.store.paths import DONE
from pipeline.production.store.store import Key, Store
from render.base.atomic_write import atomic_write

if TYPE_CHECKING:
    from pipeline.production.planning.plan import Job, Plan


def done_file(stage: str, shot: str, quality: str, frames: Sequence[int], key: str) -> str:
    """Return where a job says that it is done. The name holds the key, so an edited shot asks for another."""
    home = f"{DONE}/{shot}/{quality}" if STAGES[stage].per_quality else f"{DONE}/{shot}"
    return f"{home}/{stage}/{min(frames):04d}-{max(frames):04d}.{key}"


def movie_record(movie: str) -> str:
    """Return the file, relative to the root, that holds the key by which Snakemake knows a movie."""
    return f"{DONE}/{movie}.key"


def write_manifest(path: Path, kind: str, keys: Sequence[Key]) -> None:
    """Write a done-file: the kind and the keys of what its job has made."""
    with atomic_write(path) as draft:
        draft.write_text(json.dumps({"kind": kind, "keys": list(keys)}), encoding="utf-8")


def check_done_files(plan: Plan, store: Store) -> None:
    """Have done-files tell the truth: what was evicted from the store is not done, what is in it is.

    All get the same old time, for Snakemake runs jobs again whose inputs are newer than their outputs.
    """
    for job in plan.jobs:
        if STAGES[job.stage].makes == "movie":
            continue
        path = store.root / job.output
        if job.output in plan.manifests and not path.exists():
            write_manifest(path, *plan.manifests[job.output])
        # What pictures are cannot be told before their cameras are known.
        is_motion = not STAGES[job.stage].per_quality
        if job.output in plan.manifests or (is_motion and _is_true(job, path, store)):
            os.utime(path, (1, 1))
        else:
            path.unlink(missing_ok=True)


def _is_true(job: Job, path: Path, store: Store) -> bool:
    """Tell whether a done-file names all that its job makes, and the store holds it."""
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        kind, keys = manifest["kind"], manifest["keys"]
    except (OSError, ValueError, KeyError, TypeError):
        return False
    made = 1 if job.stage == "frame_camera" else len(job.frames)
    return len(keys) == made and all(store.holds(kind, key) for key in keys)
