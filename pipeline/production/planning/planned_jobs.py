"""The jobs of a plan, which of them makes each file, and the batches of frames that one job renders.

Jobs are known by the keys of what they make, so what several requests need is made once.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

from pipeline.production.planning.done_files import done_file
from pipeline.production.planning.entry import PlanEntry
from pipeline.production.planning.plan import Job
from pipeline.production.stages import STAGES
from pipeline.production.store.store import Key, key_of

MAX_BATCH = 256
"""Frames a process renders at most before it gives its memory back."""

MIN_BATCH = 4
"""Frames that are not worth the start of a second process: one renders them on all cores."""

MIN_LAST_BATCH = 64
"""Frames of a batch from which on batches become no smaller, while there are more of them than cores."""

MIN_SHARED = 8
"""Frames that a simulation has in common with others from which on these wait for them: to wait costs the
start of one more process."""


@dataclass
class PlannedJobs:
    """Collects jobs, and notes which requests need them.

    jobs       in the order in which they were added
    spared     frames by stage that a request needs and the job of another makes
    manifests  what the jobs whose files are there have made: the kind and the keys, by output
    """

    jobs: list[Job] = field(default_factory=list)
    spared: Counter[str] = field(default_factory=Counter)
    manifests: dict[str, tuple[str, list[Key]]] = field(default_factory=dict)
    _makers: defaultdict[str, dict[Key, int]] = field(default_factory=lambda: defaultdict(dict))

    def is_new(self, entry: PlanEntry, stage: str, key: Key, present: bool, frames: int = 1) -> bool:
        """Tell whether no job makes a file yet; a job that does then serves this request too."""
        maker = self._makers[stage].get(key)
        if maker is None:
            return True
        self._serve(maker, entry)
        if self.jobs[maker].requests[0] != entry.place and not present:
            self.spared[stage] += frames
        return False

    def _serve(self, maker: int, entry: PlanEntry) -> None:
        """Note that a request needs what a job makes."""
        job = self.jobs[maker]
        self.jobs[maker] = replace(job, requests=tuple(dict.fromkeys((*job.requests, *entry.places))))

    def add(
        self,
        entry: PlanEntry,
        stage: str,
        frames: Sequence[int],
        keys: Sequence[Key],
        reads: Sequence[int],
        present: bool,
        **fields: Any,
    ) -> None:
        """Add a job that makes files of `keys`; those that are there stand in its manifest.

        fields  fields of the job that differ from the usual ones
        """
        request, key = entry.request, key_of(stage, list(keys))[:16]
        label = re.sub(r"\W", "_", request.label)
        name = f"{stage}_{label}_{min(frames):04d}_{max(frames):04d}_{key[:8]}"
        output = done_file(stage, request.name, request.quality_name, frames, key)
        if present:
            self.manifests[output] = STAGES[stage].makes, list(keys)
        for made in keys:
            self._makers[stage].setdefault(made, len(self.jobs))
        others = None if list(reads) == list(frames) else tuple(reads)
        job = Job(name, stage, entry.places, tuple(frames), others, key=key, output=output, present=present)
        self.jobs.append(replace(job, **fields))

    def add_simulations(self, entries: Collection[PlanEntry]) -> None:
        """Add the jobs that simulate meshes; a long beginning that requests share is made once."""
        makers = self._makers["simulate"]
        wanted = [(entry, entry.numbers("wanted")) for entry in entries]
        users = Counter(key for chain in {e.mesh_keys(numbers) for e, numbers in wanted} for key in chain)
        for entry, numbers in wanted:
            before: list[int] = []
            for is_shared, piece in _pieces(entry, numbers, users):
                keys = entry.mesh_keys(piece)
                if all(key in makers for key in keys) or (is_shared and keys[0] in makers):
                    for maker in {makers[key] for key in keys if key in makers}:
                        self._serve(maker, entry)
                    self.spared["simulate"] += len(piece)
                else:
                    self.add(entry, "simulate", piece, keys, before, present=False)
                before = piece[-1:]
        for entry in entries:
            for state in ("present", "idle"):
                if numbers := entry.numbers(state):
                    self.add(entry, "simulate", numbers, entry.mesh_keys(numbers), (), state == "present")


def _pieces(
    entry: PlanEntry, numbers: Sequence[int], users: Mapping[Key, int]
) -> list[tuple[bool, list[int]]]:
    """Return frames that the same number of simulations go through, and whether one makes them for all.

    Short pieces are not worth waiting for: each simulation makes those itself, to the same bits.
    """
    pieces: list[tuple[bool, list[int]]] = []
    for many, group in groupby(numbers, key=lambda n: users[entry.request.mesh_key(n)]):
        piece = list(group)
        is_shared = many > 1 and len(piece) >= MIN_SHARED
        if pieces and not is_shared and not pieces[-1][0]:
            pieces[-1][1].extend(piece)
        else:
            pieces.append((is_shared, piece))
    return pieces


def batches(numbers: Sequence[int], cores: int, least: int = MIN_BATCH) -> list[tuple[int, ...]]:
    """Split frames into batches, none longer than MAX_BATCH, enough of them to keep the cores busy, but none
    needlessly shorter than `least`.

    Frames in ascending order are split into neighbours, long batches first, for each costs a process the time
    to start, and shorter ones towards the end, so that no core waits long for another (guided
    self-scheduling: Polychronopoulos & Kuck, 1987). Frames in another order, such as coarse first, are dealt
    out, so that all cores work on the first ones first.
    """
    cores = max(1, cores)
    share = -(-len(numbers) // cores)
    if list(numbers) == sorted(numbers):
        return list(_guided(numbers, cores, max(least, min(MIN_LAST_BATCH, share))))
    size = min(MAX_BATCH, max(least, share))
    hands = [numbers[i : i + size * cores] for i in range(0, len(numbers), size * cores)]
    dealt = (tuple(hand[i::cores]) for hand in hands for i in range(cores))
    return [batch for batch in dealt if batch]


def _guided(numbers: Sequence[int], cores: int, least: int) -> Iterator[tuple[int, ...]]:
    """Yield batches of half of each core's share of what is left."""
    begun = 0
    while begun < len(numbers):
        size = min(MAX_BATCH, max(least, (len(numbers) - begun) // (2 * cores)))
        yield tuple(numbers[begun : begun + size])
        begun += size
