"""What an artist does with the extension, within Blender as a module: `scenarios.py NAME ZIP PROGRAM SHOW`.

Each scenario is a function of the folder of the show; test_extension.py runs each in a process of its own.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

MODULE = "bl_ext.user_default.flowsculpt"

SHOT = "T010_tiny"


def installed(package: Path, program: str) -> None:
    """Install and enable the extension in an empty Blender."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(
        filepath=str(package), repo="user_default", enable_on_install=True
    )
    assert MODULE in bpy.context.preferences.addons
    preferences().program = program


def preferences() -> Any:
    return bpy.context.preferences.addons[MODULE].preferences


def shown() -> Any:
    """The extension's own view of the open shot."""
    return sys.modules[f"{MODULE}.current_shot"].current.shot


def opened(show: Path) -> None:
    bpy.context.scene.flowsculpt.folder = str(show)
    bpy.context.scene.flowsculpt.shot = SHOT
    assert bpy.ops.flowsculpt.open() == {"FINISHED"}


def refused(operator: Callable[..., Any], **options: Any) -> str:
    """Return what an operator reports as an error."""
    try:
        operator(**options)
    except RuntimeError as error:
        return str(error).removeprefix("Error: ").strip()
    raise AssertionError("the operator has reported no error")


def text(show: Path) -> str:
    return (show / "shots" / f"{SHOT}.yaml").read_text()


def sculpture() -> Any:
    return bpy.data.objects[f"{SHOT} sculpture"]


def at(number: int) -> Any:
    bpy.context.scene.frame_set(number)
    return sculpture().data


def scrub(show: Path) -> None:
    """Open, simulate and scrub: every frame has the mesh that the store has."""
    opened(show)
    assert len(at(3).vertices) == 0, "nothing is simulated yet"
    assert bpy.ops.flowsculpt.make() == {"FINISHED"}
    assert shown().simulated() == 6
    sculpture().material_slots[0].material = own = bpy.data.materials.new("own")
    listing = shown().listing["subjects"][0]["meshes"]
    for row in listing:
        mesh, stored = at(row["frame"]), dict(np.load(row["file"]))
        assert sculpture().material_slots[0].material == own, "the artist's material stays in all frames"
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        assert np.array_equal(points.reshape(-1, 3), np.float32(stored["vertices"]))
        corners = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", corners)
        assert np.array_equal(corners.reshape(-1, 3), stored["faces"])
        sharp = np.empty(len(mesh.edges), bool)
        mesh.attributes["sharp_edge"].data.foreach_get("value", sharp)
        assert sharp.sum() == len(stored["creases"]) > 0
        assert not mesh.validate(), "Blender has nothing to correct"
    scene, camera = bpy.context.scene, scene_camera()
    assert (scene.frame_start, scene.frame_end, scene.render.fps) == (1, 6, 24)
    framed = shown().listing["cameras"]["1"]
    place = Vector(framed["position"])
    assert (camera.matrix_world.translation - Vector((place.x, -place.z, place.y))).length < 1e-4, "z is up"
    assert math.isclose(math.degrees(camera.data.angle), framed["field_of_view"], rel_tol=1e-5)


def scene_camera() -> Any:
    at(1)
    return bpy.context.scene.camera


def edit(show: Path) -> None:
    """Move an empty, edit keys, undo: the file follows, with its comments."""
    opened(show)
    before, keys = text(show), {row["frame"]: row["key"] for row in shown().listing["subjects"][0]["meshes"]}
    assert shown().changed() == []
    vortex = bpy.data.objects["1.0 vortex"]
    assert np.allclose(vortex.location, (0.9, 0.3, 0)) and np.allclose(vortex.scale, 0.8)
    axis = vortex.rotation_quaternion.to_matrix().col[2]
    assert np.allclose(axis, (0, 0.6, 0.8), atol=1e-6)
    vortex.location.x = 1.25
    vortex.scale.y = 0.6  # along one axis alone, as S Y does
    vortex["strength"] = 2.0
    bpy.ops.flowsculpt.write()
    after = before.replace("centre: [0.9,", "centre: [1.25,").replace("radius: 0.8", "radius: 0.6")
    assert text(show) == after.replace("strength: 1.5", "strength: 2")
    assert shown().changed() == []
    assert shown().listing["subjects"][0]["meshes"][3]["key"] != keys[4]
    vortex.location.x, vortex.scale, vortex["strength"] = 0.9, (0.8, 0.8, 0.8), 1.5
    vortex.rotation_quaternion = (1, 0, 0, 0)
    bpy.ops.flowsculpt.write()
    assert text(show) == before.replace("[0, 0.6, 0.8]", "z")


def edit_keys(show: Path) -> None:
    """Keys are F-curves with the file's easings; what is edited there is written, and nothing else."""
    opened(show)
    before, twist = text(show), bpy.data.objects["0 twist"]
    curve = curves(twist)['["amount"]'][0]
    assert [tuple(p.co) for p in curve.keyframe_points] == [(1, 0), (4, 36), (6, 60)]
    assert [p.interpolation for p in curve.keyframe_points] == ["LINEAR", "LINEAR", "SINE"]
    assert math.isclose(curve.evaluate(2), 12, rel_tol=1e-5)
    curve.keyframe_points[1].co.y = 30
    curve.update()
    bpy.ops.flowsculpt.write()
    assert text(show) == before.replace("4: 36", "4: 30")
    vortex = bpy.data.objects["1.0 vortex"]
    vortex.keyframe_insert("location", frame=1)
    vortex.location = (0, 0, 0.25)
    vortex.keyframe_insert("location", frame=6)
    bpy.ops.flowsculpt.write()
    keyed = "centre: {ease: bezier, keys: {1: [0.9, 0.3, 0], 6: [0, 0, 0.25]}}, radius: 0.8"
    assert keyed in text(show) and "# off the middle" in text(show)
    opened(show)
    assert shown().changed() == []
    vortex = bpy.data.objects["1.0 vortex"]
    assert math.isclose(curves(vortex)["location"][2].evaluate(6), 0.25)
    placed = bpy.data.objects["1.1 placed"]
    assert np.allclose(placed.rotation_euler, (0, math.pi / 2, 0))
    inner = bpy.data.objects["1.1.0 vortex"]
    assert inner.parent == placed, "a placed flow stands within what places it"
    axis = bpy.data.objects["1.1.0 vortex"]
    axis.keyframe_insert("rotation_quaternion", frame=2)
    assert "flows.1.sum.1.placed.flows.0.vortex.axis cannot be keyed" in refused(bpy.ops.flowsculpt.write)
    assert shown().changed() == [], "the empty is as in the file again"


def curves(owner: Any) -> dict[str, dict[int, Any]]:
    module = sys.modules[f"{MODULE}.key_curves"]
    paths = ("location", "scale", "rotation_quaternion", '["amount"]')
    return {path: module.curves_of(owner, path) for path in paths}


def undo(show: Path) -> None:
    """Undoing a move in Blender undoes it in the file, and the same meshes are shown again."""
    bpy.context.preferences.edit.use_global_undo = True
    opened(show)
    bpy.ops.ed.undo_push(message="opened")
    bpy.ops.flowsculpt.make()
    before, mesh, place = text(show), at(6).name, scene_camera().matrix_world.copy()
    bpy.data.objects["1.0 vortex"].location.x = 1.25
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.flowsculpt.write()
    bpy.ops.flowsculpt.make()
    assert text(show) != before and at(6).name != mesh
    bpy.ops.ed.undo()
    assert math.isclose(bpy.data.objects["1.0 vortex"].location.x, 0.9, rel_tol=1e-6)
    bpy.ops.flowsculpt.write()
    assert text(show) == before
    assert at(6).name == mesh and len(at(6).vertices) > 100
    assert np.allclose(scene_camera().matrix_world, place), "the camera came after the step that was undone"
    vortex = bpy.data.objects["1.0 vortex"]
    vortex.location.x = 1.5
    bpy.ops.ed.undo_push(message="moved again")
    opened(show)
    bpy.ops.ed.undo()
    assert "No shot is open" in refused(bpy.ops.flowsculpt.write), "empties of a former reading"
    assert text(show) == before


def at_once(show: Path) -> None:
    """A move that has come to rest is written without a click; the panel draws all states."""
    opened(show)
    draw_again_and_again()
    look = sys.modules[f"{MODULE}.current_shot"]._look
    before = text(show)
    look()
    bpy.data.objects["1.0 vortex"].location.y = 0.7
    look()
    assert text(show) == before, "it may still be dragged"
    look()
    assert text(show) == before.replace("[0.9, 0.3, 0]", "[0.9, 0.7, 0]")
    bpy.ops.flowsculpt.make()
    for _ in range(3):
        look()
    loaded = sys.modules[f"{MODULE}.frame_meshes"].is_loaded
    assert all(loaded(row["key"]) for row in shown().listing["subjects"][0]["meshes"]), "loaded ahead"
    drawn = Layout()
    panel = sys.modules[f"{MODULE}.sidebar"].ShotPanel
    shown().message = "shots/T010_tiny.yaml:9:1: a long message that takes several lines in the sidebar"
    panel.draw(drawn, bpy.context)
    assert "6 of 6 frames simulated" in drawn.words and "flowsculpt.render" in drawn.words
    work = sys.modules[f"{MODULE}.current_shot"].current
    operators = sys.modules[f"{MODULE}.shot_operators"]
    run = operators.Run(shown().program, ["frames", SHOT, "--make"], show)
    work.runs.append(run)
    run.progress = {"doing": "simulating", "done": 2, "total": 6}
    panel.draw(drawn, bpy.context)
    assert "simulating: 2 of 6 frames" in drawn.words
    assert bpy.ops.flowsculpt.cancel() == {"FINISHED"}
    while not run.is_over:
        time.sleep(0.05)
    work.runs.remove(run)
    answered, said = in_window(operators, show)
    assert answered["shot"] == SHOT and said[0] == "Planning …" and said[-1] is None
    assert bpy.ops.flowsculpt.close() == {"FINISHED"}
    assert not bpy.data.objects and shown() is None
    panel.draw(drawn, bpy.context)


def draw_again_and_again() -> None:
    """Redraw the panel: missing meshes are not looked for each time."""
    module, looked = sys.modules[f"{MODULE}.shown_shot"], list[str]()

    def counted(file: str) -> Path:
        looked.append(file)
        return Path(file)

    module.Path = counted
    drawn = Layout()
    for _ in range(50):
        sys.modules[f"{MODULE}.sidebar"].ShotPanel.draw(drawn, bpy.context)
    module.Path = Path
    assert drawn.words.count("0 of 6 frames simulated") == 50
    assert 6 <= len(looked) <= 12, "six files, at most once a second"


def in_window(operators: Any, show: Path) -> tuple[Any, list[str | None]]:
    """Run an operator as windows do, by timer events; return its answer and the words of the status bar."""

    class Listing(operators._Running):
        def begin(self, context: Any) -> Any:
            return operators.Run(shown().program, ["frames", SHOT], show)

        def done(self, context: Any, answer: Any) -> None:
            self.answer = answer

    said: list[str | None] = []
    window = SimpleNamespace(screen=SimpleNamespace(areas=[]))
    manager = SimpleNamespace(event_timer_remove=lambda timer: None)
    context = SimpleNamespace(scene=bpy.context.scene, window=window, window_manager=manager)
    context.workspace = SimpleNamespace(status_text_set=said.append)
    operator = Listing()
    operator._timer = None
    operator._start(context)
    assert operator.modal(context, SimpleNamespace(type="MOUSEMOVE")) == {"PASS_THROUGH"}
    while operator.modal(context, SimpleNamespace(type="TIMER")) != {"FINISHED"}:
        time.sleep(0.05)
    return operator.answer, said


class Layout:
    """Takes what a panel draws."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.layout = self

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def draw(*given: Any, **options: Any) -> Layout:
            self.words += [each for each in (*given, *options.values()) if isinstance(each, str)]
            return self

        return draw


def camera(show: Path) -> None:
    """The camera goes both ways: one written into the shot is framed where Blender has it."""
    opened(show)
    bpy.ops.flowsculpt.make()
    own = bpy.data.objects.new("own", bpy.data.cameras.new("own"))
    bpy.context.collection.objects.link(own)
    bpy.context.scene.camera = own
    own.location, own.rotation_euler, own.data.lens = (1.0, -6.0, 2.0), (math.pi / 2, 0, 0), 35.0
    bpy.context.view_layer.update()
    wanted = own.matrix_world.copy()
    bpy.ops.flowsculpt.camera_to_shot()
    assert "position: [1, 2, 6]" in text(show) and "azimuth" not in text(show)
    assert "roll" not in text(show) and f"field_of_view: {math.degrees(2 * math.atan(18 / 35)):.6g}" in text(
        show
    )
    bpy.ops.flowsculpt.make()
    camera = bpy.data.objects[f"{SHOT} camera"]
    bpy.context.view_layer.update()
    assert np.allclose(camera.matrix_world, wanted, atol=1e-4)
    bpy.context.scene.camera = camera
    camera.keyframe_insert("location", frame=1)
    camera.location = (3.0, 2.0, 6.0)
    camera.keyframe_insert("location", frame=6)
    turned = camera.rotation_quaternion.to_matrix()
    camera.rotation_quaternion = (turned @ turned.__class__.Rotation(0.2, 3, "Z")).to_quaternion()
    bpy.ops.flowsculpt.camera_to_shot()
    bpy.ops.flowsculpt.make()
    for number in (1, 3, 6):
        bpy.context.scene.frame_set(number)
        assert np.allclose(shown().listing["cameras"][str(number)]["position"], camera.location, atol=1e-3)
    view = shown().listing["cameras"]["1"]
    up = camera.rotation_quaternion.to_matrix().col[1]
    right = Vector(view["target"]) - Vector(view["position"])
    assert abs(right.normalized().dot(up)) < 1e-4 and Vector(view["up"]).normalized().dot(up) > 0.999


def render(show: Path) -> None:
    """Render one frame: it comes back as an image sequence behind the camera."""
    opened(show)
    bpy.context.scene.frame_set(2)
    assert bpy.ops.flowsculpt.render() == {"FINISHED"}
    image = bpy.data.images[f"{SHOT} draft"]
    behind = bpy.data.objects[f"{SHOT} camera"].data.background_images[0]
    assert behind.image == image and image.source == "SEQUENCE"
    use = behind.image_user
    assert (use.frame_start, use.frame_duration, use.frame_offset) == (2, 1, 1)
    picture = bpy.data.images.load(image.filepath)
    pixels = np.array(picture.pixels[:]).reshape(*picture.size, -1)
    assert pixels[..., :3].std() > 0.01, "the picture is not black"


def use_in_scene(show: Path) -> None:
    """The sculpture is linked as one mesh, or as a stage."""
    opened(show)
    bpy.ops.flowsculpt.make()
    for form in ("abc", "usd", "gltf"):
        before = set(bpy.data.objects)
        assert bpy.ops.flowsculpt.use_in_scene(form=form) == {"FINISHED"}
        new = set(bpy.data.objects) - before
        assert any(item.type == "MESH" and len(item.data.vertices) > 50 for item in new), form


def film(show: Path) -> None:
    """Exported films are opened without the program: the same shape, frames and rate from every format."""
    (show / "shots" / f"{SHOT}.yaml").write_text(text(show) + "rate: 23.976\n")
    module, program = sys.modules[f"{MODULE}.program"], preferences().program
    for form, *options in (("abc",), ("usd",), ("gltf", "--plain")):
        words = [program, "export", form, SHOT, *options]
        subprocess.run(words, cwd=show, env=module._environment(), check=True, capture_output=True)
    preferences().program, os.environ["PATH"] = "", ""
    scene, folder, shapes = bpy.context.scene, show / "renders" / SHOT, []
    files = [
        folder / "models" / f"{SHOT}.abc",
        folder / "usd" / f"{SHOT}.usda",
        folder / "models" / f"{SHOT}.glb",
    ]
    for file in files:
        assert bpy.ops.flowsculpt.open_film(filepath=str(file)) == {"FINISHED"}
        first = 0 if file.suffix == ".glb" else 1
        assert (scene.frame_start, scene.frame_end) == (first, first + 5), file
        assert math.isclose(scene.render.fps / scene.render.fps_base, 23.976, rel_tol=1e-5), file
        shapes.append([extent(number) for number in (first, first + 5)])
        looks = [slot.material for each in film_meshes() for slot in each.material_slots]
        assert bool(looks) == (file.suffix in (".usda", ".glb")), "materials that the file holds"
    assert np.allclose(shapes, shapes[0], atol=0.15), "a glTF is within a quarter of an edge"
    assert np.allclose(shapes[0][0], 2.0, atol=1e-5) and not np.allclose(*shapes[0], atol=0.2)
    film_mistakes(files, show)


def film_mistakes(files: list[Path], show: Path) -> None:
    """A film that is damaged, incomplete or not there is one message, and the one before stays."""
    usd, (shape,) = files[1].parent, film_meshes()
    cut = show / "cut.abc"
    for content, name in (
        (files[0].read_bytes()[:-500], "cut.abc"),
        (b"", "none.glb"),
        (b"junk", "junk.abc"),
    ):
        (show / name).write_bytes(content)
        assert f"{name}: damaged" in refused(bpy.ops.flowsculpt.open_film, filepath=str(show / name))
    (usd / f"{SHOT}.0003.usdc").rename(show / "elsewhere.usdc")
    said = refused(bpy.ops.flowsculpt.open_film, filepath=str(files[1]))
    assert f"{SHOT}.0003.usdc is missing beside it" in said
    assert "not found" in refused(bpy.ops.flowsculpt.open_film, filepath=str(show / "nothing.abc"))
    assert "not a film that" in refused(bpy.ops.flowsculpt.open_film, filepath=str(Path(__file__)))
    assert film_meshes() == [shape] and cut.exists()
    assert bpy.context.scene.frame_end == 5, "six frames of the glTF, from 0"
    files[-1].unlink()
    drawn = Layout()
    sys.modules[f"{MODULE}.sidebar"].ShotPanel.draw(drawn, bpy.context)
    words = " ".join(word for word in drawn.words if word not in ("ERROR", "BLANK1"))
    assert f"{SHOT}.glb is not there any more. Open it where it is now." in words
    assert "install the program flowsculpt" in words and "flowsculpt.open" not in drawn.words


def film_meshes() -> list[Any]:
    return [each for each in bpy.data.objects if each.type == "MESH" and each.name != "floor"]


def extent(number: int) -> np.ndarray:
    """Return the size of the film's mesh at a frame, as it is shown."""
    bpy.context.scene.frame_set(number)
    (shape,) = film_meshes()
    shown = shape.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.ptp([shown.matrix_world @ vertex.co for vertex in shown.data.vertices], axis=0)


def subject(show: Path) -> None:
    """A selected mesh becomes the subject of a new shot."""
    opened(show)
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.active_object.name = "Suzanne head"
    shape = bpy.context.active_object
    shape.modifiers.new("whole", "REMESH").voxel_size = 0.1
    bpy.ops.flowsculpt.subject_from_mesh(shot="T020_monkey")
    written = (show / "shots" / "T020_monkey.yaml").read_text()
    assert "models/Suzanne_head.obj" in written
    assert shown().name == "T020_monkey"
    assert "exists already" in refused(bpy.ops.flowsculpt.subject_from_mesh, shot="T030_again")
    shape.name = "Other"
    assert "T020_monkey" in refused(bpy.ops.flowsculpt.subject_from_mesh, shot="T020_monkey")
    assert not (show / "shots" / "models" / "Other.obj").exists(), "another name can be tried"
    bpy.ops.object.select_all(action="DESELECT")
    assert "No mesh is selected" in refused(bpy.ops.flowsculpt.subject_from_mesh, shot="T030_none")


def mistakes(show: Path) -> None:
    """Each mistake is one report, and the file stays as it was."""
    scene, good = bpy.context.scene, preferences().program
    preferences().program = "/nowhere/flowsculpt"
    scene.flowsculpt.folder = str(show)
    assert "/nowhere/flowsculpt: not found" in refused(bpy.ops.flowsculpt.open)
    other = show / "other"
    other.write_text("#!/bin/sh\necho flowsculpt 7.0.1\n")
    other.chmod(0o755)
    preferences().program = str(other)
    assert "is flowsculpt 7.0.1, and this extension works with " in refused(bpy.ops.flowsculpt.open)
    other.write_text("#!/bin/sh\necho something else\n")
    assert "does not answer as flowsculpt does" in refused(bpy.ops.flowsculpt.open)
    preferences().program = good
    (show / "empty" / "shots").mkdir(parents=True)
    scene.flowsculpt.folder = str(show / "empty")
    assert "no shots in its folder" in refused(bpy.ops.flowsculpt.open)
    assert "No shot is open" in refused(bpy.ops.flowsculpt.make)
    opened(show)
    before = text(show)
    assert "Nothing to write" in refused(bpy.ops.flowsculpt.write)
    vortex = bpy.data.objects["1.0 vortex"]
    vortex.scale = (-0.5, -0.5, -0.5)
    report = refused(bpy.ops.flowsculpt.write)
    assert f"{SHOT}.yaml:9:" in report and "radius" in report and "\n" not in report
    assert text(show) == before and np.allclose(vortex.scale, 0.8), "the empty is as in the file again"
    by_hand = before.replace("strength: 1.5", "strength: 1.75")
    (show / "shots" / f"{SHOT}.yaml").write_text(by_hand)
    vortex.location.x = 2.0
    assert "has changed in the meantime; nothing was written" in refused(bpy.ops.flowsculpt.write)
    assert text(show) == by_hand
    vortex = bpy.data.objects["1.0 vortex"]
    assert vortex["strength"] == 1.75 and math.isclose(vortex.location.x, 0.9, rel_tol=1e-6)
    bpy.data.objects.remove(vortex)
    assert "its empty 1.0 vortex was deleted" in refused(bpy.ops.flowsculpt.write)
    (show / "shots" / f"{SHOT}.yaml").write_text(before.replace("axis: y", "axis: q"))
    report = refused(bpy.ops.flowsculpt.open)
    assert f"{SHOT}.yaml:7:13: " in report and "'q'" in report


def formula(show: Path) -> None:
    """Formulas and flows in a time of their own are shown, and refused where they are edited by keys."""
    path = show / "shots" / f"{SHOT}.yaml"
    path.write_text(text(show).replace("strength: 1.5", 'strength: {formula: "2*t"}') + "speed: 0.5\n")
    opened(show)
    assert shown().changed() == []
    curve = sys.modules[f"{MODULE}.key_curves"].curves_of(bpy.data.objects["1.0 vortex"], '["strength"]')[0]
    assert curve.lock and math.isclose(curve.evaluate(5), 2 * 4 / 24 * 0.5, rel_tol=0.05)
    curve.keyframe_points[1].co.y = 9.0
    look = sys.modules[f"{MODULE}.current_shot"]._look
    look(), look()
    assert "runs in a time of its own" in shown().message and shown().changed() == []
    curve = sys.modules[f"{MODULE}.key_curves"].curves_of(bpy.data.objects["1.0 vortex"], '["strength"]')[0]
    curve.keyframe_points[1].co.y = 9.0
    assert "runs in a time of its own" in refused(bpy.ops.flowsculpt.write)
    assert shown().changed() == []


def own_time(show: Path) -> None:
    """A flow's own time is shown again when it is edited in Blender."""
    path = show / "shots" / f"{SHOT}.yaml"
    twist = next(line for line in text(show).splitlines() if "- twist" in line)
    inner = twist.strip().removeprefix("- ").partition("  #")[0]
    path.write_text(text(show).replace(twist, f"  - repeated: {{period: 5, flows: [{{{inner}}}]}}"))
    opened(show)
    empty, repeated = bpy.data.objects["0.0 twist"], bpy.data.objects["0 repeated"]
    curve = curves(empty)['["amount"]'][0]
    assert curve.lock and math.isclose(curve.evaluate(4), 36, abs_tol=1)
    repeated["period"] = 2.0
    bpy.ops.flowsculpt.write()
    assert "period: 2," in text(show)
    curve = curves(empty)['["amount"]'][0]
    assert curve.lock and math.isclose(curve.evaluate(4), 12, abs_tol=1), "the second frame of round two"
    assert shown().changed() == []


KINDS = {
    "copies": "subjects: {one: {solid: box, size: [1, 1, 1], copies: "
    "{count: 5, rigid: true, region: {sphere: {radius: 3}}}}}",
    "net": "subject: {net: {solid: sheet, size: [2, 2]}, rows: 6, columns: 5}",
    "cloud": "subject: {cloud: {solid: box, size: [1, 1, 1]}, count: 50, radius: 0.02}",
    "several": "subjects: {one: {solid: box, size: [1, 1, 1]}, two: {solid: icosphere, radius: 0.5}}",
}


def kinds(show: Path) -> None:
    """Copies, nets, clouds and several subjects are shown as what they are."""
    path = show / "shots" / f"{SHOT}.yaml"
    shot = path.read_text().replace("resample: {max_edge_length: 0.4}\n", "")
    shapes = {}
    for kind, subject in KINDS.items():
        resample = "" if kind in ("net", "cloud") else "resample: {max_edge_length: 0.4}\n"
        path.write_text(shot.replace("subject: {solid: box, size: [2, 2, 2]}\n", f"{subject}\n{resample}"))
        opened(show)
        bpy.ops.flowsculpt.make()
        bpy.context.scene.frame_set(6)
        shapes[kind] = [bpy.data.objects[name].data for name in shown().objects.values()]
        counts = [(len(mesh.vertices), len(mesh.polygons)) for mesh in shapes[kind]]
        files = [dict(np.load(subject["meshes"][5]["file"])) for subject in shown().listing["subjects"]]
        many = [len(arrays.get("copies", (0,))) for arrays in files]
        assert counts == [
            (times * len(arrays["vertices"]), times * len(arrays["faces"]))
            for times, arrays in zip(many, files, strict=True)
        ], (kind, counts)
        assert not any(mesh.validate() for mesh in shapes[kind])
        if kind == "copies":
            assert many == [5]
            sharp = np.empty(len(shapes[kind][0].edges), bool)
            shapes[kind][0].attributes["sharp_edge"].data.foreach_get("value", sharp)
            assert sharp.sum() == 5 * len(files[0]["creases"]) > 0
    assert len(shapes["several"]) == 2


def uninstall(show: Path) -> None:
    """Disable and remove: no handler, timer, operator or panel is left, and Blender goes on."""
    opened(show)
    bpy.ops.flowsculpt.make()
    handlers = [
        len(getattr(bpy.app.handlers, name)) for name in ("frame_change_pre", "undo_post", "load_post")
    ]
    bpy.ops.extensions.package_uninstall(repo_index=1, pkg_id="flowsculpt")
    left = [len(getattr(bpy.app.handlers, name)) for name in ("frame_change_pre", "undo_post", "load_post")]
    assert [before - after for before, after in zip(handlers, left, strict=True)] == [1, 1, 1]
    assert MODULE not in bpy.context.preferences.addons
    assert not hasattr(bpy.types, "FLOWSCULPT_PT_shot") and not hasattr(bpy.types.Scene, "flowsculpt")
    bpy.context.scene.frame_set(3)


def measure(show: Path) -> dict[str, float]:
    """Scrub through all frames again and again once they are in memory; return frames a second.

    Each is evaluated, with its triangles and the normals of corners: all that a viewport uploads to draw it.
    """
    opened(show)
    bpy.ops.flowsculpt.make()
    numbers = list(shown().numbers)
    started = time.perf_counter()
    sizes = [evaluated(number) for number in numbers]
    loading = time.perf_counter() - started
    started, rounds = time.perf_counter(), 5
    for _ in range(rounds):
        for number in numbers:
            evaluated(number)
    seconds = time.perf_counter() - started
    return {
        "vertices": max(sizes),
        "first_time": len(numbers) / loading,
        "in_memory": rounds * len(numbers) / seconds,
    }


def evaluated(number: int) -> int:
    """Evaluate a frame as drawing it does; return its number of vertices."""
    at(number)
    mesh = sculpture().evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert len(mesh.loop_triangles) > 0 and mesh.corner_normals[0].vector.length > 0.9
    return len(mesh.vertices)


if __name__ == "__main__":
    name, package, program, folder = sys.argv[1:5]
    installed(Path(package), shutil.which(program) or program)
    found = globals()[name](Path(folder))
    print("RESULT", json.dumps(found))
