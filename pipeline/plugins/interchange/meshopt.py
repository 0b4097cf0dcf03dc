"""Decode buffer views of glTF that meshoptimizer compressed: EXT_ and KHR_meshopt_compression.

The bitstream is the one that appendix A of these extensions of Khronos describes, in the versions 0 and 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

T = TypeVar("T")

_GROUP = 16  # elements whose deltas take the same number of bits

_BITS = {"version 0": (0, 2, 4, 8), 0: (0, 1, 2, 4), 1: (1, 2, 4, 8)}
"""Bits of a delta by the two header bits of its group: in version 0, and by control mode in version 1."""

_ALL_ZERO, _LITERAL = 2, 3
"""Control modes of bytes that are all 0, and that are stored one by one."""


def decode_attributes(data: bytes, count: int, stride: int) -> np.ndarray:
    """Decode `count` elements of `stride` bytes; return them as uint8 (count, stride).

    Raises ValueError where the stream is damaged.
    """
    if stride % 4 or not 4 <= stride <= 256:
        raise ValueError(f"its elements have {stride} bytes; they may have 4, 8, … to 256")
    if data[:1] not in (b"\xa0", b"\xa1"):
        raise ValueError("it does not begin like a compressed attribute")
    channels = stride // 4 if data[0] & 1 else 0
    tail = len(data) - stride - channels
    end = len(data) - max(stride + channels, 24 if channels else 32)
    if end < 1:
        raise _ended()
    deltas = _deltas(data, end, count, stride, bool(channels))
    baseline = np.frombuffer(data, np.uint8, stride, tail)
    modes = data[tail + stride :] or bytes(stride // 4)
    elements = np.empty((count, stride), np.uint8)
    for channel, mode in enumerate(modes):
        at = slice(4 * channel, 4 * channel + 4)
        elements[:, at] = _sum_up(deltas[at, :count], baseline[at], mode)
    return elements


def _ended() -> ValueError:
    return ValueError("it ends early")


def _deltas(data: bytes, end: int, count: int, stride: int, has_control: bool) -> np.ndarray:
    """Return the stored deltas as uint8 (stride, count rounded up to whole groups)."""
    stream = np.frombuffer(data, np.uint8)
    row = -(-count // _GROUP)
    deltas = np.zeros((stride, row * _GROUP), np.uint8)
    groups: dict[int, list[tuple[int, int]]] = {bits: [] for bits in (1, 2, 4, 8)}
    """By bits, where each group begins in the stream, and where its deltas go."""
    sentinels = {bits: _running_count(stream, bits) for bits in (1, 2, 4)}
    per_block = min(8192 // stride & ~(_GROUP - 1), 256)
    at = 1
    for first in range(0, count, per_block):
        here = min(per_block, count - first)
        control, at = (data[at : at + stride // 4], at + stride // 4) if has_control else (b"", at)
        for byte in range(stride):
            mode = control[byte >> 2] >> 2 * (byte & 3) & 3 if has_control else "version 0"
            if mode == _ALL_ZERO:
                continue
            if mode == _LITERAL:
                if at + here > end:
                    raise _ended()
                deltas[byte, first : first + here] = stream[at : at + here]
                at += here
                continue
            bits_by_header = _BITS[mode]
            header, whole = at, -(-here // _GROUP)
            at += -(-whole // 4)
            target = byte * row + first // _GROUP
            for group in range(whole):
                if at > end:
                    raise _ended()
                bits = bits_by_header[data[header + (group >> 2)] >> 2 * (group & 3) & 3]
                if not bits:
                    continue
                groups[bits].append((at, target + group))
                after = at + 2 * bits
                if bits < 8:
                    running = sentinels[bits]
                    after += running[min(after, end)] - running[at]
                at = after
        if at > end:
            raise _ended()
    if at != end:
        raise ValueError("bytes are left over at its end")
    flat = deltas.reshape(-1, _GROUP)
    for bits, places in groups.items():
        if places:
            starts, targets = np.array(places).T
            flat[targets] = _unpacked(stream, starts, bits)
    return deltas


def _fields(stream: np.ndarray, bits: int) -> np.ndarray:
    """Return the deltas of `bits` bits in each byte, uint8 (…, 8 / bits), in the order of the elements."""
    shifts = np.arange(0, 8, bits, dtype=np.uint8)
    if bits > 1:
        shifts = shifts[::-1]
    return (stream[..., None] >> shifts) & np.uint8((1 << bits) - 1)


def _running_count(stream: np.ndarray, bits: int) -> memoryview:
    """Return how many deltas with all bits set the bytes before each byte hold; their values follow."""
    of_byte = (_fields(np.arange(256, dtype=np.uint8), bits) == (1 << bits) - 1).sum(axis=1)
    running = np.zeros(len(stream) + 1, np.int64)
    np.cumsum(of_byte[stream], out=running[1:])
    return memoryview(running.data)


def _unpacked(stream: np.ndarray, starts: np.ndarray, bits: int) -> np.ndarray:
    """Return the deltas of groups, uint8 (G, 16)."""
    packed = stream[starts[:, None] + np.arange(2 * bits)]
    if bits == 8:
        return packed
    values = _fields(packed, bits).reshape(len(starts), _GROUP)
    is_stored = values == (1 << bits) - 1
    places = (starts + 2 * bits)[:, None] + np.cumsum(is_stored, axis=1) - 1
    values[is_stored] = stream[places[is_stored]]
    return values


def _sum_up(deltas: np.ndarray, baseline: np.ndarray, mode: int) -> np.ndarray:
    """Return the bytes (count, 4) of a channel from its deltas (4, count) and the element before them."""
    kind, rotation = mode & 15, mode >> 4
    if kind > 2 or (rotation and kind != 2):
        raise ValueError(f"it has a channel of mode {mode}; there are 0, 1 and 2")
    width = ("<u1", "<u2", "<u4")[kind]
    change = np.ascontiguousarray(deltas.T).view(width)
    first = np.ascontiguousarray(baseline).view(width)
    if kind == 2:
        turned = change if not rotation else (change >> rotation) | (change << (32 - rotation))
        summed = np.bitwise_xor.accumulate(turned, axis=0) ^ first
    else:
        one = change.dtype.type(1)
        signed = (change >> one) ^ (~(change & one) + one)
        summed = np.cumsum(signed, axis=0, dtype=change.dtype) + first
    return summed.astype(width).view(np.uint8)


def decode_indices(data: bytes, count: int, stride: int) -> np.ndarray:
    """Decode a sequence of indices; return uint16 or uint32 (count,). Raises ValueError."""
    if data[:1] not in (b"\xd0", b"\xd1"):
        raise ValueError("it does not begin like a compressed sequence of indices")
    stream, last = iter(data[1 : max(1, len(data) - 4)]), [0, 0]
    indices = np.empty(count, np.uint32)
    for k in range(count):
        value = _number(stream)
        last[value & 1] += ~(value >> 2) if value & 2 else value >> 2
        indices[k] = last[value & 1] & 0xFFFFFFFF
    return _of_stride(indices, stride)


def decode_triangles(data: bytes, count: int, stride: int) -> np.ndarray:
    """Decode the `count` indices of triangles; return uint16 or uint32 (count,). Raises ValueError."""
    if count % 3:
        raise ValueError(f"it has {count} indices; those of triangles come in threes")
    if data[:1] not in (b"\xe0", b"\xe1"):
        raise ValueError("it does not begin like compressed triangles")
    triangles, end = count // 3, len(data) - 16
    if end < 1 + triangles:
        raise _ended()
    decoder = _TriangleDecoder(data, 1 + triangles, end, data[0] & 15)
    indices: list[int] = []
    for code in data[1 : 1 + triangles]:
        indices += decoder.triangle(code)
    return _of_stride(np.array(indices, np.int64), stride)


def _of_stride(indices: np.ndarray, stride: int) -> np.ndarray:
    if stride not in (2, 4):
        raise ValueError(f"its indices have {stride} bytes; they may have 2 or 4")
    kept: np.ndarray = indices.astype(np.uint16 if stride == 2 else np.uint32)
    if (kept != indices).any():
        raise ValueError(f"an index is {int(indices[kept != indices][0])}, too large for {stride} bytes")
    return kept


def _number(stream: Iterator[int]) -> int:
    """Return the next number of a stream of bytes: 7 bits a byte, the lowest first."""
    value = shift = 0
    for byte in stream:
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value & 0xFFFFFFFF
        if shift > 28:
            raise ValueError("one of its numbers has over 5 bytes")
    raise _ended()


def _present(entry: T | None) -> T:
    """Return an entry of a queue. Raises ValueError if it is still None."""
    if entry is None:
        raise ValueError("it names an edge or a vertex before there is one")
    return entry


class _TriangleDecoder:
    """The state while triangles are decoded: recent edges and vertices, the next new vertex, and the last."""

    def __init__(self, data: bytes, at: int, end: int, version: int) -> None:
        self._stream, self._table = iter(data[at:end]), data[end:]
        self._next = self._last = 0
        self._edges: list[tuple[int, int] | None] = [None] * 16
        self._vertices: list[int | None] = [None] * 16
        self._edge = self._vertex = 0
        self._recent = 13 if version else 15
        """The first low half of a code that does not name a recent vertex."""

    def triangle(self, code: int) -> tuple[int, int, int]:
        """Decode the triangle of a code byte. Raises ValueError where it names an entry that is empty."""
        high, low = code >> 4, code & 15
        if high == 15:
            return self._without_edge(low)
        a, b = _present(self._edges[self._edge - 1 - high & 15])
        if 0 < low < self._recent:
            c = _present(self._vertices[self._vertex - 1 - low & 15])
        else:
            if low == 0:
                c = self._new()
            elif low == 15:
                c = self._named()
            else:
                c = self._last = self._last + (1 if low == 14 else -1) & 0xFFFFFFFF
            self._push(c)
        self._push_edge(c, b)
        self._push_edge(a, c)
        return a, b, c

    def _without_edge(self, low: int) -> tuple[int, int, int]:
        """Decode a triangle whose three vertices are named by a table, or one by one."""
        pair = self._table[low] if low < 14 else self._byte()
        if low >= 14 and pair == 0:
            self._next = 0
        a = self._named() if low == 15 else self._new()
        b, b_is_new = self._vertex_of(pair >> 4, low >= 14)
        c, c_is_new = self._vertex_of(pair & 15, low >= 14)
        self._push(a)
        for vertex, is_new in ((b, b_is_new), (c, c_is_new)):
            if is_new:
                self._push(vertex)
        self._push_edge(b, a)
        self._push_edge(c, b)
        self._push_edge(a, c)
        return a, b, c

    def _vertex_of(self, entry: int, may_be_named: bool) -> tuple[int, bool]:
        """Return a vertex, and whether the queue of recent ones lacks it."""
        if entry == 15 and may_be_named:
            return self._named(), True
        if entry == 0:
            return self._new(), True
        return _present(self._vertices[self._vertex - entry & 15]), False

    def _new(self) -> int:
        self._next += 1
        return self._next - 1

    def _byte(self) -> int:
        byte = next(self._stream, None)
        if byte is None:
            raise _ended()
        return byte

    def _named(self) -> int:
        value = _number(self._stream)
        self._last = self._last + (~(value >> 1) if value & 1 else value >> 1) & 0xFFFFFFFF
        return self._last

    def _push(self, vertex: int) -> None:
        self._vertices[self._vertex] = vertex
        self._vertex = self._vertex + 1 & 15

    def _push_edge(self, a: int, b: int) -> None:
        self._edges[self._edge] = (a, b)
        self._edge = self._edge + 1 & 15


MODES: dict[str, Callable[[bytes, int, int], np.ndarray]] = {
    "ATTRIBUTES": decode_attributes,
    "TRIANGLES": decode_triangles,
    "INDICES": decode_indices,
}


def exponential(elements: np.ndarray) -> np.ndarray:
    """Return the floats of the filter EXPONENTIAL: 24 bits of mantissa and 8 of exponent, as bytes."""
    packed = np.ascontiguousarray(elements).view("<i4")
    values = np.ldexp((packed << 8 >> 8).astype(np.float32), packed >> 24)
    return values.astype("<f4").view(np.uint8)


def quaternions(elements: np.ndarray) -> np.ndarray:
    """Return the rotations of the filter QUATERNION, normalized int16 (N, 4), as bytes."""
    packed = np.ascontiguousarray(elements).view("<i2").astype(np.int32)
    one = (packed[:, 3:] | 3).astype(np.float32)
    three = packed[:, :3] / one * np.float32(0.5**0.5)
    largest = np.sqrt(np.maximum(0.0, 1.0 - (three**2).sum(axis=1, keepdims=True)))
    scaled = 32767.0 * np.concatenate([largest, three], axis=1)
    whole = np.copysign(np.floor(np.abs(scaled) + 0.5), scaled).astype("<i2")
    places = (packed[:, 3:] + np.arange(4)) & 3
    turned = np.empty_like(whole)
    np.put_along_axis(turned, places, whole, axis=1)
    return turned.view(np.uint8)


FILTERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "NONE": lambda elements: elements,
    "EXPONENTIAL": exponential,
    "QUATERNION": quaternions,
}
"""The filters of data that places vertices; OCTAHEDRAL is for normals, COLOR for colours."""
