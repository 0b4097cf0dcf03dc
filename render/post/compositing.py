"""Layers for compositing: what a finished frame has besides its light, computed from the raw AOVs.

Raw AOVs are means over the pixel, so at outlines they mix the subject with what is behind it. A subject at
distance 6 before a wall at 20 is nothing at 13: depth, position and motion vectors of such a pixel are those
of its greater part, taken from neighbouring pixels that show nothing else.

Cryptomattes are mattes of objects and materials that a compositor picks by a click, after Friedman and Jones,
*Fully automatic ID mattes with support for motion blur and transparency* (2015), and Psyop's Cryptomatte
specification 1.2. Each name is hashed to a 32-bit number, which is stored as a float: the ID. Layers hold the
IDs of a pixel, each with its coverage, the greatest coverage first: two pairs of ID and coverage in the four
channels of a layer. The header has the names and their hashes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flowsculpt.render.post.exr_names import cryptomatte_label
from flowsculpt.render.scene.aovs import COPIES, COVERAGE, MOST_RANKS, Pixels, RenderedFrame
from flowsculpt.render.scene.render_camera import Camera, pixel_places
from flowsculpt.render.scene.scene_stage import Stage, StagePlacement

Doubles = NDArray[np.float64]

OBJECT, ASSET, MATERIAL = "CryptoObject", "CryptoAsset", "CryptoMaterial"  # names of the sets of mattes


def murmur_hash(name: str) -> int:
    """Return the 32-bit MurmurHash3 (Appleby 2011) of a name in UTF-8, with seed 0."""
    data, value = name.encode(), 0
    whole = len(data) // 4 * 4
    for start in range(0, whole, 4):
        value ^= _mix(int.from_bytes(data[start : start + 4], "little"))
        value = (_rotate(value, 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    value ^= _mix(int.from_bytes(data[whole:], "little")) ^ len(data)
    value = (value ^ value >> 16) * 0x85EBCA6B & 0xFFFFFFFF
    value = (value ^ value >> 13) * 0xC2B2AE35 & 0xFFFFFFFF
    return value ^ value >> 16


def _mix(block: int) -> int:
    return _rotate(block * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593 & 0xFFFFFFFF


def _rotate(value: int, bits: int) -> int:
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


NOTHING = np.float32(1e10)  # depth where the lens sees nothing, as in Cycles
WHOLE = 0.999  # coverage from which a pixel shows one thing alone


@dataclass(frozen=True)
class Viewpoint:
    """Camera and stage placement of one frame."""

    camera: Camera
    placement: StagePlacement


@dataclass(frozen=True)
class LayerInputs:
    """The scene of a frame, as far as its AOVs do not show it.

    view       of the frame
    before     of the frame before
    after      of the next frame
    size       width and height of the whole picture, pixels
    stage      around the subject
    materials  names of materials by object, where the names differ
    copies     the number of copies by object, for objects with several
    """

    view: Viewpoint
    before: Viewpoint
    after: Viewpoint
    size: tuple[int, int]
    stage: Stage
    materials: Mapping[str, str]
    copies: Mapping[str, int] = field(default_factory=dict)


def compositing_layers(raw: RenderedFrame, inputs: LayerInputs) -> dict[str, Pixels]:
    """Return the layers of a finished frame by name.

    raw  AOVs of all frames, `before` and `after`; its beauty is finished
    """
    alpha, matte = raw["alpha"], raw["matte"]
    mixed = [raw["position"], raw["depth"][..., None], raw["before"], raw["after"]]
    values = unmixed(np.concatenate(mixed, axis=2), matte, alpha, bool(inputs.stage.objects))
    position, distance, before, after = np.split(values, (3, 4, 7), axis=2)
    covered = (alpha > 0.0) & (distance[..., 0] > 0.0)
    camera = inputs.view.camera
    eyes = camera.projection.eyes(pixel_places(*inputs.size)[..., 0])
    planar = camera.depths(position, eyes)
    is_subject = (covered & (matte >= 0.5 * alpha))[..., None]

    def motion(offset: Doubles, then: Viewpoint) -> Doubles:
        of_stage = inputs.view.placement.moved(position, then.placement) - position
        moved = position + np.where(is_subject, offset, of_stage)
        pixels = _pixels_between(inputs, position, moved, then.camera, eyes)
        return np.where(covered[..., None], pixels, 0.0)

    layers = {
        "beauty": raw["beauty"],
        "alpha": alpha,
        "planar_depth": np.where(covered, planar, NOTHING).astype(np.float32),
        "depth": np.where(covered, distance[..., 0], NOTHING).astype(np.float32),
        "position": np.where(covered[..., None], position, 0.0).astype(np.float32),
        **{name: np.where(covered[..., None], raw[name], np.float32(0.0)) for name in ("normal", "albedo")},
        "matte": matte,
        "motion": motion(after, inputs.after).astype(np.float32),
        "backward_motion": motion(before, inputs.before).astype(np.float32),
    }
    for crypto, (planes, copies) in _mattes(raw, inputs).items():
        layers |= cryptomatte_layers(crypto, planes, copies)
    return layers


def mattes_header(raw: RenderedFrame, inputs: LayerInputs, convention: str) -> dict[str, str]:
    """Return the header's entries for the mattes of `compositing_layers`, with a convention's names."""
    entries: dict[str, str] = {}
    for crypto, (planes, copies) in _mattes(raw, inputs).items():
        names = [*planes, *(copies.names if copies else ())]
        entries |= cryptomatte_header(cryptomatte_label(crypto, convention), names)
    return entries


def _mattes(
    raw: RenderedFrame, inputs: LayerInputs
) -> dict[str, tuple[Mapping[str, Pixels], RankedCoverage | None]]:
    """Return what each set of mattes shows: coverage by name, and that by copies of subjects.

    Where subjects have copies, each copy is an object, `pearls.1`, and all copies of one are an asset.
    """
    coverage = object_coverage(raw, inputs.stage)
    material = by_material(coverage, inputs.materials), None
    ranks = [raw[name] for name in sorted(raw.arrays) if name.startswith(COPIES)]
    if not ranks or not inputs.copies:
        return {OBJECT: (coverage, None), MATERIAL: material}
    planes = np.moveaxis(np.concatenate(ranks, axis=2), 2, 0)
    names = [f"{name}.{number + 1}" for name, count in inputs.copies.items() for number in range(count)]
    single = {name: plane for name, plane in coverage.items() if name not in inputs.copies}
    copies = RankedCoverage(names, planes[0::2], planes[1::2])
    return {OBJECT: (single, copies), ASSET: (coverage, None), MATERIAL: material}


def unmixed(values: Pixels, matte: Pixels, alpha: Pixels, has_stage: bool) -> Doubles:
    """Return means over pixels (H, W, C) as those of the greater part of each pixel.

    Before a stage, pixels that show subject and stage take the mean of their neighbours that show only the
    greater part, where there are any. Without one, the subject's values are divided by its coverage.
    """
    result = values.astype(np.float64)
    is_subject = matte >= 0.5 * alpha
    weights = np.where(is_subject, matte, alpha - matte) >= WHOLE
    rows, columns = np.nonzero(~weights & (alpha > 0.0))
    weights = weights.astype(np.float64) if has_stage else matte.astype(np.float64)
    total, weight = np.zeros((len(rows), values.shape[2])), np.zeros(len(rows))
    height, width = matte.shape
    for down, right in np.ndindex(3, 3):
        row, column = rows + down - 1, columns + right - 1
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        row, column = np.where(inside, row, rows), np.where(inside, column, columns)
        same = inside & (is_subject[row, column] == is_subject[rows, columns])
        own = same * weights[row, column]
        total += own[:, None] * result[row, column] if has_stage else same[:, None] * result[row, column]
        weight += own
    known = weight > 0.0
    result[rows[known], columns[known]] = total[known] / weight[known, None]
    return result


def _pixels_between(
    inputs: LayerInputs, points: Doubles, moved: Doubles, camera: Camera, eyes: Doubles
) -> Doubles:
    """Return the pixels (H, W, 2), right and up, from points in the frame to moved ones in another camera.

    eyes  (H, W) of a stereo camera that the pixels belong to
    """
    width, height = inputs.size
    ends = [
        view.project(at.reshape(-1, 3), width / height, eyes.ravel()) * (width / 2.0, height / 2.0, 1.0)
        for view, at in ((inputs.view.camera, points), (camera, moved))
    ]
    in_front = (ends[0][:, 2] > 0.0) & (ends[1][:, 2] > 0.0)
    motion = camera.projection.motion(ends[1][:, :2] - ends[0][:, :2], width)
    motion = np.where(in_front[:, None], motion, 0.0)
    return motion.reshape(*points.shape[:2], 2)


def object_coverage(raw: RenderedFrame, stage: Stage) -> dict[str, Pixels]:
    """Return the coverage (H, W) of each object that is seen; of subject and stage where no more is known."""
    known = {name[len(COVERAGE) :]: plane for name, plane in raw.arrays.items() if name.startswith(COVERAGE)}
    if stage.shadow_catcher:
        known.pop("stage", None)
    if known:
        return known
    rest = {"stage": np.maximum(raw["alpha"] - raw["matte"], 0.0)} if stage.objects else {}
    return {"subject": raw["matte"], **rest}


def by_material(coverage: Mapping[str, Pixels], materials: Mapping[str, str]) -> dict[str, Pixels]:
    """Return the coverage (H, W) of each material by name: the sum over its objects."""
    total: dict[str, Pixels] = {}
    for name, plane in coverage.items():
        material = materials.get(name, name)
        total[material] = total[material] + plane if material in total else plane
    return total
