"""What is said under `subject` and `look`, in a line each, as `hints` has the rest."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import BaseModel

from pipeline.flow.parameters import Sense
from pipeline.shot.documents.look import AbsorptionDocument, LookDocument, WireframeDocument
from pipeline.shot.documents.look_parts import (
    MarbleDocument,
    MeasureDocument,
    PatternDocument,
    PictureDocument,
    PigmentDocument,
    ProjectionDocument,
    ReliefDocument,
    ScaleDocument,
    SpecklesDocument,
)
from pipeline.shot.documents.shot import ModelDocument
from pipeline.shot.documents.subject import CloudDocument, NetDocument, NetSolidDocument, SolidDocument

SUBJECT_HINTS: Mapping[type[BaseModel], Mapping[str, Sense]] = {
    SolidDocument: {
        "solid": Sense("its name"),
        "size": Sense("its sides", "units"),
        "radius": Sense("from the middle to the surface, or of a torus to the middle of its tube", "units"),
        "length": Sense("from end to end", "units"),
        "tube_radius": Sense("of the tube of a torus; below its radius", "units"),
        "spacing": Sense("of a lattice: between the middles of its bars", "units"),
        "thickness": Sense("of a lattice's bars", "units"),
        "caps": Sense("the ends of a rod"),
    },
    ModelDocument: {
        "model": Sense("an OBJ, PLY, STL, OFF or GLB beside the shot file"),
        "scale": Sense("factor on all coordinates"),
    },
    CloudDocument: {
        "cloud": Sense("points that are drawn as spheres: a file of them, or a solid that they fill"),
        "radius": Sense("of the spheres, or the name of an attribute of the file", "units"),
        "scale": Sense("factor on the coordinates of a file"),
        "count": Sense("how many points, of a solid"),
        "fill": Sense("within the solid, or on its surface"),
        "seed": Sense("another one strews the points otherwise"),
    },
    NetDocument: {
        "net": Sense("control points of a smooth surface: a file, rows of points, or a solid"),
        "scale": Sense("factor on the coordinates of a file"),
        "rows": Sense("how many, of a solid"),
        "columns": Sense("how many points a row has, of a file or a solid"),
        "closed": Sense("which ends follow each other"),
    },
    NetSolidDocument: {
        "solid": Sense("its name"),
        "size": Sense("its sides", "units"),
        "radius": Sense("of a tube, or of a torus to the middle of its tube", "units"),
        "length": Sense("from end to end", "units"),
        "tube_radius": Sense("of the tube of a torus; below its radius", "units"),
    },
    LookDocument: {
        "material": Sense("the look to begin with"),
        "bsdf": Sense("in its place a material of Mitsuba, written out by the names of its manual"),
        "colour": Sense("linear Rec.709: red, green, blue from 0 to 1; or a picture beside the shot file"),
        "roughness": Sense("0.03 is a mirror's gloss, 0.5 is matt; or a picture beside the shot file"),
        "sheen": Sense("of satin: how much lighter it is where it turns away"),
        "metallic": Sense("of satin: how much the highlight takes the colour"),
        "coat": Sense("of satin: how much of a clear coat lies on it"),
        "grain": Sense("of brushed metal: what scratches lie across: x, y, z or a vector"),
        "refraction": Sense("of glass: its index, 1.5 for window glass and honey"),
        "absorption": Sense("of glass: how light that goes through it takes on colour with the distance"),
        "density": Sense("of smoke: how often light is scattered through half of the subject"),
        "wireframe": Sense("the edges of the mesh, drawn over the look"),
        "pigment": Sense("a pattern that replaces the colour and moves with the material"),
        "measure": Sense("a number that replaces the colour, shown by a colour map"),
        "relief": Sense("a picture beside the shot file whose light parts stand out"),
        "projection": Sense("how pictures from files are laid on the subject at rest"),
    },
    MeasureDocument: {
        "speed": Sense("of the flow at each point", "units/s"),
        "stretch": Sense("how many times as long the direction is that was lengthened most since the rest"),
        "area": Sense("how many times as large the surface is as at rest"),
    },
    ScaleDocument: {
        "colours": Sense("the colour map: viridis, inferno or another"),
        "range": Sense("what its two ends stand for, in every frame the same"),
    },
    PictureDocument: {
        "file": Sense("an EXR, PNG, JPEG or TIFF beside the shot file"),
        "space": Sense("srgb, linear, data, or a colour space of OpenColorIO; by itself what the file is"),
    },
    ReliefDocument: {
        "file": Sense("an EXR, PNG, JPEG or TIFF beside the shot file"),
        "height": Sense("of white over black; below 0 dark parts stand out", "units"),
    },
    ProjectionDocument: {
        "kind": Sense("planar, box, cylindrical or spherical"),
        "axis": Sense("towards whom a planar picture looks, or what others go around: x, y, z or a vector"),
        "centre": Sense("where the middle of the picture lies, or the axis", "units"),
        "scale": Sense("how wide a picture is, or how high a cylindrical one", "units"),
        "repeats": Sense("how often it is seen on the way around"),
        "turn": Sense("in its plane, anticlockwise, or about the axis", "degrees"),
        "offset": Sense("by which shares of itself it lies further right and up"),
    },
    WireframeDocument: {
        "colour": Sense("of the lines; linear Rec.709: red, green, blue from 0 to 1"),
        "width": Sense("of the lines", "pixels"),
    },
    AbsorptionDocument: {
        "colour": Sense("what is left of white light that went so far: red, green, blue up to 1"),
        "depth": Sense("how far that is, in halves of the subject's size"),
    },
    PigmentDocument: {
        "layers": Sense("bands along an axis"),
        "gradient": Sense("from colour to colour along an axis"),
        "rings": Sense("bands about an axis"),
        "marble": Sense("veins in a ground"),
        "speckles": Sense("dots in a ground"),
    },
    PatternDocument: {
        "colours": Sense("two to sixteen, linear Rec.709"),
        "scale": Sense("how large the pattern is", "units"),
        "axis": Sense("along or about which it lies: x, y, z or a vector"),
        "centre": Sense("where it begins", "units"),
        "softness": Sense("of the borders between colours"),
        "turbulence": Sense("how much noise bends it"),
        "octaves": Sense("of that noise: how fine it goes"),
        "seed": Sense("another one, another pattern"),
    },
    MarbleDocument: {"share": Sense("how much of the ground the veins take")},
    SpecklesDocument: {"share": Sense("the radius of the largest speckle, in cells")},
}
