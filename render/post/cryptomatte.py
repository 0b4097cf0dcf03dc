"""Cryptomatte: mattes of objects and materials that a compositor picks by a click.

After Friedman and Jones, *Fully automatic ID mattes with support for motion blur and transparency* (2015),
and Psyop's Cryptomatte specification 1.2. Each name is hashed to a 32-bit number, which is stored as a float:
the ID. Layers hold the IDs of a pixel, each with its coverage, the greatest coverage first: two pairs of ID
and coverage in the four channels of a layer. The header has the names and their hashes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.scene.aovs import MOST_RANKS, Pixels

OBJECT, ASSET, MATERIAL = "CryptoObject", "CryptoAsset", "CryptoMaterial"
"""Names of the sets of mattes."""


def murmur_hash(name: str) -> int:
    """Return the 32-bit MurmurHash3 (Appleby 2011) of a name in UTF-8, with seed 0."""
    data, value = name.encode(), 0
    whole = len(data) // 4 * 4
    for start in range(0, whole, 4):
        value ^= _mixed(int.from_bytes(data[start : start + 4], "little"))
        value = (_rotated(value, 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    value ^= _mixed(int.from_bytes(data[whole:], "little")) ^ len(data)
    value = (value ^ value >> 16) * 0x85EBCA6B & 0xFFFFFFFF
    value = (value ^ value >> 13) * 0xC2B2AE35 & 0xFFFFFFFF
    return value ^ value >> 16


def _mixed(block: int) -> int:
    return _rotated(block * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593 & 0xFFFFFFFF


def _rotated(value: int, bits: int) -> int:
    return (value << bits | value >> 32 - bits) & 0xFFFFFFFF


def id_bits(name: str) -> int:
    """Return the bits of a name's ID: its hash, with one bit flipped where it is no normal float."""
    value = murmur_hash(name)
    return value ^ 1 << 23 if value >> 23 & 255 in (0, 255) else value


@dataclass(frozen=True, eq=False)
class RankedCoverage:
    """Coverage of pixels by objects that are too many for a plane each.

    names    of all objects; object 1 is the first
    numbers  (K, H, W) of the objects that a pixel shows; 0 for none
    weights  (K, H, W): its coverage by each
    """

    names: Sequence[str]
    numbers: Pixels
    weights: Pixels


def cryptomatte_layers(
    crypto: str, coverage: Mapping[str, Pixels], more: RankedCoverage | None = None
) -> dict[str, Pixels]:
    """Return the layers (H, W, 4) of a set of mattes by name: CryptoObject00, CryptoObject01, …

    crypto    OBJECT, ASSET or MATERIAL
    coverage  coverage (H, W) of the pixel by name; names without coverage take part, so that all frames of
              a shot have the same layers
    more      further objects
    """
    names = [*coverage, *(more.names if more else ())]
    floats = _floats(list(coverage))
    planes = [np.asarray(plane, dtype=np.float32) for plane in coverage.values()]
    ids = [np.full_like(plane, number) for plane, number in zip(planes, floats, strict=True)]
    if more is not None:
        known = np.concatenate([np.zeros(1, np.float32), _floats(list(more.names))])
        ids += list(known[more.numbers.astype(np.int64)])
        planes += list(more.weights.astype(np.float32))
    weights, numbers = np.stack(planes), np.stack(ids)
    order = np.argsort(-weights, axis=0, kind="stable")
    count = -(-min(len(names), MOST_RANKS) // 2)
    ranked = np.zeros((2 * count, 2, *weights.shape[1:]), dtype=np.float32)
    used = min(len(planes), 2 * count)
    ranked[:used, 1] = np.take_along_axis(weights, order, axis=0)[:used]
    sorted_ids = np.take_along_axis(numbers, order, axis=0)[:used]
    ranked[:used, 0] = np.where(ranked[:used, 1] > 0.0, sorted_ids, np.float32(0.0))
    layers = np.moveaxis(ranked.reshape(count, 4, *weights.shape[1:]), 1, -1)
    return {f"{crypto}{index:02d}": layer for index, layer in enumerate(layers)}


def _floats(names: Sequence[str]) -> NDArray[np.float32]:
    """Return the IDs (N,) of names."""
    return np.array([id_bits(name) for name in names], dtype=np.uint32).view(np.float32)


def matte_of(name: str, crypto: str, layers: Mapping[str, Pixels]) -> NDArray[np.float32]:
    """Return the coverage (H, W) of a name, as a compositor's Cryptomatte node picks it."""
    own = np.uint32(id_bits(name))
    ranked = [layer for label, layer in layers.items() if label.startswith(crypto)]
    pairs = [(layer[..., first], layer[..., first + 1]) for layer in ranked for first in (0, 2)]
    found = [np.where(_bits(ids) == own, weights, np.float32(0.0)) for ids, weights in pairs]
    return np.sum(found, axis=0, dtype=np.float32)


def _bits(ids: Pixels) -> NDArray[np.uint32]:
    return np.ascontiguousarray(ids, dtype=np.float32).view(np.uint32)


def cryptomatte_header(label: str, names: list[str]) -> dict[str, str]:
    """Return the entries of the EXR's header for a set of mattes.

    label  the name of its layers in the file, without their numbers: CryptoObject, ViewLayer.CryptoObject
    """
    prefix = f"cryptomatte/{murmur_hash(label):08x}"[: len("cryptomatte/") + 7]
    manifest = {name: f"{id_bits(name):08x}" for name in names}
    return {
        f"{prefix}/name": label,
        f"{prefix}/hash": "MurmurHash3_32",
        f"{prefix}/conversion": "uint32_to_float32",
        f"{prefix}/manifest": json.dumps(manifest, separators=(",", ":")),
    }
