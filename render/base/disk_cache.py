"""A disk cache for answers that are slow to find: small JSON files in the user's cache folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from render.base.atomic_write import atomic_write
from render.base.render_errors import MachineError
from render.base.user_cache import readable_cache


def cache_path(kind: str, depends_on: Sequence[str], suffix: str = ".json") -> Path:
    """Return the file of an answer. Its name is a hash of all that the answer depends on."""
    name = hashlib.blake2b("\n".join(depends_on).encode(), digest_size=12).hexdigest()
    return readable_cache() / kind / f"{name}{suffix}"


def load_answer(path: Path) -> dict[str, Any] | None:
    """Return the stored answer, or None where there is none that can be read."""
    try:
        answer = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return answer if isinstance(answer, dict) else None


def store_answer(path: Path, answer: dict[str, Any]) -> None:
    """Store an answer. A folder that cannot be written only means that the next process asks again."""
    with suppress(MachineError), atomic_write(path, flush=False) as draft:
        draft.write_text(json.dumps(answer), encoding="utf-8")
