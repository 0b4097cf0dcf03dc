# SPDX-License-Identifier: GPL-3.0-or-later
"""Flows as empties: where each value of a flow stands in Blender, and what an edit of it is in the file.

Empties are children of the shot's root, which is turned so that their coordinates are those of the shot file,
with y up. Location is the centre, local z the axis, local x the direction, and scale the radius; a `placed`
flow is the parent of what it places. All other values are custom properties.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
from mathutils import Matrix, Vector

from .key_curves import (
    STAND_INS,
    Key,
    Numbers,
    lock_curves,
    read_keys,
    remove_curves,
    sampled_keys,
    write_keys,
)
from .program import ProgramError

PATH = "flowsculpt_path"
"""Custom property of an empty: the path of its flow in the shot file, as JSON."""

CHANNELS = {
    "centre": "location",
    "translate": "location",
    "axis": "axis",
    "normal": "axis",
    "direction": "direction",
    "radius": "scale",
}
"""Values of a flow by what shows them; of others it is a custom property."""

PLACED = {"rotate": "rotation", "scale": "scale"}  # values of `placed` alone

DATA_PATHS = {
    "location": "location",
    "rotation": "rotation_euler",
    "axis": "rotation_quaternion",
    "direction": "rotation_quaternion",
    "scale": "scale",
}

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}

SAME = 1e-5
"""Numbers count as unchanged within this, relative to the larger or 1: Blender has float32."""

Snapshot = tuple[Any, ...]


@dataclass(eq=False)
class Slot:
    """One value of the file, and where it stands in Blender.

    value     as `flowsculpt edit` has it
    owner     the name of the object
    channel   location, rotation, axis, direction, scale, or the name of a custom property
    own_time  frames of the flow's own time at each frame of the shot; none if the flow has that of the film
    known     what Blender had when it was last as in the file
    """

    value: dict[str, Any]
    owner: str
    channel: str
    own_time: tuple[float, ...] = ()
    first: int = 1
    known: Snapshot = ()

    @property
    def where(self) -> list[Any]:
        return self.value["where"]

    @property
    def words(self) -> str:
        """Return the path as messages have it, `flows.0.vortex.radius`."""
        return ".".join(map(str, self.where))

    @property
    def object(self) -> bpy.types.Object:
        """Return the object. Raises ProgramError where the artist has deleted it."""
        found = bpy.data.objects.get(self.owner)
        if found is None:
            raise ProgramError(
                f"{self.words}: its empty {self.owner} was deleted; flows are removed in the shot file. "
                "Undo, or open the shot again"
            )
        return found

    @property
    def data_path(self) -> str:
        return DATA_PATHS.get(self.channel) or f'["{self.channel}"]'

    @property
    def is_editable(self) -> bool:
        """False for formulas and sounds, and for keys in a time other than that of the film."""
        curve = self.value["curve"]
        return curve is None or bool(curve["keys"] and not self.own_time)

    # From the file to Blender

    def apply(self) -> None:
        """Show the value of the file."""
        curve, owner = self.value["curve"], self.object
        remove_curves(owner, self.data_path)
        if curve is None:
            self._show(self.value["value"])
            self.known = self.snapshot()
            return
        if self.channel not in DATA_PATHS:
            first = curve["values"][0]
            self._show(first if self.value["is_vector"] else first[0])
        if self.is_editable:
            keys = [self._key(key) for key in curve["keys"]]
            write_keys(owner, self.data_path, keys, curve["before"], curve["after"])
        else:
            frames, values = curve["frames"], curve["values"]
            if self.own_time:
                nearest = [min(range(len(frames)), key=lambda i: abs(frames[i] - t)) for t in self.own_time]
                frames = [self.first + index for index in range(len(self.own_time))]
                values = [values[index] for index in nearest]
            keys = sampled_keys(frames, values, self._shown)
            write_keys(owner, self.data_path, keys, "hold", "hold")
            lock_curves(owner, self.data_path)
        self.known = self.snapshot()

    def _key(self, key: dict[str, Any]) -> Key:
        def handle(side: str) -> tuple[float, Numbers] | None:
            return None if key[side] is None else (key[side][0], self._shown(key[side][1]))

        by_handle = "bezier" if key["right"] is not None else self.value["curve"]["ease"]
        ease = key["ease"] or by_handle
        ease = STAND_INS.get(ease.partition(" ")[0], ease)
        return Key(round(key["frame"], 3), self._shown(key["value"]), ease, handle("left"), handle("right"))

    def _show(self, value: Any) -> None:
        owner = self.object
        if self.channel in ("axis", "direction"):
            _turn(owner, self.channel, AXES.get(value, value) if isinstance(value, str) else value)
        elif self.channel in DATA_PATHS:
            setattr(owner, self.data_path, self._shown(value if isinstance(value, list) else [value]))
        else:
            owner[self.channel] = _property(self.value, value)
            _describe(owner, self.channel, self.value)

    def _shown(self, value: Sequence[float]) -> Numbers:
        """Return a value in Blender's components and units."""
        if self.channel == "rotation":
            return tuple(math.radians(number) for number in value)
        return tuple(value) * 3 if self.channel == "scale" and len(value) == 1 else tuple(value)

    # From Blender to the file

    def snapshot(self) -> Snapshot:
        """Return what Blender has now: a value, or keys."""
        keys = read_keys(self.object, self.data_path, self._components())
        if keys:
            return ("keys", *keys)
        return ("value", self._read(self._components()))

    def _components(self) -> Sequence[float]:
        owner = self.object
        raw = getattr(owner, self.data_path) if self.channel in DATA_PATHS else owner.get(self.channel)
        return [raw] if isinstance(raw, str | int | float | bool) or raw is None else list(raw)

    def _read(self, components: Sequence[Any]) -> tuple[Any, ...]:
        """Return the value that components stand for."""
        if self.channel in ("axis", "direction"):
            turn = self.object.rotation_quaternion.to_matrix()
            return tuple(turn.col[2 if self.channel == "axis" else 0])
        if self.channel == "rotation":
            return tuple(math.degrees(number) for number in components)
        if self.channel == "scale":
            return (self._radius(components),)
        return tuple(components)

    def _radius(self, scale: Sequence[float]) -> float:
        """Return the one number of a scale: what was changed, if the empty was scaled along one axis."""
        before = self.known[1][0] if self.known[:1] == ("value",) else None
        moved = [number for number in scale if before is None or not _is_same(number, before)]
        return sum(moved) / len(moved) if moved else scale[0]

    def is_changed(self) -> bool:
        """Tell whether Blender has something other than the file."""
        now = self.snapshot()
        return not _is_alike(now, self.known)

    def settle(self, snapshot: Snapshot) -> None:
        """Take a snapshot as what the file has; an empty scaled along one axis gets an even scale."""
        self.known, now = snapshot, self.snapshot()
        if self.channel == "scale" and now[0] == snapshot[0] == "value":
            self.object.scale = snapshot[1] * 3

    def edit(self) -> dict[str, Any]:
        """Return the edit that makes the file what Blender has.

        Raises ProgramError for what cannot be edited by keys.
        """
        kind, *found = self.snapshot()
        if not self.is_editable:
            why = "runs in a time of its own" if self.own_time else "is a formula or follows a sound"
            raise ProgramError(f"{self.words} {why}, which keys cannot express. Edit it in the shot file")
        if kind == "value":
            return {"kind": "set", "where": self.where, "value": self._written(found[0], self.value["value"])}
        if not self.value["can_change"]:
            raise ProgramError(
                f"{self.words} cannot be keyed. Delete the keys of {self.owner}: {self.data_path}"
            )
        return self._edit_of_keys(found)

    def _written(self, value: Sequence[Any], before: Any = None) -> Any:
        """Return a value as the file has it; numbers that stay keep their digits."""
        if self.channel in ("axis", "direction"):
            name = next((name for name, axis in AXES.items() if _is_alike(axis, value)), None)
            return name or [tidy(number) for number in value]
        former = before if isinstance(before, list) else [before]
        known = self.known[1] if self.known[:1] == ("value",) else ()
        kept = [
            old if len(former) == len(value) == len(known) and _is_alike(new, known[index]) else tidy(new)
            for index, (new, old) in enumerate(
                zip(value, former if len(former) == len(value) else value, strict=True)
            )
        ]
        return kept if self.value["is_vector"] else kept[0]

    def _edit_of_keys(self, keys: Sequence[Key]) -> dict[str, Any]:
        raw = self.value["value"]
        is_keyed = isinstance(raw, dict) and "keys" in raw
        default = (
            raw.get("ease", "sine_in_out") if is_keyed else Counter(k.ease for k in keys).most_common(1)[0][0]
        )
        known = {key.frame: key for key in self.known[1:]} if self.known[:1] == ("keys",) else {}
        former = {
            round(key["frame"], 3): str(key["time"]) for key in (self.value["curve"] or {"keys": ()})["keys"]
        }
        entries = {}
        for key in keys:
            name = former.get(key.frame) or str(tidy(key.frame))
            is_kept = key.frame in known and key.frame in former and _is_alike(key, known[key.frame])
            entries[name] = raw["keys"][name] if is_kept else self._entry(key, default)
        if is_keyed:
            return {"kind": "set", "where": [*self.where, "keys"], "value": entries}
        ease = {} if default == "sine_in_out" else {"ease": default}
        return {"kind": "set", "where": self.where, "value": {**ease, "keys": entries}}

    def _entry(self, key: Key, default: str) -> Any:
        value = self._written(self._read(key.values))
        entry: dict[str, Any] = {"value": value}
        if key.ease not in (default, STAND_INS.get(default.partition(" ")[0])):
            entry["ease"] = key.ease
        for side, handle in (("left", key.left), ("right", key.right)):
            if handle is not None:
                entry[side] = [tidy(handle[0]), self._written(self._read(handle[1]))]
        return value if len(entry) == 1 else entry


def tidy(number: Any) -> Any:
    """Return a number without the noise of float32: six digits, and whole ones as integers."""
    if isinstance(number, bool | str) or not math.isfinite(number):
        return number
    rounded = float(f"{round(number, 6):.6g}")
    return int(rounded) if rounded.is_integer() and abs(rounded) < 1e9 else rounded


def _is_same(one: float, other: float) -> bool:
    return abs(one - other) <= SAME * max(1.0, abs(one), abs(other))


def _is_alike(one: Any, other: Any) -> bool:
    """Tell whether values, keys or lists of them are equal within the noise of float32."""
    if isinstance(one, Key) and isinstance(other, Key):
        return all(_is_alike(getattr(one, name), getattr(other, name)) for name in Key.__dataclass_fields__)
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(_is_alike, one, other))
    if isinstance(one, int | float) and isinstance(other, int | float):
        return _is_same(one, other)
    return bool(one == other)


def _turn(owner: bpy.types.Object, channel: str, vector: Sequence[float]) -> None:
    """Turn an object so that its local z, or x for a direction, lies along a vector, as little as may be."""
    now = owner.rotation_quaternion.to_matrix()
    wanted = Vector(vector).normalized()
    if channel == "axis":
        z, x = wanted, now.col[0]
    else:
        z, x = now.col[2], wanted
    x = x - x.dot(z) * z
    x = x.normalized() if x.length > 1e-6 else z.orthogonal().normalized()
    owner.rotation_quaternion = Matrix((x, z.cross(x), z)).transposed().to_quaternion()


def _property(value: dict[str, Any], raw: Any) -> Any:
    if value["form"] in ("whole", "switch"):
        return raw
    if isinstance(raw, list):
        return [float(number) for number in raw]
    return raw if isinstance(raw, str) else float(raw)


def _describe(owner: bpy.types.Object, name: str, value: dict[str, Any]) -> None:
    """Give a custom property the bounds and the description of its value."""
    words = f"{value['description']} ({value['unit']})" if value["unit"] else value["description"]
    bounds = {} if value["form"] not in ("number", "whole") else {"min": value["low"], "max": value["high"]}
    if value["form"] == "whole":
        bounds = {side: int(bound) if bound is not None else None for side, bound in bounds.items()}
    given = {side: bound for side, bound in bounds.items() if bound is not None}
    owner.id_properties_ui(name).update(description=words, **given)


@dataclass(frozen=True)
class _Group:
    """The values of one flow or composition, by name."""

    path: tuple[Any, ...]
    values: dict[str, dict[str, Any]]

    @property
    def kind(self) -> str:
        return str(self.path[-1])

    def channel(self, name: str) -> str:
        """Return what shows a value."""
        value = self.values[name]
        own = PLACED.get(name) if self.kind == "placed" else None
        channel = own or CHANNELS.get(name, name)
        is_many = value["is_vector"] or value["form"] == "axis"
        fits = is_many != (channel == "scale")  # a scale is one number, the other channels are vectors
        return channel if fits else name


def _groups(values: Sequence[dict[str, Any]]) -> Iterator[_Group]:
    """Yield the flows and compositions of a shot that have values."""
    found: dict[tuple[Any, ...], dict[str, dict[str, Any]]] = {}
    for value in values:
        *path, name = value["where"]
        if "flows" in path and path[-1] != "flows":
            found.setdefault(tuple(path), {})[str(name)] = value
    for path, group in found.items():
        yield _Group(path, group)


def own_times(state: dict[str, Any]) -> Callable[[tuple[Any, ...]], tuple[float, ...]]:
    """Return a function of the path of a flow or value: frames of its own time; none if it has the film's."""
    frames = {tuple(item["where"]): tuple(item["frames"]) for item in state["flow_frames"]}

    def own_time(path: tuple[Any, ...]) -> tuple[float, ...]:
        above = [where for where in frames if path[: len(where)] == where]
        return frames[max(above, key=len)] if above else ()

    return own_time


def build_empties(
    state: dict[str, Any], root: bpy.types.Object, collection: bpy.types.Collection
) -> list[Slot]:
    """Make an empty for each flow of a shot, and return the slots of their values."""
    times = own_times(state)
    slots, placed = list[Slot](), dict[tuple[Any, ...], bpy.types.Object]()
    for group in sorted(_groups(state["values"]), key=lambda group: len(group.path)):
        numbers = ".".join(str(step) for step in group.path if isinstance(step, int))
        empty = bpy.data.objects.new(f"{numbers} {group.kind}", None)
        collection.objects.link(empty)
        above = [path for path in placed if group.path[: len(path)] == path]
        empty.parent = placed[max(above, key=len)] if above else root
        if group.kind == "placed":
            placed[group.path] = empty
        empty[PATH] = json.dumps(group.path)
        channels = {name: group.channel(name) for name in group.values}
        _dress(empty, set(channels.values()), collection)
        order = sorted(channels, key=lambda name: channels[name] == "direction")  # it turns about the axis
        for name in order:
            slot = Slot(group.values[name], empty.name, channels[name], times(group.path), state["first"])
            slot.apply()
            slots.append(slot)
        for slot in slots[-len(order) :]:
            slot.known = slot.snapshot()
    return slots


def _dress(empty: bpy.types.Object, channels: set[str], collection: bpy.types.Collection) -> None:
    """Draw an empty as what it stands for, and lock what stands for nothing."""
    empty.empty_display_size = 1.0 if "scale" in channels else 0.4
    empty.rotation_mode = "XYZ" if "rotation" in channels else "QUATERNION"
    empty.lock_location = [not channels & {"location"}] * 3
    turns = bool(channels & {"axis", "direction", "rotation"})
    empty.lock_rotation, empty.lock_rotation_w = [not turns] * 3, not turns
    empty.lock_scale = ["scale" not in channels] * 3
    if "axis" in channels:
        empty.empty_display_type = "SINGLE_ARROW"
        if "scale" in channels:
            ring = bpy.data.objects.new(f"{empty.name} ring", None)
            collection.objects.link(ring)
            ring.parent, ring.hide_select, ring.empty_display_type = empty, True, "CIRCLE"
            ring.rotation_euler = (math.pi / 2, 0.0, 0.0)  # Blender draws circles around y
    elif "scale" in channels:
        empty.empty_display_type = "SPHERE"
    else:
        empty.empty_display_type = "PLAIN_AXES"
