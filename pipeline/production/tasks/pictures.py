"""From surfaces to pictures: render raw passes, finish them."""

from __future__ import annotations

from pathlib import Path

from pipeline.arrays import Indices
from pipeline.production.framing import Framing, turned
from pipeline.production.npz import read_npz
from pipeline.production.take import PictureKeys
from pipeline.production.tasks.context import Context
from pipeline.shot.net import ControlNet
from pipeline.shot.shot import Shot
from render.denoise import denoise
from render.engine import choose
from render.frame import Layers, render_frame
from render.image import read_exr, write_exr
from render.plain import to_plain
from render.spheres import Spheres
from render.surface import Surface
from render.wireframe import outlines


def render(context: Context) -> bool:
    """Render the raw pictures of a batch: passes averaged, AOVs beside the beauty."""
    take = context.take
    engine = choose([take.variant], threads=context.job.threads)
    framings = take.framings(context.store) or {}
    keys = context.picture_keys(take, context.job.frames)
    picture = take.shot.picture

    def work(number: int) -> bool:
        framing = framings[number]

        def write(path: Path) -> None:
            layers = render_frame(
                _surface(context, number),
                picture.look,
                picture.lights,
                picture.stage,
                framing.placement,
                framing.camera,
                take.quality,
                take.seed(number),
                engine,
            )
            write_exr(path, layers, _header(context, number, framing, keys[number]))

        target = take.folders.raw(take.quality_name, number)
        return context.make("raw", keys[number].raw, target, write)

    return context.each(context.job.frames, work)


def finish(context: Context) -> bool:
    """Finish the pictures of a batch: noise removed, the beauty alone, ready for the view."""
    take = context.take
    keys = context.picture_keys(take, context.job.frames)
    effort = take.quality.denoise

    def work(number: int) -> bool:
        raw = take.folders.raw(take.quality_name, number)

        def write(path: Path) -> None:
            layers, header = context.read("raw", keys[number].raw, raw, read_exr)
            quiet = layers["beauty"] if effort == "off" else denoise(layers, effort)
            write_exr(path, Layers({"beauty": quiet}, layers.facts), {**header, "key": keys[number].frame})

        target = take.folders.frame(take.quality_name, number)
        return context.make("frame", keys[number].frame, target, write)

    return context.each(context.job.frames, work)


def _surface(context: Context, number: int) -> Surface | Spheres:
    """What a picture shows, turned as its pose says."""
    take = context.take
    pose = take.poses[number]
    path = take.motion_folders.normals(pose.mesh)
    arrays = context.read("normals", take.normals_key(pose.mesh), path, read_npz)
    vertices = turned(arrays["vertices"], pose.spin)
    if "radii" in arrays:
        return Spheres(vertices.astype("float32"), arrays["radii"], material=arrays["material"])
    normals = turned(arrays["normals"], pose.spin, about_origin=True)
    return Surface(
        vertices.astype("float32"),
        normals.astype("float32"),
        arrays["faces"],
        material=arrays["material"],
        edges=_edges(take.shot, arrays["faces"]),
    )


def _edges(shot: Shot, faces: Indices) -> Indices | None:
    """Those of the mesh that was resampled, however finely it is cut for rendering; of a net all."""
    if shot.picture.look.wireframe is None or isinstance(shot.motion.subject, ControlNet):
        return None
    return outlines(faces, shot.picture.tessellate)


def _header(context: Context, number: int, framing: Framing, keys: PictureKeys) -> dict[str, object]:
    """What the EXR says of itself: enough to make it again."""
    take = context.take
    resampling = take.shot.motion.resampling_at(take.poses[number].mesh)
    return {
        "shot": take.shot.name,
        "frame": number,
        "quality": take.quality_name,
        "key": keys.raw,
        "mesh_key": take.mesh_key(take.poses[number].mesh),
        "seed": take.seed(number),
        "look": to_plain(take.shot.picture.look),
        **framing.as_data(),
        **(resampling.settings() if resampling else {"resample": "off"}),
    }
