# SPDX-License-Identifier: GPL-3.0-or-later
"""The shot that Blender shows: its objects, the mesh of each frame, and edits that are not in the file yet.

What the file has is kept here and not in Blender's data, so that undoing a move in Blender is one more edit.
"""

from __future__ import annotations

import hashlib
import json
import re
import time
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
from mathutils import Vector

from .flow_empties import Slot, build_empties, own_times
from .frame_meshes import forget_all, forget_beyond, frame_mesh, has_room, is_loaded, nothing
from .program import Answer, ProgramError, Run
from .shot_camera import camera_edits, show_camera

MARK = "flowsculpt_shown"
"""Custom property of what Blender shows: undo takes it back too, so it says what an object has now."""

SECONDS_BETWEEN_LOOKS = 1.0
"""Missing meshes are looked for in the store at most this often: panels are drawn many times a second."""

UPRIGHT = (1.5707963267948966, 0.0, 0.0)  # turns y of shots up to z of Blender


def shots_in(folder: Path) -> list[str]:
    """Return the names of the shots of a show: files in shots/ that are not edits or defaults.

    Raises ProgramError where there is none.
    """
    files = sorted((folder / "shots").glob("*.yaml"))
    names = [path.stem for path in files if path.name != "defaults.yaml" and not _is_edit(path)]
    if not names:
        raise ProgramError(
            f"{folder}: no shots in its folder shots; a show has at least one. Choose another folder, or "
            "begin one with flowsculpt new --show"
        )
    return names


def _is_edit(path: Path) -> bool:
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return bool(re.search(r"^shots\s*:", text, re.M)) and not re.search(r"^subjects?\s*:", text, re.M)


@dataclass(eq=False)
class ShownShot:
    """A shot of a show as Blender shows it.

    state     the last answer of `flowsculpt edit`: digest and values
    listing   the last answer of `flowsculpt frames`
    objects   names of the mesh objects by subject
    defaults  values that the file left out when it was opened, by path
    reading   names this reading of the file
    message   what went wrong last, for the panel
    """

    program: str
    folder: Path
    name: str
    state: Answer
    listing: Answer
    slots: list[Slot] = field(default_factory=list)
    objects: dict[str, str] = field(default_factory=dict)
    root: str = ""
    reading: str = ""
    camera: str = ""
    defaults: dict[str, Any] = field(default_factory=dict)
    message: str = ""
    _files: dict[str, dict[int, tuple[str, str]]] = field(default_factory=dict)
    _stored: set[str] = field(default_factory=set)
    _next_look: float = 0.0

    @classmethod
    def read(cls, program: str, folder: Path, name: str) -> ShownShot:
        """Read a shot. Raises ProgramError where its file is not valid."""
        state = Run(program, ["edit", name], folder, {}).wait()
        return cls(program, folder, name, state, Run(program, ["frames", name], folder).wait())

    def is_there(self) -> bool:
        """Tell whether the objects are those of this reading; undo steps may bring back others, or none."""
        root = bpy.data.objects.get(self.root)
        return root is not None and root.get(MARK) == self.reading

    @property
    def numbers(self) -> range:
        return range(self.listing["first"], self.listing["last"] + 1)

    # Objects

    def build(self, scene: bpy.types.Scene) -> None:
        """Make the shot's objects in a collection of their own, and set the scene's frames and rate."""
        remove_objects(scene)
        collection = bpy.data.collections.new(f"Flowsculpt {self.name}")
        scene.collection.children.link(collection)
        root = bpy.data.objects.new(self.name, None)
        root.empty_display_size, root.rotation_euler, root.hide_select = 0.2, UPRIGHT, True
        collection.objects.link(root)
        self.root = root.name
        self.reading = root[MARK] = f"{time.time_ns()}"
        for subject in self.listing["subjects"]:
            shape = bpy.data.objects.new(f"{subject['name']} sculpture", nothing())
            shape.parent = root
            collection.objects.link(shape)
            shape.material_slots[0].link = "OBJECT"
            self.objects[subject["name"]] = shape.name
        camera = bpy.data.objects.new(f"{self.name} camera", bpy.data.cameras.new(f"{self.name} camera"))
        camera.parent = root
        collection.objects.link(camera)
        self.camera = camera.name
        self.slots = build_empties(self.state, root, collection)
        self.defaults = {slot.words: slot.value["value"] for slot in self.slots if not slot.value["is_given"]}
        scene["flowsculpt_collection"] = collection.name
        scene.frame_start, scene.frame_end = self.listing["first"], self.listing["last"]
        rate = self.listing["fps"]
        scene.render.fps, scene.render.fps_base = round(rate), round(rate) / rate
        self.take_listing(self.listing, scene)

    def take_listing(self, listing: Answer, scene: bpy.types.Scene) -> None:
        """Show the frames and the cameras of a new listing."""
        self.listing = listing
        self._files = {
            subject["name"]: {row["frame"]: (row["key"], row["file"]) for row in subject["meshes"]}
            for subject in listing["subjects"]
        }
        self._next_look = 0.0  # a run has ended
        camera, mark = bpy.data.objects.get(self.camera), _digest(listing["cameras"])
        if listing["cameras"] and camera is not None and camera.get(MARK) != mark:
            show_camera(camera, listing, self.numbers, scene)
            camera[MARK] = mark
            scene.camera = scene.camera or camera
        self.show_frame(scene)

    def show_frame(self, scene: bpy.types.Scene) -> None:
        """Give each subject the mesh of the scene's frame; none where it is not simulated yet."""
        number = min(max(scene.frame_current, self.numbers[0]), self.numbers[-1])
        for subject, files in self._files.items():
            shape = bpy.data.objects.get(self.objects.get(subject, ""))
            if shape is None or number not in files:
                continue
            mesh = frame_mesh(*files[number]) or nothing()
            if shape.data != mesh:
                shape.data = mesh

    def load_ahead(self, scene: bpy.types.Scene, most_bytes: int) -> None:
        """Load the next frame that is in the store and not in memory, if there is room."""
        forget_beyond(most_bytes)
        if not has_room(most_bytes):
            return  # else frames would push each other out for ever
        numbers = list(self.numbers)
        begin = bisect_right(numbers, scene.frame_current)
        for number in numbers[begin:] + numbers[:begin]:
            for files in self._files.values():
                if number in files and not is_loaded(files[number][0]) and self._is_stored(files[number]):
                    frame_mesh(*files[number])
                    return

    def simulated(self) -> int:
        """Return how many frames have the meshes of all subjects, as of a second ago at most."""
        return sum(
            all(n in files and self._is_stored(files[n]) for files in self._files.values())
            for n in self.numbers
        )

    def _is_stored(self, mesh: tuple[str, str]) -> bool:
        """Tell whether a mesh, by key and file, is in the store; each is looked for until it is there."""
        if time.monotonic() >= self._next_look:
            meshes = (mesh for files in self._files.values() for mesh in files.values())
            missing = ((key, file) for key, file in meshes if key not in self._stored)
            self._stored.update([key for key, file in missing if Path(file).exists()])
            self._next_look = time.monotonic() + SECONDS_BETWEEN_LOOKS
        return mesh[0] in self._stored

    # Edits

    def changed(self) -> list[Slot]:
        """Return the slots that differ from the file. Raises ProgramError where an empty was deleted."""
        return [slot for slot in self.slots if slot.is_changed()]

    def edits_of(self, slots: Sequence[Slot]) -> list[dict[str, Any]]:
        """Return the edits for the file; values back at what the file left out are left out again."""
        edits = []
        for slot in slots:
            edit = slot.edit()
            if slot.words in self.defaults and edit["value"] == self.defaults[slot.words]:
                edit = {"kind": "remove", "where": slot.where}
            edits.append(edit)
        return edits

    def request(self, edits: Sequence[dict[str, Any]]) -> Answer:
        """Return the request of edits of the file as it was read."""
        return {"digest": self.state["digest"], "edits": list(edits)}

    def take_state(self, state: Answer, snapshots: dict[Slot, Any]) -> None:
        """Take the answer to edits; `snapshots` are what Blender had when they were sent."""
        self.state = state
        values, times = {_name(value): value for value in state["values"]}, own_times(state)
        for slot in self.slots:
            before = slot.value["curve"], slot.own_time
            slot.value = values.get(slot.words, slot.value)
            slot.own_time = times(tuple(slot.where))
            if before != (slot.value["curve"], slot.own_time) and slot not in snapshots:
                slot.apply()  # the time of its flow has changed
        for slot, snapshot in snapshots.items():
            slot.settle(snapshot)

    def revert(self, slots: Sequence[Slot]) -> None:
        """Show the values of the file again where it refused others."""
        for slot in slots:
            slot.apply()

    def camera_edits(self, camera: bpy.types.Object, scene: bpy.types.Scene) -> list[dict[str, Any]]:
        """Return the edits that give the shot a camera of Blender."""
        before = scene.frame_current
        corners = [
            Vector(corner)
            for name in self.objects.values()
            if name in bpy.data.objects
            for corner in bpy.data.objects[name].bound_box
        ]
        middle = sum(corners, Vector()) / max(1, len(corners))
        root = bpy.data.objects[self.root]
        edits = camera_edits(camera, root, middle, self.state["values"], self.numbers, scene.frame_set)
        scene.frame_set(before)
        return edits


def _digest(data: Any) -> str:
    return hashlib.sha256(json.dumps(data).encode()).hexdigest()


def _name(value: dict[str, Any]) -> str:
    return ".".join(map(str, value["where"]))


def remove_objects(scene: bpy.types.Scene) -> None:
    """Remove the objects of the shot that a scene shows."""
    collection = bpy.data.collections.get(scene.get("flowsculpt_collection", ""))
    if collection is not None:
        for item in list(collection.objects):
            bpy.data.objects.remove(item)
        bpy.data.collections.remove(collection)
    if "flowsculpt_collection" in scene:
        del scene["flowsculpt_collection"]
    forget_all()
