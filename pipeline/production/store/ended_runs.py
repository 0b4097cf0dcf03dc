"""Runs that have ended: their logs are added to the summaries of the history, and old logs are removed."""

from __future__ import annotations

import contextlib
import json
import platform
import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.errors import MachineError
from pipeline.production.store.event_log import RUNS, event_in, logs_of
from pipeline.production.store.history import HISTORY, History, logs_added, size_of
from pipeline.production.store.locks import of_key
from pipeline.production.store.paths import LOGS
from pipeline.production.store.processes import is_at_work
from render.base.atomic_write import atomic_write

KEPT_BYTES = 64 * 1024 * 1024
"""The most that the logs of ended runs take, but those of the last LATEST runs."""

LATEST = 3

SILENT_SECONDS = 24 * 3600.0
"""Seconds without a line after which a run of another host counts as ended."""

_TAIL = 4096
"""Bytes at the end of a log in which its last line is sought."""


def summarise(root: Path) -> None:
    """Add the logs of ended runs to the summaries, and remove old ones. Ignore errors of the disk."""
    logs = logs_of(root)
    if not logs:
        return
    with contextlib.suppress(OSError, MachineError), of_key(root, "history", lambda: None):
        added = before = logs_added(root)
        for log in logs:
            if added.get(log.stem) != size_of(log) and _has_ended(log):
                history, size = History(root), size_of(log)
                history.add(log)
                if not history.is_whole:
                    continue
                history.write()
                added = {**added, log.stem: size}
        kept = {log.stem for log in _rotated(root, [log for log in logs if log.stem in added])}
        added = {name: size for name, size in added.items() if name in kept}
        if added != before:
            with atomic_write(root / HISTORY / "logs.json", flush=False) as draft:
                draft.write_text(json.dumps(added), encoding="utf-8")


def _rotated(root: Path, logs: Sequence[Path]) -> Iterator[Path]:
    """Remove the logs of all but the latest runs, Snakemake's too; yield those that stay."""
    total = 0
    for age, log in enumerate(reversed(logs)):
        total += size_of(log)
        if age < LATEST or (age < RUNS and total <= KEPT_BYTES):
            yield log
            continue
        for path in log.parent.glob(f"{log.stem}.*jsonl"):
            path.unlink(missing_ok=True)
        shutil.rmtree(root / LOGS / log.stem, ignore_errors=True)


def _has_ended(log: Path) -> bool:
    """Tell whether a run has ended: its log says so, its process is gone, or it is silent for very long."""
    try:
        with log.open("rb") as file:
            first = event_in(file.readline())
            file.seek(max(0, log.stat().st_size - _TAIL))
            last = event_in(file.read().rstrip(b"\n").rpartition(b"\n")[2])
        silent = time.time() - log.stat().st_mtime
    except OSError:
        return False
    if last and last["event"] == "ran":
        return True
    if first and first.get("host") == platform.node():
        process = log.stem.rpartition("-")[2]
        return not (process.isdecimal() and is_at_work(int(process), first.get("started")))
    return silent > SILENT_SECONDS
