"""What the names of shot and film files mean, in a line each, with their units: for editors and for plots.

What flows take is said where they are (`pipeline.flow.parameters.Sense`); this is the rest.
"""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import BaseModel

from pipeline.flow.parameters import Sense
from pipeline.shot.documents.camera import CameraDocument
from pipeline.shot.documents.curves import Key, Keyed, OverTime, OverTimeTriple
from pipeline.shot.documents.flow_parameters import FlowParameters
from pipeline.shot.documents.flows import (
    BlendDocument,
    Composition,
    FlowDocument,
    MirroredDocument,
    PlacedDocument,
    RepeatedDocument,
    ReversedDocument,
    VelocityDocument,
    WithinDocument,
)
from pipeline.shot.documents.regions import (
    BoxDocument,
    HalfSpaceDocument,
    MeshDocument,
    RegionDocument,
    RoundDocument,
    SphereDocument,
)
from pipeline.shot.documents.resampling import (
    ActiveAngleDocument,
    ActiveLengthDocument,
    CameraDistanceDocument,
    CurvatureDocument,
    ResampleDocument,
    SmoothDocument,
)
from pipeline.shot.documents.resampling import RegionDocument as CreasesDocument
from pipeline.shot.documents.shot import (
    CardDocument,
    ClipDocument,
    FilmDocument,
    QualitiesDocument,
    QualityDocument,
    ShotDocument,
    SoundDocument,
)
from pipeline.shot.documents.views import ViewDocument
from pipeline.shot.set_hints import SET_HINTS
from pipeline.shot.shutter import ShutterDocument
from pipeline.shot.subject_hints import SUBJECT_HINTS

_MADE_OF = {
    "within": Sense("in a region alone"),
    "placed": Sense("scaled, then turned, then moved"),
    "mirrored": Sense("across a plane"),
    "blend": Sense("from one, or nothing, to another"),
}

HINTS: Mapping[type[BaseModel], Mapping[str, Sense]] = {
    **SUBJECT_HINTS,
    **SET_HINTS,
    ShotDocument: {
        "title": Sense("what the shot is called"),
        "extends": Sense("the shot beside this file that says what this one does not"),
        "intent": Sense("what it is to show, in a sentence"),
        "frames": Sense("from the first to the last, as in 1-96; the first shows the subject at rest"),
        "rate": Sense("24, 23.976 or 24000/1001", "frames per second"),
        "subject": Sense("what flows: a solid by name, or a model from a file"),
        "resample": Sense("how fine the surface is kept while it flows; off compares"),
        "flows": Sense("what moves the subject, one after another within each frame"),
        "integrator": Sense("how velocities are followed: rk4, or adaptive where they are steep somewhere"),
        "tolerance": Sense("how far a sub-step of the adaptive integrator may err", "units"),
        "max_step": Sense("how far a sub-step may take a vertex", "maximum edges"),
        "substeps": Sense("into how many steps a frame is cut; by itself as many as the flow needs"),
        "speed": Sense("at which the flow's time runs: 1 as it is, 0 stands still, below 0 backwards"),
        "look": Sense("the material, by name or spelt out"),
        "smooth": Sense("curved patches over the triangles"),
        "camera": Sense("from where the subject is seen; distance and aim are found by framing"),
        "lights": Sense("the rig, by name or spelt out"),
        "stage": Sense("what the subject stands on, by name or spelt out"),
        "shutter": Sense("how long light comes in for a frame: motion blur"),
        "aovs": Sense("layers beside the beauty: names, or names with half or float"),
        "view": Sense("how light is shown: a view of an OpenColorIO config; ACES 2.0 by default"),
        "quality": Sense("what this shot needs otherwise at some quality"),
    },
    ViewDocument: {
        "config": Sense("of OpenColorIO: ocio://default or another that it has built in, or a file"),
        "view": Sense("its name in the config"),
        "display": Sense("its name in the config; by default Rec.709 for movies and sRGB for pictures"),
        "space": Sense("what the config calls linear Rec.709, where it is not found by itself"),
    },
    ShutterDocument: {
        "angle": Sense("for which it is open; 360 is a whole frame, 0 no blur", "degrees"),
        "phase": Sense("at which it opens, before the frame; by itself half the angle", "degrees"),
    },
    ClipDocument: {
        "shot": Sense("its name"),
        "frames": Sense("those that are shown, as in 10-40, or 10-40x2 for every second; by default all"),
        "dissolve": Sense("over how many it comes through what is before it; they overlap", "frames"),
    },
    CardDocument: {
        "card": Sense("words between shots"),
        "subtitle": Sense("below them"),
        "seconds": Sense("how long they stand", "s"),
        "dissolve": Sense("over how many frames it comes through what is before it; they overlap", "frames"),
    },
    SoundDocument: {
        "file": Sense("beside this one: WAV, FLAC, or what else FFmpeg reads"),
        "start": Sense(
            "of the film, at which it begins; before 0, so much of its beginning is left out", "s"
        ),
        "gain": Sense("by which it is made louder, or below 0 softer", "dB"),
        "fade_in": Sense("over which it comes", "s"),
        "fade_out": Sense("over which it goes, at its end or the film's", "s"),
    },
    FilmDocument: {
        "title": Sense("what the film is called; on its first card"),
        "subtitle": Sense("below the title"),
        "credits": Sense("lines of the last card"),
        "shots": Sense("names of shot files beside this one, and cards, in the order of the edit"),
        "sound": Sense("what is heard, from a file beside this one"),
        "rate": Sense("24, 23.976 or 24000/1001: the same for all shots", "frames per second"),
        "title_seconds": Sense("how long the title stands; 0 leaves it out", "s"),
        "credits_seconds": Sense("how long the credits stand; 0 leaves them out", "s"),
    },
    ResampleDocument: {
        "max_edge_length": Sense("edges longer than this are split", "units"),
        "min_edge_length": Sense("shorter edges collapse; below half the maximum, by default 40%", "units"),
        "hard_angle": Sense("an edge over which the surface turns by more is a crease", "degrees"),
        "max_vertices": Sense("where a frame needs more, it fails"),
        "gradation": Sense("by how much lengths may differ between the ends of an edge, as a share of it"),
        "method": Sense("triangles, or polyhedra: faces of any number of sides, sliced by planes"),
        "placement": Sense("where new vertices go: on the surface at rest, on a smooth one, amid the edge"),
        "splits": Sense("edges in two, or faces in four (with placement: chord)"),
        "min_roundness": Sense("triangles less round are mended: 0 none, 0.85 demanding"),
        "normals": Sense("carried through the flow, or of the geometry of each frame"),
        "rest_interval": Sense("frames after which the present surface becomes the undeformed one"),
        "creases": Sense("edges that stay hard: those hard at rest, those of the model's file, a region"),
        "cutting": Sense("of polyhedra: all parallel cuts at once, or in two and again"),
        "collapse": Sense("of polyhedra: short edges, or small faces"),
    },
    ActiveLengthDocument: {
        "formula": Sense("over x, y, z, frame and t, seconds", "units"),
        "curvature": Sense("as long as the surface is flat"),
        "camera": Sense("of a constant size in a picture"),
    },
    ActiveAngleDocument: {"formula": Sense("over x, y, z, frame and t, seconds", "degrees")},
    CreasesDocument: {"formula": Sense("over x, y and z: edges stay hard where it holds at rest")},
    CurvatureDocument: {
        "tolerance": Sense("how far the middle of an edge may lie beside the surface", "units"),
        "finest": Sense("no edge is made shorter", "units"),
        "coarsest": Sense("nor longer", "units"),
    },
    CameraDistanceDocument: {
        "position": Sense("of the camera", "units"),
        "pixels": Sense("how long edges are in the picture", "pixels"),
        "finest": Sense("no edge is made shorter", "units"),
        "coarsest": Sense("nor longer", "units"),
        "field_of_view": Sense("horizontal", "degrees"),
        "width": Sense("of the picture", "pixels"),
    },
    SmoothDocument: {
        "tessellate": Sense("into how many pieces each edge is cut; 1 is off"),
        "dicing": Sense("how long a piece of an edge is in the picture at most, such as 2px", "pixels"),
    },
    CameraDocument: {
        "azimuth": Sense("0 looks from the front, positive from the right; the set turns along", "degrees"),
        "elevation": Sense("above the horizon", "degrees"),
        "orbit": Sense("how fast the camera goes around the set, which stands", "degrees/s"),
        "field_of_view": Sense("horizontal", "degrees"),
        "focal_length": Sense("of the lens, in place of the field of view", "mm"),
        "sensor_width": Sense("of the film or sensor behind the lens; full frame by default", "mm"),
        "margin": Sense("the share of the picture left empty on each side; or action, or title"),
        "follow": Sense("1 goes along with the sculpture, 0 stands still as the whole shot needs it"),
        "dolly": Sense("factor on the distance that framing finds: below 1 is closer"),
        "distance": Sense("from the target, in place of the one that framing finds", "units"),
        "target": Sense("what is looked at, in place of the sculpture's middle", "units"),
        "position": Sense("where the camera stands, in place of all that framing finds", "units"),
        "roll": Sense("about the lens, clockwise as the camera looks", "degrees"),
        "aperture": Sense("f-number; the smaller, the more is out of focus; without it all is sharp"),
        "focus": Sense("what is sharp: subject, a distance from the lens, or a place", "units"),
        "unit": Sense("what a scene unit is; by default a sculpture is about 200 mm large", "mm"),
    },
    QualitiesDocument: {
        "preview": Sense("480×270, for looking while working"),
        "draft": Sense("480×270, one bounce more"),
        "daily": Sense("960×540, for review"),
        "final": Sense("1920×1080, for delivery"),
    },
    QualityDocument: {
        "samples": Sense("of light, for each pixel: up to 16, or a multiple of it"),
        "auxiliary_samples": Sense("of albedo, normal and depth, which guide the denoiser, for each pixel"),
        "depth": Sense("vertices of a path of light"),
        "denoise": Sense("how hard noise is removed"),
        "temporal_denoise": Sense("before and after, which the temporal denoiser reads; 0 is off", "frames"),
        "noise_threshold": Sense("noise that is quiet enough to save the samples left, such as 0.03"),
    },
    Keyed: {
        "keys": Sense("values by their times: frames, or seconds as 0.5s"),
        "ease": Sense("how values go from each key to the next"),
        "before": Sense("what they do before the first key"),
        "after": Sense("what they do after the last"),
    },
    Key: {
        "value": Sense("the value at this key"),
        "ease": Sense("how values go from here to the next key"),
        "left": Sense("handle of a bezier way: [time, value] away from the key, the time negative"),
        "right": Sense("handle of a bezier way: [time, value] away from the key"),
    },
    OverTime: {"formula": Sense("over frame and t, seconds")},
    OverTimeTriple: {"formula": Sense("three of them, over frame and t, seconds")},
    VelocityDocument: _MADE_OF,
    FlowDocument: {
        **_MADE_OF,
        "sum": Sense("velocities that act together"),
        "sequence": Sense("one after another, where one entry is wanted"),
        "reversed": Sense("backwards"),
        "repeated": Sense("what happens from 0 to the end of the period, again and again"),
    },
    Composition: {"flows": Sense("what it is made of; they act one after another")},
    WithinDocument: {"region": Sense("where they act")},
    PlacedDocument: {
        "translate": Sense("where the origin goes", "units"),
        "rotate": Sense("about x, then y, then z", "degrees"),
        "scale": Sense("factor on distances and speeds"),
    },
    MirroredDocument: {
        "normal": Sense("of the mirror: x, y, z or a vector"),
        "centre": Sense("a point of the mirror", "units"),
    },
    BlendDocument: {
        "flows": Sense("one that comes in from nothing, or two: from the first to the second"),
        "weight": Sense("of the last, from 0 to 1"),
    },
    ReversedDocument: {"duration": Sense("how much is undone: frames, or seconds as 1s; the whole shot")},
    RepeatedDocument: {"period": Sense("frames, or seconds as 1s")},
    RegionDocument: {
        "sphere": Sense("all within a radius of a point"),
        "box": Sense("all within sides along x, y and z"),
        "half_space": Sense("all below a plane"),
        "capsule": Sense("all within a radius of a piece of a line; round ends"),
        "cylinder": Sense("the same with flat ends"),
        "mesh": Sense("all that the closed surface in a file holds"),
        "falloff": Sense("over which its weight falls to 0, outside", "units"),
        "falloff_type": Sense("the profile of that: smooth, sine or linear"),
        "invert": Sense("outside instead of inside"),
    },
    MeshDocument: {
        "file": Sense("an OBJ, PLY, STL, OFF or GLB beside the shot file"),
        "centre": Sense("where its origin lies", "units"),
        "scale": Sense("factor on its coordinates"),
    },
    SphereDocument: {"centre": Sense("its middle", "units"), "radius": Sense("its size", "units")},
    BoxDocument: {
        "centre": Sense("its middle", "units"),
        "size": Sense("its sides along x, y and z", "units"),
    },
    HalfSpaceDocument: {
        "centre": Sense("a point of its plane", "units"),
        "normal": Sense("points up from it, and out: x, y, z or a vector"),
    },
    RoundDocument: {
        "axis": Sense("along which it lies: x, y, z or a vector"),
        "centre": Sense("its middle", "units"),
        "length": Sense("of the piece of its line", "units"),
        "radius": Sense("around that", "units"),
    },
}


def hint(document: type[BaseModel], name: str) -> Sense | None:
    """What a name of a document means; None where nothing is said."""
    if issubclass(document, FlowParameters):
        return next((p.doc for p in (*document.own, *document.parameters) if p.name == name), None)
    return next((HINTS[kind][name] for kind in document.__mro__ if name in HINTS.get(kind, ())), None)


def in_a_line(sense: Sense) -> str:
    return f"{sense.text} ({sense.unit})" if sense.unit else sense.text
