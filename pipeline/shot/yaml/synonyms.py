"""Words of other programs and of English, and what a shot calls them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

_NAMES = {
    "title": "name",
    "shot": "name clip scene",
    "material": "name shader type look",
    "solid": "name type primitive",
    "rig": "name type",
    "kind": "name type",
    "rate": "fps frame_rate framerate strength amplitude amount intensity magnitude factor velocity speed",
    "frames": "frame frame_range frames_range range timeline duration frame_start frame_end start end in out",
    "shots": "clips scenes sequence",
    "card": "title text",
    "dissolve": "transition crossfade fade",
    "sound": "music audio",
    "seconds": "duration",
    "subject": "object geometry mesh",
    "model": "mesh file path filename text",
    "look": "material shader",
    "resample": "remesh resampling subdivisions subdivision segments",
    "flows": "flow deformers modifiers",
    "lights": "light lighting environment",
    "hdri": "environment hdr envmap",
    "aovs": "passes",
    "file": "path filename",
    "size": "dimensions width wavelength frequency",
    "tube_radius": "tube minor_radius",
    "radius": "major_radius diameter",
    "max_edge_length": (
        "max edge_length length max_length voxel_size target_edge_length target_length subdivisions "
        "subdivision segments"
    ),
    "min_edge_length": "min min_length",
    "hard_angle": "crease_angle edge_angle angle",
    "amount": "angle strength amplitude intensity magnitude factor rate",
    "speed": "angle strength amount intensity magnitude velocity rate",
    "centre": "center origin pivot pos location",
    "position": "pos location eye path",
    "weight": "strength amount",
    "intensity": "strength brightness energy",
    "strength": "amplitude amount intensity magnitude factor rate speed energy",
    "rotate": "rotation euler",
    "radiance": "intensity energy",
    "gain": "factor multiplier volume",
    "curl_noise": "noise turbulence curl displace displacement mountain perlin simplex jitter",
    "vortex": "swirl whirl",
    "scaling": "scale grow",
    "expansion": "inflate",
    "rotation": "rotate spin turn",
    "translation": "translate move gravity force",
    "keys": "key keyframes",
    "formula": "expression expr",
    "ease": "interpolation easing",
    "after": "extrapolation",
    "base": "offset minimum",
    "field_of_view": "fov",
    "focal_length": "focal lens",
    "aperture": "fstop f_stop dof depth_of_field",
    "target": "look_at lookat",
    "azimuth": "pan yaw rotation rotate",
    "elevation": "tilt pitch",
    "focus": "focus_distance",
    "colour": "color base_color diffuse albedo texture",
    "roughness": "gloss specular",
    "refraction": "ior",
    "subsurface": "sss translucency",
    "coat": "clearcoat",
    "relief": "bump height_map displacement_map normal_map",
    "softboxes": "area area_light softbox",
    "exposure": "brightness",
    "samples": "spp",
    "depth": "bounces max_depth",
    "tessellate": "subdivisions subdivision subdiv subdivide",
    "aspect": "aspect_ratio ratio",
    "shutter": "motion_blur",
    "stage": "background",
    "dolly": "zoom",
    "quality": "render",
    "picture": "resolution aspect aspect_ratio format orientation size width height ratio",
}
"""By each name of shot files, words for it; of several names that fit the place, the first is meant."""

_VALUES = {
    "box": "cube cuboid",
    "icosphere": "sphere ball",
    "sheet": "plane grid quad",
    "rod": "cylinder capsule tube pipe",
    "torus": "donut ring",
    "y": "up",
    "sine_in_out": "ease ease_in_out smooth",
    "sine_in": "ease_in",
    "sine_out": "ease_out",
    "bezier": "spline",
    "constant": "step stepped hold",
    "loop": "cycle repeat",
    "ping_pong": "mirror",
    "continue": "extrapolate linear",
    "hold": "constant",
    "spherical": "equirectangular panorama latlong",
    "dome": "fisheye fulldome",
    "chrome": "metal gold silver",
    "glaze": "plastic",
    "clay": "matte",
    "ground": "floor",
    "cyclorama": "infinity studio",
    "none": "off no",
    "normal": "normals",
    "velocity": "motion vectors",
    "depth": "z",
    "rk4": "euler runge_kutta",
    "draft": "low preview",
    "daily": "medium",
    "final": "high best",
}
"""By values, words for which they come closest."""


def as_name(word: object) -> str:
    """Return a word as shot files spell names: `focalLength` and `Focal length` are focal_length."""
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", str(word))
    return re.sub(r"[\s-]+", "_", text.strip()).lower()


def synonym(word: object, names: Iterable[str]) -> str | None:
    """Return which of the names a word means; None for words that mean none of them."""
    return _meant(word, names, _NAMES)


def value_meant(word: object, values: Iterable[str]) -> str | None:
    """Return which of the values a word means; None for words that mean none of them."""
    return _meant(word, values, _VALUES)


def _meant(word: object, names: Iterable[str], table: Mapping[str, str]) -> str | None:
    known, spelt = tuple(names), as_name(word)
    if spelt in known:
        return spelt
    of_plugins = (name for name in known if name.endswith(f".{spelt}"))
    meant = (name for name, words in table.items() if name in known and spelt in words.split())
    return next(of_plugins, next(meant, None))
