"""What the names under `lights` and `stage` mean; see `hints`."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import BaseModel

from pipeline.flow.parameters import Sense
from pipeline.shot.documents.lights_and_stage import (
    LightsDocument,
    SkyDocument,
    SoftboxDocument,
    StageDocument,
    SunDocument,
)

SET_HINTS: Mapping[type[BaseModel], Mapping[str, Sense]] = {
    LightsDocument: {
        "rig": Sense("the lamps by name; studio where no lights are written out"),
        "softboxes": Sense("lamps of your own, beside those of a rig that is named"),
        "sky": Sense("a gradient of light from all around, in place of the rig's"),
        "sun": Sense("the sun and the sky of a clear day, standing still while the camera moves"),
        "hdri": Sense("a file beside the shot: a map of all directions, EXR or HDR, twice as wide as high"),
        "visible": Sense("whether the lens sees the hdri where the stage leaves it"),
        "turn": Sense("all lights about the vertical, anticlockwise from above", "degrees"),
        "intensity": Sense("how many times as strong: all lights, or each by its name"),
        "exposure": Sense("brighter or darker", "stops"),
    },
    SoftboxDocument: {
        "position": Sense("right, up, towards the camera; the subject has a half-size of 1"),
        "width": Sense("in half-sizes of the subject"),
        "height": Sense("in half-sizes of the subject"),
        "radiance": Sense("linear Rec.709 or a number; 20 for a large lamp, 150 for a small one"),
        "target": Sense("what it faces; [0, 1, 0] is the subject's middle"),
    },
    SkyDocument: {
        "zenith": Sense("radiance from above, linear Rec.709 or a number"),
        "horizon": Sense("radiance from the horizon; as from above"),
        "nadir": Sense("radiance from below; as from the horizon"),
        "visible": Sense("whether the lens sees it where the stage leaves it"),
    },
    SunDocument: {
        "time": Sense("by the sun, which is highest at 12", "hours"),
        "latitude": Sense("north positive; 48", "degrees"),
        "day": Sense("of the year; 172, midsummer in the north"),
        "north": Sense("where north lies, as azimuth; 180, behind the subject", "degrees"),
        "elevation": Sense("above the horizon, in place of a time; 32", "degrees"),
        "azimuth": Sense("0 shines from the front, positive from the right; -78", "degrees"),
        "turbidity": Sense("haze, from 1 to 10"),
        "width": Sense("of its disc; larger ones have softer shadows; 0.54", "degrees"),
        "visible": Sense("whether the lens sees the sky where the stage leaves it"),
    },
    StageDocument: {
        "kind": Sense("what the subject stands on, by name"),
        "colour": Sense("of floor and wall, linear Rec.709: red, green, blue from 0 to 1"),
        "roughness": Sense("of a coat on the floor: 0.05 mirrors, 0.4 shimmers; matt by itself"),
        "width": Sense("of the plinth, in half-sizes of the subject; 1.7"),
        "height": Sense("of the plinth, in half-sizes of the subject; 1.6"),
        "round": Sense("a turned plinth instead of a square one"),
    },
}
