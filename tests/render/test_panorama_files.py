"""Stills and EXR files of whole spheres say so, to viewers and to other renderers."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.render.post.exr_names import ExrAttributes
from flowsculpt.render.post.image import read_exr, write_exr, write_jpeg
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.render_camera import KINDS, Camera, Projection, WideCamera

PLACE = (1.0, 2.0, 8.0), (0.0, 1.0, 0.0)
LIGHT = RenderedFrame({"beauty": np.random.default_rng(5).random((8, 16, 3)).astype(np.float32)})


def camera(kind: str) -> Camera:
    return Camera(*PLACE) if kind == "perspective" else WideCamera(*PLACE, wide=Projection(kind))


def attributes_of(path: Path) -> dict[str, tuple[str, bytes]]:
    """Types and values of all attributes of an EXR, read from its bytes (OpenEXR file layout)."""
    content, at, found = path.read_bytes(), 8, {}
    while content[at]:
        name, kind, rest = content[at:].split(b"\0", 2)
        size = int.from_bytes(rest[:4], "little")
        found[name.decode()] = kind.decode(), rest[4 : 4 + size]
        at += len(name) + len(kind) + 6 + size
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_only_whole_spheres_are_environment_maps(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, LIGHT, {"frame": 7}, attributes=ExrAttributes((16, 8), camera=camera(kind)))
    found = attributes_of(path)
    assert found.get("envmap") == (
        ("envmap", b"\0") if kind == "spherical" else None
    )  # 0: latitude, longitude
    assert "worldToCamera" in found
    assert ("worldToNDC" in found) == (kind == "perspective"), "a matrix can tell only of a perspective"
    frame, header = read_exr(path)
    assert header == {"frame": 7}
    assert np.allclose(frame["beauty"], LIGHT["beauty"], atol=1e-3)


def test_other_programs_read_a_whole_sphere_as_latitude_and_longitude(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, LIGHT, {}, attributes=ExrAttributes((16, 8), camera=camera("spherical")))
    assert oiio.ImageInput.open(str(path)).spec()["textureformat"] == "LatLong Environment"


def test_a_crop_of_a_sphere_is_no_environment_map(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, LIGHT, {}, attributes=ExrAttributes((32, 16), (4, 2), camera("spherical")))
    assert "envmap" not in attributes_of(path)


def test_viewers_open_a_spherical_still_as_a_panorama(tmp_path: Path) -> None:
    picture = np.zeros((8, 16, 3), np.uint8)
    write_jpeg(tmp_path / "a.jpg", picture, {"frame": 7}, Projection("spherical"))
    packet = iio.immeta(tmp_path / "a.jpg", plugin="pillow")["xmp"]
    (found,) = ElementTree.fromstring(packet.strip(b"\0")).iter(
        "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}Description"
    )
    told = {name.rpartition("}")[2]: value for name, value in found.attrib.items() if "panorama" in name}
    assert told == {
        "ProjectionType": "equirectangular",
        "UsePanoramaViewer": "True",
        "FullPanoWidthPixels": "16",
        "FullPanoHeightPixels": "8",
        "CroppedAreaImageWidthPixels": "16",
        "CroppedAreaImageHeightPixels": "8",
        "CroppedAreaLeftPixels": "0",
        "CroppedAreaTopPixels": "0",
    }
    flat, with_others = tmp_path / "b.jpg", tmp_path / "c.jpg"
    write_jpeg(flat, picture, {"frame": 7})
    write_jpeg(with_others, picture, {"frame": 7}, Projection("vr180"))
    assert flat.read_bytes() == with_others.read_bytes()
    assert b"GPano" not in flat.read_bytes()
