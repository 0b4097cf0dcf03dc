"""Encode buffer views of glTF by EXT_meshopt_compression, whose decoder is `meshopt`.

Attributes are written in version 0 of the bitstream, the one that this extension allows.
"""

from __future__ import annotations

import numpy as np

from flowsculpt.api.meshes import Floats, Indices

_GROUP = 16  # elements whose deltas take the same number of bits

_TAIL = 32  # bytes that decoders may read beyond the blocks


def encode_attributes(elements: np.ndarray) -> bytes:
    """Encode elements, uint8 (N, S), S a multiple of 4 up to 256, each like its predecessor.

    Each byte is stored as its difference from that of the preceding element, in groups of 16 elements of 0,
    2, 4 or 8 bits, whichever takes the fewest bytes; differences that need more bits follow their group.
    """
    count, stride = elements.shape
    per_block = min(8192 // stride & ~(_GROUP - 1), 256) // _GROUP  # groups in a block
    groups = -(-count // _GROUP)
    blocks = -(-groups // per_block)
    change = np.diff(elements, axis=0, prepend=elements[:1]).view(np.int8)
    zigzag = np.zeros((blocks * per_block * _GROUP, stride), np.uint8)
    zigzag[:count] = (change << 1) ^ (change >> 7)
    deltas = np.ascontiguousarray(zigzag.reshape(blocks, per_block, _GROUP, stride).transpose(0, 3, 1, 2))
    costs = [np.where(deltas.any(axis=3), 255, 0), *(_cost(deltas, bits) for bits in (2, 4))]
    sizes = np.stack([*costs, np.full_like(costs[0], _GROUP)])
    codes = np.argmin(sizes, axis=0)  # (blocks, stride, groups of a block)
    sizes = np.take_along_axis(sizes, codes[None], axis=0)[0]
    in_block = np.minimum(per_block, groups - per_block * np.arange(blocks))
    sizes[np.arange(per_block) >= in_block[:, None, None].repeat(stride, axis=1)] = 0
    heads = np.broadcast_to(-(-in_block[:, None] // 4), (blocks, stride))
    ends = np.cumsum((heads + sizes.sum(axis=2)).reshape(-1)).reshape(blocks, stride)
    starts = ends - sizes.sum(axis=2)  # of the first group; the head lies before it
    content = np.zeros(int(ends[-1, -1]), np.uint8)
    _write_heads(content, codes, starts - heads, heads)
    places = starts[:, :, None] + np.cumsum(sizes, axis=2) - sizes
    for code, bits in ((1, 2), (2, 4), (3, 8)):
        chosen = (codes == code) & (sizes > 0)
        _write_groups(content, deltas[chosen], places[chosen], bits)
    padding = bytes(max(_TAIL - stride, 0))
    return b"\xa0" + content.tobytes() + padding + elements[0].tobytes()


def _cost(deltas: np.ndarray, bits: int) -> np.ndarray:
    """Return the bytes that groups of deltas (…, 16) take with so many bits a delta."""
    return 2 * bits + (deltas >= (1 << bits) - 1).sum(axis=-1)


def _write_heads(content: np.ndarray, codes: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> None:
    """Write the codes of groups, four in a byte, the first in the lowest bits."""
    padded = np.zeros((*codes.shape[:2], -(-codes.shape[2] // 4), 4), np.uint8)
    padded.reshape(*codes.shape[:2], -1)[..., : codes.shape[2]] = codes
    packed = (padded << np.array([0, 2, 4, 6], np.uint8)).sum(axis=3, dtype=np.uint8)
    column = np.arange(packed.shape[2])
    held = column < lengths[..., None]
    content[(starts[..., None] + column)[held]] = packed[held]


def _write_groups(content: np.ndarray, deltas: np.ndarray, places: np.ndarray, bits: int) -> None:
    """Write groups of deltas (N, 16) at places (N,) with so many bits a delta."""
    if bits == 8:
        content[places[:, None] + np.arange(_GROUP)] = deltas
        return
    longest, each = np.uint8((1 << bits) - 1), 8 // bits
    fields = np.minimum(deltas, longest).reshape(len(deltas), 2 * bits, each)
    shifts = np.arange(8 - bits, -1, -bits, dtype=np.uint8)
    content[places[:, None] + np.arange(2 * bits)] = (fields << shifts).sum(axis=2, dtype=np.uint8)
    is_longer = deltas >= longest
    beyond = places[:, None] + 2 * bits + np.cumsum(is_longer, axis=1) - 1
    content[beyond[is_longer]] = deltas[is_longer]


_NEAR = 30  # a difference from which on the other of the two recent indices is the better base


def encode_indices(indices: Indices) -> bytes:
    """Encode a sequence of indices, each by its difference from one of two recent ones."""
    content, last, base = bytearray(b"\xd1"), [0, 0], 0
    for index in indices.reshape(-1).tolist():
        base ^= abs(index - last[base]) >= _NEAR
        change = index - last[base]
        value = (2 * change if change >= 0 else -2 * change - 1) << 1 | base
        last[base] = index
        while value > 127:
            content.append(value & 127 | 128)
            value >>= 7
        content.append(value)
    return bytes(content) + bytes(4)


def exponential_elements(values: Floats, exponent: int) -> np.ndarray:
    """Return values (N, C) as multiples of 2 to an exponent, as the filter EXPONENTIAL has them, uint8."""
    mantissa = np.rint(np.ldexp(values, -exponent)).astype(np.int32)
    return np.ascontiguousarray((mantissa & 0xFFFFFF) | (exponent << 24), "<i4").view(np.uint8)
