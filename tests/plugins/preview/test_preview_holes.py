"""Previews leave out the holes of painted models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.plugins.preview.holes import PIECES, without_holes
from flowsculpt.render.scene.materials import Diffuse, Opacity, Painted
from flowsculpt.render.scene.surface import Surface
from tests.render.test_cut_outs import half, painted
from tests.render.test_painted import square
from tests.render.test_textures import GREEN, RED


def drawn(look: Painted, materials: tuple[int, int] = (0, 0)) -> Surface:
    surface = square(materials)
    assert surface.paint is not None
    return without_holes(replace(surface, attributes={"speed": surface.vertices[:, :1]}), look, surface.paint)


def area(surface: Surface) -> float:
    first, second, third = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    return float(0.5 * np.linalg.norm(np.cross(second - first, third - first), axis=1).sum())


def test_pieces_cover_a_face_and_turn_as_it_does() -> None:
    sides = PIECES[:, 1:, 1:] - PIECES[:, :1, 1:]
    assert np.linalg.det(sides) == pytest.approx(np.full(36, 1 / 36))


def test_what_is_cut_out_is_not_drawn_and_pieces_keep_their_place_and_paint(tmp_path: Path) -> None:
    holes = Opacity(texture=half(tmp_path / "a.exr"), cutoff=0.5)
    shown = drawn(painted(Diffuse(GREEN, opacity=holes)))
    assert shown.vertices[shown.faces].mean(axis=1)[:, 0].min() > 0.0
    assert area(shown) == pytest.approx(2.0, abs=0.35)  # of 4, with ragged borders
    assert shown.paint is not None and shown.rest is not None
    corners = shown.vertices[shown.faces]
    assert shown.paint.coordinates == pytest.approx(0.5 * (corners[..., :2] + (1, 0)), abs=1e-6)
    assert shown.rest == pytest.approx(shown.vertices, abs=1e-6)
    assert shown.attributes["speed"][:, 0] == pytest.approx(shown.vertices[:, 0], abs=1e-6)


def test_a_fraction_of_the_pieces_is_drawn_and_other_materials_stay_whole() -> None:
    thin = painted(Diffuse(GREEN, opacity=Opacity(0.25)), Diffuse(RED))
    assert area(drawn(thin)) == pytest.approx(1.0)
    both = drawn(thin, (0, 1))
    assert area(both) == pytest.approx(2.5)
    assert both.paint is not None and (both.paint.materials == 1).sum() == 1
