"""Mutations of files: of bytes, of numbers and lines in text, and of what containers hold."""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from random import Random
from typing import Any

INTEGERS = (0, 1, 2, 127, 128, 255, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 10**7, 10**9)

WORDS = (
    *("-1", "0", "1", "3", "99999999999", "-99999999999", "4294967296", "1e300", "-1e300", "1e-300", "1e13"),
    *(
        "nan",
        "inf",
        "-inf",
        "1e999",
        "0x10",
        "1_0",
        "٣",
        "",
        "a",
        "[",
        "{",
        '"',
        "../../x",
        "/dev/zero",
        "uint8",
    ),
    *("float", "list", "1" * 5000, "x" * 5000, "\x00", "\ufeff", "1/1/1", "1//", "/", "\\"),
)

MOST_BYTES = 16 << 20
"""Size of the largest mutated file: repeated lines grow fast, and reading takes time in proportion."""

_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")


def mutated(content: bytes, random: Random) -> bytes:
    """Return the content with one to four mutations."""
    structural = next((change for mark, change in _STRUCTURES.items() if content.startswith(mark)), None)
    for _ in range(random.choice((1, 1, 1, 2, 2, 4))):
        kinds: list[Callable[[bytes, Random], bytes]] = [_bytes, _integer, _blocks]
        if _is_text(content):
            kinds = [_bytes, _number, _number, _number, _lines, _lines]
        elif _NUMBER.search(content[:300]):
            kinds.append(_number)
        if structural is not None:
            kinds += 3 * [structural]
        try:
            changed = random.choice(kinds)(content, random)
            content = changed if len(changed) < MOST_BYTES else content
        except Exception:  # it is no container any more
            content = _bytes(content, random)
    return content


def _is_text(content: bytes) -> bool:
    return b"\x00" not in content[:400] and sum(byte > 127 for byte in content[:400]) < 8


def _place(content: bytes, random: Random) -> int:
    """Return a place, in every third case near the beginning, where headers are."""
    end = min(len(content), 128) if random.random() < 0.33 else len(content)
    return random.randrange(end + 1)


def _bytes(content: bytes, random: Random) -> bytes:
    at = _place(content, random)
    kind = random.randrange(4)
    if kind == 0 and at < len(content):
        return content[:at] + bytes([content[at] ^ 1 << random.randrange(8)]) + content[at + 1 :]
    if kind == 1:
        return content[:at] + random.randbytes(random.choice((1, 1, 4, 40))) + content[at:]
    if kind == 2:
        return content[:at] + random.randbytes(1) + content[at + 1 :]
    return content[:at]


def _integer(content: bytes, random: Random) -> bytes:
    at, size = _place(content, random), random.choice((1, 2, 4, 4, 8))
    value = random.choice((*INTEGERS, random.getrandbits(32))) % (1 << 8 * size)
    return content[:at] + value.to_bytes(size, random.choice(("little", "big"))) + content[at + size :]


def _blocks(content: bytes, random: Random) -> bytes:
    first, last = sorted((_place(content, random), _place(content, random)))
    block = content[first:last]
    if random.random() < 0.5:
        return content[:first] + content[last:]
    at = _place(content, random)
    return content[:at] + block * random.choice((1, 1, 3)) + content[at:]


def _number(content: bytes, random: Random) -> bytes:
    found = list(_NUMBER.finditer(content))
    if not found:
        return _bytes(content, random)
    match = random.choice(found[:12] if random.random() < 0.4 else found)
    word = random.choice(WORDS).encode()
    return content[: match.start()] + word + content[match.end() :]


def _lines(content: bytes, random: Random) -> bytes:
    lines = content.split(b"\n")
    k = random.randrange(len(lines))
    words = lines[k].split(b" ")
    match random.randrange(6):
        case 0:
            del lines[k]
        case 1:
            lines[k:k] = [lines[random.randrange(len(lines))]] * random.choice((1, 1, 200))
        case 2:
            lines[k] = b" ".join(words * random.choice((2, 100)))
        case 3:
            words[random.randrange(len(words))] = random.choice(WORDS).encode()
            lines[k] = b" ".join(words)
        case 4:
            other = random.randrange(len(lines))
            lines[k], lines[other] = lines[other], lines[k]
        case _:
            del words[random.randrange(len(words))]
            lines[k] = b" ".join(words)
    return b"\n".join(lines)


def _archive(content: bytes, random: Random) -> bytes:
    """Change a member of a zip and pack it anew, so that its sums are right."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = random.choice(sorted(members))
    change = random.randrange(4)
    if change == 0:
        del members[name]
    elif change == 1:
        members[random.choice(("x.npy", "../../x.npy", "points.npy", "a/b.npy", "x" * 300))] = members[name]
    elif change == 2:
        members[name] = _number(members[name], random)
    else:
        members[name] = _bytes(members[name], random)
    file = io.BytesIO()
    method = random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA))
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, member in members.items():
            archive.writestr(name, member)
    return file.getvalue()


def _png(content: bytes, random: Random) -> bytes:
    """Change a chunk of a PNG and mend its sum."""
    at, chunks = 8, []
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        chunks.append([content[at + 4 : at + 8], content[at + 8 : at + 8 + length]])
        at += 12 + length
    chunk = random.choice(chunks)
    if chunk[0] == b"IDAT" and random.random() < 0.5:
        chunk[1] = zlib.compress(_integer(zlib.decompress(chunk[1]), random))
    else:
        chunk[1] = random.choice((_integer, _bytes))(chunk[1], random)
    packed = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
    return content[:8] + b"".join(packed)


def _glb(content: bytes, random: Random) -> bytes:
    """Change a value in the JSON of a GLB and mend its lengths."""
    (length,) = struct.unpack_from("<I", content, 12)
    scene, rest = json.loads(content[20 : 20 + length]), content[20 + length :]
    _change_value(scene, random)
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    head = b"glTF" + struct.pack("<II", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I", len(text)) + b"JSON" + text + rest


def _change_value(tree: Any, random: Random) -> None:
    """Replace or remove one value somewhere in a tree of lists and mappings."""
    while True:
        keys = sorted(tree) if isinstance(tree, dict) else range(len(tree))
        if not keys:
            return
        key = random.choice(list(keys))
        if isinstance(tree[key], dict | list) and tree[key] and random.random() < 0.85:
            tree = tree[key]
            continue
        if random.random() < 0.15:
            del tree[key]
        else:
            values = (0, 1, -1, 5, 2**31, 2**40, 1e300, "x", "", None, [], {}, [0], 5120, 5121, 5125, True)
            tree[key] = random.choice((*values, "../../../etc/passwd", "data:;base64,AAAA", "VEC3", "SCALAR"))
        return


_STRUCTURES: dict[bytes, Callable[[bytes, Random], bytes]] = {
    b"PK": _archive,
    b"\x89PNG": _png,
    b"glTF": _glb,
}
