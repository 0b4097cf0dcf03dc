"""Shot files that nobody would write: documents made from the schema, and mutations of the shipped shots.

Reading one must end in a shot or in one of our errors, within bounds of time and memory, with messages of a
length to read. It must write nothing and run no code of the shot.
"""

from __future__ import annotations

import json
import random
import resource
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.plugins.authoring.shot_schemas import shot_schema
from flowsculpt.pipeline.shot import Shot, read_shot

SHOTS = Path(__file__).parents[2] / "shots"

SECONDS, MEBIBYTES = 60, 512
"""Most CPU time and memory that one file may take."""

LONGEST_LINE, MOST_LINES = 2000, 51

STRAYS: tuple[Any, ...] = (
    *(None, True, 0, -1, 1, 7, 10**9, 10**400, 1e308, -1e-320, float("nan"), float("-inf"), 0.5),
    *("", "x", "y", "2", "50%", "é\u202e☃", "a" * 100_000, "[1, 2]", "../../etc/passwd", "/dev/zero", "\x00"),
    *([], [[]], [1], [1, 2, 3], ["a", 1, 1], [0, 0, 0], [None], [1e300, 0, 0], [[1, 2, 3], [4, 5, 6]]),
    *({}, {"keys": {}}, {"keys": {1: 0, 5: "x"}}, {"formula": "x **"}, {"formula": ["t", 0, 0]}, {1: 2}),
    *({"": {}}, {"x": 1, "y": 2, "z": 3}, {"file": "flow.py"}, {"solid": "box", "size": "y"}),
)
"""Values that stand at most places of a shot for none that it takes."""

NAMES = ("keys", "formula", "value", "", "é", "a.b", "0", "size", "solid", "flows", "sum", "type", "x" * 300)

BESIDE = {
    "flow.py": "import os\nos.mkdir('ran')\n\ndef flow(points, time, dt):\n    return points\n",
    "model.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
}
"""Files that mutated shots may name; the Python flow shows whether it ran."""


def stray(rng: random.Random) -> Any:
    """Return a value that rarely belongs where it is put, perhaps nested deep."""
    value = rng.choice(STRAYS)
    for _ in range(rng.choice((0, 0, 0, 1, 2, 70))):
        value = rng.choice(([value], {rng.choice(NAMES): value}, [value, value]))
        if isinstance(value, list) and len(value) == 2:
            value = [value[0]]
    return value


@cache
def _schema() -> dict[str, Any]:
    return shot_schema()


def document(rng: random.Random, form: dict[str, Any] | None = None, depth: int = 0) -> Any:
    """Return a value by a JSON schema, by default a shot; about one in thirty is stray."""
    form = _schema() if form is None else form
    if "$ref" in form:
        return document(rng, _schema()["$defs"][form["$ref"].rpartition("/")[2]], depth)
    if rng.random() < 0.03:
        return stray(rng)
    if "enum" in form or "const" in form:
        return rng.choice(form.get("enum", [form.get("const")]))
    for several in ("anyOf", "oneOf"):
        forms = [one for one in form.get(several, ()) if "required" not in one or "type" in one]
        if forms:
            return document(rng, rng.choice(forms), depth)
    kind = form.get("type")
    kind = rng.choice(kind) if isinstance(kind, list) else kind
    if kind == "object" or "properties" in form:
        return _mapping(rng, form, depth)
    if kind == "array":
        least, most = form.get("minItems", 0), form.get("maxItems", 4)
        count = rng.randint(least, max(least, min(most, 4))) if depth < 12 else least
        return [document(rng, form.get("items", {}), depth + 1) for _ in range(count)]
    if kind in ("number", "integer"):
        low, high = form.get("minimum", -2), form.get("maximum", 10)
        number = rng.uniform(max(low, -100), min(high, 100)) * rng.choice((1, 1, 0.01))
        return round(number) if kind == "integer" or rng.random() < 0.3 else round(number, 3)
    if kind == "boolean":
        return rng.random() < 0.5
    if kind == "string":
        return rng.choice(
            ("clay", "1-12", "x", "sin(t)", "#c04020", "model.obj", "flow.py", "0.5s", "A", "x * y")
        )
    return stray(rng)


def _mapping(rng: random.Random, form: dict[str, Any], depth: int) -> dict[Any, Any]:
    properties = form.get("properties", {})
    needed = [name for name in form.get("required", ()) if name in properties]
    if depth == 0:
        needed = ["title", "frames", "subject", "resample", "flows"]
    most = form.get("maxProperties", 3 if depth < 12 else 0)
    others = rng.sample(sorted(properties), min(len(properties), rng.randint(0, most)))
    names = list(dict.fromkeys([*needed, *others]))[: form.get("maxProperties", 99)]
    if not names and properties and form.get("minProperties"):
        names = [rng.choice(sorted(properties))]
    result = {name: document(rng, properties[name], depth + 1) for name in names}
    if isinstance(form.get("additionalProperties"), dict):
        for key in rng.sample((1, 2, 5, "0.25s", "x", -3), rng.randint(1, 3)):
            result[key] = document(rng, form["additionalProperties"], depth + 1)
    if depth == 0 and rng.random() < 0.95:
        result |= {"title": "Mutated", "frames": "1-12"}
    if rng.random() < 0.02:
        result[rng.choice(NAMES)] = stray(rng)
    return result


def written(value: Any) -> str:
    """Return a value as YAML in one line; all of JSON is YAML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{written(key)}: {written(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(written, value)) + "]"
    if isinstance(value, float):
        return (
            repr(value) if value == value and abs(value) != float("inf") else f".{value}".replace(".-", "-.")
        )
    return json.dumps(value)


_PIECES = tuple(
    rb"""
: |- |{|}|[|]|'|"|#|&a |*a|? |<<: *a|nan|1e999|.inf|null|[]|{}|0x1F|1_000|!!python/name:os.system |%YAML 1.1
""".strip().split(b"|")
)
_PIECES += (b"\t", b"\x00", b"\xff", b"\xef\xbb\xbf", b"\xe2\x80\xa8", b"---\n", b"...\n", b"|\n", b"&a [*a]")
_PIECES += (b"9" * 5000, b"(" * 200, b"[" * 3000, b"- " * 300)


def mutated(rng: random.Random, content: bytes) -> bytes:
    """Return a file with a few mutations of its bytes, words and lines."""
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        content = _mutation(rng, content)
    return content


def _mutation(rng: random.Random, content: bytes) -> bytes:
    at = rng.randrange(len(content) + 1)
    end = min(len(content), at + rng.choice((1, 1, 2, 8, 60)))
    lines = content.split(b"\n")
    line = rng.randrange(len(lines))
    match rng.randrange(8):
        case 0:
            return content[:at] + bytes([rng.randrange(256)]) + content[at + 1 :]
        case 1:
            return content[:at] + content[end:]
        case 2:
            return content[:end] + content[at:]
        case 3:
            return content[:at] + rng.choice(_PIECES) + content[at:]
        case 4:
            return b"\n".join(lines[:line] + lines[line + 1 :])
        case 5:
            other = rng.randrange(len(lines))
            lines[line], lines[other] = lines[other], lines[line]
            return b"\n".join(lines)
        case 6:
            return _with_value(rng, lines, line, written(stray(rng)).encode(errors="replace"))
        case _:
            lines[line] = lines[line][rng.randrange(4) :] if rng.random() < 0.5 else b"  " + lines[line]
            return b"\n".join(lines)


def _with_value(rng: random.Random, lines: list[bytes], line: int, value: bytes) -> bytes:
    """Return the lines with another value after one of the colons of a line."""
    parts = lines[line].split(b": ")
    if len(parts) > 1:
        at = rng.randrange(1, len(parts))
        _, mark, rest = parts[at].partition(rng.choice((b", ", b"}", b"\n")))
        lines[line] = b": ".join([*parts[:at], value + mark + rest, *parts[at + 1 :]])
    return b"\n".join(lines)


def bomb(rng: random.Random) -> bytes:
    """Return a shot whose aliases, keys or nesting grow without limit."""
    head = b"title: A\nframes: 1-12\nsubject: {solid: box}\nresample: off\n"
    match rng.randrange(5):
        case 0:
            width, levels = rng.randint(2, 30), rng.randint(2, 40)
            rows = [b"a0: &a0 [x, x]"]
            rows += [
                b"a%d: &a%d [%s]" % (i, i, b", ".join([b"*a%d" % (i - 1)] * width)) for i in range(1, levels)
            ]
            return head + b"\n".join(rows)
        case 1:
            return (
                head + b"flows: " + b"[{within: {region: {sphere: {radius: 1}}, flows: " * rng.randint(1, 400)
            )
        case 2:
            return head + b"camera: {azimuth: {keys: {%s}}}" % b", ".join(b"%d: 1" % i for i in range(20_000))
        case 3:
            return head + b"? &a [x, [y]]\n: 1\n? " + b"[" * 20 + b"*a, *a" + b"]" * 20 + b"\n: 2\n"
        case _:
            return head + b"flows: [" + b"(, " * rng.randint(1, 20_000) + b"]"


@cache
def shipped() -> tuple[bytes, ...]:
    """Return the contents of the shipped shots and of small shots of every flow."""
    return tuple(path.read_bytes() for path in sorted(SHOTS.glob("*.yaml")))


def shot_file(rng: random.Random) -> bytes:
    """Return a shot file: a mutation of a shipped one, a document of the schema, or a bomb."""
    kind = rng.random()
    if kind < 0.6:
        return mutated(rng, rng.choice(shipped()))
    if kind < 0.997:
        text = "\n".join(f"{written(name)}: {written(item)}" for name, item in _entries(document(rng)))
        return (
            mutated(rng, text.encode(errors="replace"))
            if rng.random() < 0.2
            else text.encode(errors="replace")
        )
    return bomb(rng)


def _entries(value: Any) -> list[tuple[Any, Any]]:
    return list(value.items()) if isinstance(value, dict) else [("title", value)]


SHOT_FILES = st.builds(lambda seed: shot_file(random.Random(seed)), st.integers(0, 2**64))
"""A strategy of shot files; a seed makes the same one again."""


class TooSlowError(BaseException):
    """Raised where reading a file takes longer than SECONDS."""


def fault_of(folder: Path, content: bytes, frames: int = 0) -> str | None:
    """Read a shot file, and simulate `frames` of it if it is good; return what is wrong with how that ends.

    folder  an empty one, in which nothing may be written; the shot file lies below it
    """
    path = folder / "shots" / "a.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    for name, text in BESIDE.items():
        (path.parent / name).write_text(text, encoding="utf-8")
    before, memory = set(folder.rglob("*")), _peak()
    try:
        with _watched():
            shot = read_shot(path)
            _simulated(shot, frames)
    except FlowsculptError as error:
        if error.__cause__ is not None and "by a fault of its own" in str(error):
            return f"an error not foreseen: {error.__cause__!r}"
        if fault := _message_fault(error):
            return fault
    except TooSlowError:
        return f"it takes over {SECONDS} s"
    except Exception as error:
        return f"a traceback: {error!r}"
    if written_files := set(folder.rglob("*")) - before:
        return f"it writes {sorted(written_files)}"
    if _peak() - memory > MEBIBYTES:
        return f"it takes {_peak() - memory:.0f} MiB"
    return None


def _simulated(shot: Shot, frames: int) -> None:
    for _ in islice(animate(shot), frames):
        pass


def _message_fault(error: FlowsculptError) -> str | None:
    lines = str(error).split("\n")
    longest = max(map(len, lines))
    if error.exit_code not in (1, 2, 3):
        return f"exit code {error.exit_code}"
    return (
        f"{len(lines)} lines of up to {longest} characters"
        if longest > LONGEST_LINE or len(lines) > MOST_LINES
        else None
    )


def _peak() -> float:
    """Return the most memory that this process has held (MiB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        1 << 20 if sys.platform == "darwin" else 1024
    )


@contextmanager
def _watched() -> Iterator[None]:
    """Raise TooSlowError after SECONDS of this process's CPU time."""

    def end(signum: int, frame: Any) -> None:
        raise TooSlowError

    former = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, former)


def faults(folder: Path, seconds: float, seed: int) -> Iterator[tuple[bytes, str]]:
    """Try new files for some seconds; yield those that end wrongly, and how."""
    end, rng = time.monotonic() + seconds, random.Random(seed)
    while time.monotonic() < end:
        content = shot_file(rng)
        fault = fault_of(folder, content, frames=3 if rng.random() < 0.05 else 0)
        if fault:
            yield content, fault
