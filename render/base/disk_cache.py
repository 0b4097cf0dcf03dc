"""Answers that took a process of their own to find, kept in the user's cache."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import platformdirs


def place_of(kind: str, depends_on: Sequence[str]) -> Path:
    """The file that holds an answer; its name is a hash of all that the answer depends on."""
    name = hashlib.blake2b("\n".join(depends_on).encode(), digest_size=12).hexdigest()
    return platformdirs.user_cache_path("flowsculpt") / kind / f"{name}.json"


def recall(place: Path) -> dict[str, Any] | None:
    """What was found before, or None."""
    try:
        answer = json.loads(place.read_text())
    except (OSError, ValueError):
        return None
    return answer if isinstance(answer, dict) else None


def remember(place: Path, answer: dict[str, Any]) -> None:
    """Write the answer; a cache that cannot be written only means to ask again."""
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=place.parent, suffix=".tmp", delete=False) as file:
            json.dump(answer, file)
        Path(file.name).replace(place)
    except OSError:
        return
