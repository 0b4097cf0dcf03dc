"""Sets: places as presets of stage, lights and camera, in the words of shot files.

A set is under what a shot says itself. Lengths are in half-sizes of the subject, angles in degrees. Each is
made for pictures of 16:9, 1:1 and 9:16: what matters is close around the subject.
"""

from __future__ import annotations

from typing import Any

from flowsculpt.render.scene.room_shapes import WINDOWS


def _box(
    name: str, position: list[float], width: float, height: float, radiance: list[float], **more: Any
) -> dict[str, Any]:
    """Return a softbox in the words of shot files."""
    box = {"name": name, "position": position, "width": width, "height": height, "radiance": radiance}
    return {**box, **more}


SETS: dict[str, dict[str, Any]] = {
    # Two walls: the shadow climbs the one, the other stays light.
    "corner": {
        "stage": {"kind": "corner", "colour": [0.26, 0.23, 0.21], "wall_colour": [0.47, 0.43, 0.38]},
        "lights": {
            "softboxes": [
                _box("key", [5.6, 4.0, 2.6], 0.7, 0.7, [900, 765, 600]),
                _box("fill", [-1.0, 6.5, 5.0], 3, 2, [2.4, 3, 4]),
            ],
            "sky": {"zenith": [0.1, 0.12, 0.16]},
        },
        "camera": {"azimuth": -12, "elevation": 9, "field_of_view": 30, "dolly": 1.15},
    },
    # Low coloured walls in the sun, and the sky over them.
    "court": {
        "stage": {
            "kind": "corner",
            "height": 2.5,
            "colour": [0.4, 0.33, 0.25],
            "wall_colour": [0.5, 0.13, 0.09],
        },
        "lights": {"sun": {"elevation": 40, "azimuth": 62, "turbidity": 2.2}},
        "camera": {"azimuth": -12, "elevation": 5, "field_of_view": 38, "dolly": 1.15},
    },
    # The panes of a window, thrown across the wall by a low sun.
    "window": {
        "stage": {"kind": "window", "colour": [0.17, 0.13, 0.1], "wall_colour": [0.52, 0.49, 0.44]},
        "lights": {
            "softboxes": [
                {
                    "name": "key",
                    "position": list(WINDOWS["window"].light),
                    "target": list(WINDOWS["window"].target),
                    "width": 0.16,
                    "height": 0.16,
                    "radiance": [86000, 66000, 44000],
                }
            ],
            "sky": {"zenith": [0.10, 0.125, 0.17]},
        },
        "camera": {"azimuth": 12, "elevation": 6, "field_of_view": 30, "dolly": 1.15},
    },
    # Plinths of several heights, as in a museum's store.
    "stair": {
        "stage": {
            "kind": "stair",
            "height": 2.4,
            "colour": [0.16, 0.17, 0.19],
            "wall_colour": [0.05, 0.055, 0.065],
            "plinth_colour": [0.6, 0.585, 0.555],
        },
        "lights": {
            "softboxes": [
                _box("key", [-5.2, 5.6, 2.2], 1.2, 1.2, [430, 390, 335]),
                _box("edge", [5.0, 3.2, -3.4], 0.8, 4, [40, 62, 100]),
            ],
            "sky": {"zenith": [0.07, 0.08, 0.1]},
        },
        "camera": {"azimuth": -18, "elevation": 13, "field_of_view": 30, "dolly": 1.42},
    },
    # A board of a shelf, lit from above its front: for one piece, or for several in a row.
    "shelf": {
        "stage": {
            "kind": "shelf",
            "width": 5.2,
            "height": 2.75,
            "wall_colour": [0.2, 0.205, 0.17],
            "colour": [0.2, 0.205, 0.17],
            "plinth_colour": [0.42, 0.3, 0.19],
        },
        "lights": {
            "softboxes": [
                _box("key", [-3.6, 4.8, 6.0], 1.0, 1.0, [560, 500, 420]),
                _box("side", [5.5, 1.6, 4.2], 1.0, 4, [16, 18, 22]),
            ],
            "sky": {"zenith": [0.14, 0.14, 0.14]},
        },
        "camera": {"azimuth": 8, "elevation": 4, "field_of_view": 28, "dolly": 1.3},
    },
    # Black water around a low island, and a strip of light behind it that the water doubles.
    "pool": {
        "stage": {
            "kind": "plinth",
            "round": True,
            "width": 1.7,
            "height": 0.2,
            "colour": [0.004, 0.008, 0.01],
            "finish": "water",
            "wall_colour": [0.1, 0.13, 0.13],
            "plinth_colour": [0.2, 0.2, 0.19],
        },
        "lights": {
            "softboxes": [
                _box("key", [-5.0, 3.6, 0.6], 1.2, 1.6, [430, 390, 330]),
                _box("edge", [4.4, 2.6, -3.4], 0.7, 4, [90, 140, 165]),
                _box("back", [0, 6.5, -4], 3, 1.5, [260, 310, 310], target=[0, 2, -13]),
            ],
            "sky": {"zenith": [0.06, 0.08, 0.09]},
        },
        "camera": {"azimuth": -20, "elevation": 8, "field_of_view": 32, "dolly": 1.35},
    },
    # A field before sunrise has gone: long shadows towards the lens, a haze at the horizon.
    "dawn": {
        "stage": {"kind": "ground", "colour": [0.21, 0.2, 0.1], "horizon_fade": 1.6},
        "lights": {
            "sun": {"elevation": 7, "azimuth": 138, "turbidity": 4.5, "width": 1.2},
            "exposure": 0.3,
        },
        "camera": {"azimuth": -20, "elevation": 4, "field_of_view": 46, "dolly": 1.2},
    },
    # A round table, looked down on.
    "table": {
        "stage": {
            "kind": "table",
            "round": True,
            "width": 5.4,
            "height": 2.8,
            "colour": [0.05, 0.02, 0.016],
            "plinth_colour": [0.36, 0.2, 0.11],
            "plinth_roughness": 0.28,
        },
        "lights": {
            "softboxes": [
                _box("key", [-4.6, 4.4, -3.0], 1.6, 1.2, [300, 275, 240]),
                _box("side", [5.0, 3.4, 1.5], 0.6, 3, [36, 46, 62]),
            ],
            "sky": {"zenith": [0.1, 0.1, 0.11]},
        },
        "camera": {"azimuth": -24, "elevation": 56, "field_of_view": 30, "dolly": 1.35},
    },
    # One light from above in the dark.
    "spot": {
        "stage": {
            "kind": "plinth",
            "round": True,
            "width": 1.9,
            "height": 2.2,
            "colour": [0.03, 0.032, 0.036],
            "plinth_colour": [0.3, 0.29, 0.27],
        },
        "lights": {
            "softboxes": [
                _box("key", [-0.8, 7.4, 0.9], 0.9, 0.9, [900, 810, 680]),
                _box("edge", [4.6, 2.0, -3.6], 0.5, 3.6, [60, 78, 110]),
            ],
            "sky": {"zenith": [0.05, 0.055, 0.065]},
        },
        "camera": {"azimuth": -15, "elevation": 7, "field_of_view": 28, "dolly": 1.15},
    },
    # A beam of light from behind, in air that shows it, and the shadow of the sculpture within.
    "fog": {
        "stage": {"kind": "fog", "colour": [0.05, 0.054, 0.06], "wall_colour": [0.012, 0.013, 0.016]},
        "lights": {
            "softboxes": [
                {
                    "name": "key",
                    "position": list(WINDOWS["fog"].light),
                    "target": list(WINDOWS["fog"].target),
                    "width": 0.09,
                    "height": 0.09,
                    "radiance": [860000, 780000, 660000],
                },
                _box("edge", [4.6, 2.6, -2.6], 0.6, 3.2, [10, 15, 25]),
            ],
            "sky": {"zenith": [0.05, 0.06, 0.075]},
            "exposure": 0.7,
        },
        "camera": {"azimuth": -16, "elevation": 5, "field_of_view": 30, "dolly": 1.25},
    },
}
"""Sets by their names."""
