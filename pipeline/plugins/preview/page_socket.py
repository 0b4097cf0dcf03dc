"""A connection over which a page sends one message after another: WebSocket, RFC 6455.

A request for each movement of a hand would keep browser and server busy for longer than the picture that
follows from it.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator
from io import BufferedIOBase

SALT = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # by which a server shows that it knows the protocol

TEXT, BINARY, CLOSE = 1, 2, 8  # what a frame is; 0 is the next part of a message

LAST, MASKED, SHORT = 0x80, 0x80, 0x7F
"""Bits of the two bytes at the head of a frame, and those of its length."""


def answer_to(key: str) -> str:
    """Return the header `Sec-WebSocket-Accept` for a page that asks with this key."""
    return base64.b64encode(hashlib.sha1(f"{key}{SALT}".encode()).digest()).decode()


def messages(file: BufferedIOBase, most: int) -> Iterator[bytes]:
    """Yield the messages of a page, of at most so many bytes, until it ends or breaks the rules."""
    message = b""
    while len(head := file.read(2)) == 2:
        kind, length = head[0] & 0x0F, head[1] & SHORT
        if length > 125:
            length = int.from_bytes(file.read(2 if length == 126 else 8))
        if kind == CLOSE or not head[1] & MASKED or len(message) + length > most:
            return
        mask, content = file.read(4), file.read(length)
        if len(content) < length:
            return
        if kind > BINARY:
            continue  # a sign of life
        repeated = (mask * (length // 4 + 1))[:length]
        message += (int.from_bytes(content) ^ int.from_bytes(repeated)).to_bytes(length)
        if head[0] & LAST:
            yield message
            message = b""


def frame_of(words: str) -> bytes:
    """Return a message to a page, of less than 64 KiB."""
    content = words.encode()
    short = len(content) <= 125
    length = bytes([len(content)]) if short else bytes([126]) + len(content).to_bytes(2)
    return bytes([LAST | TEXT]) + length + content
