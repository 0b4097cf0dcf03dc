"""Every row of the tables of formats in docs/interchange.md has tests that show it, cell by cell."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "interchange.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("\n## In\n")[2].partition("\n## ")[0]

MOVING = {
    "glTF": {
        "needs": ["gltf_motion:a_node_goes_between_keys"],
        "what moves": ["gltf_motion:morph_targets_add_up"],
        "faces": ["gltf_motion:morph_targets_add_up"],
        "between samples": ["gltf_motion:a_node_goes_between_keys"],
        "times": ["gltf_motion:a_file_is_opened_once_read_at_any_time"],
        "axes": ["gltf_motion:a_node_goes_between_keys"],
        "several animations": ["gltf_motion:animations_of_different_nodes"],
        "refused by name": ["gltf_motion:a_damaged_animation"],
        "largest file": ["moving:a_larger_file"],
    },
    "FBX": {
        "what moves": ["fbx_motion:a_skin_carries"],
        "between samples": ["fbx_motion:a_skin_carries"],
        "times": ["fbx_motion:a_skin_carries"],
        "frames per second": ["fbx_motion:a_skin_carries"],
        "several animations": ["fbx_motion:one_of_several_animations"],
        "largest file": ["moving:a_larger_file"],
    },
    "USD": {
        "needs": ["moving:time_samples"],
        "what moves": ["moving:a_skeleton_carries", "moving:numbered_value_clips"],
        "between samples": ["moving:layers_of_other_rates"],
        "times": ["moving:layers_of_other_rates"],
        "frames per second": ["moving:time_samples"],
        "velocities": ["moving:time_samples", "moving:normals_of_corners_and_velocities"],
        "normals": ["moving:normals_of_corners_and_velocities"],
        "axes": ["moving:time_samples"],
        "refused by name": ["moving:numbered_value_clips"],
        "largest file": ["moving:a_larger_file"],
    },
    "Alembic": {
        "needs": ["moving:meshes_of_an_archive"],
        "what moves": ["moving:meshes_of_an_archive"],
        "faces": ["moving:an_archive_has_faces_that_change"],
        "between samples": ["moving:meshes_of_an_archive"],
        "times": ["moving:meshes_of_an_archive"],
        "frames per second": ["moving:meshes_of_an_archive"],
        "velocities": ["moving:an_archive_has_faces_that_change", "moving:normals_and_velocities"],
        "normals": ["moving:normals_and_velocities_by_other_names"],
        "axes": ["moving:meshes_of_an_archive"],
        "refused by name": ["moving:a_damaged_archive"],
        "largest file": ["moving:a_larger_file"],
    },
    "PC2, MDD": {
        "what moves": ["moving:points_of_pc2_and_mdd"],
        "faces": ["moving:points_of_pc2_and_mdd"],
        "between samples": ["moving:points_of_pc2_and_mdd"],
        "times": ["moving:points_of_pc2_and_mdd"],
        "axes": ["moving:points_of_pc2_and_mdd"],
        "refused by name": ["moving:caches_of_points_that_do_not_fit"],
        "largest file": ["moving:a_larger_file"],
    },
    "PVD": {
        "what moves": ["vtk_surfaces:a_pvd_shows_its_files_at_their_times"],
        "faces": ["vtk_surfaces:faces_of_a_pvd_may_change"],
        "between samples": ["vtk_surfaces:faces_of_a_pvd_may_change"],
        "times": ["vtk_surfaces:times_of_a_pvd_are_seconds"],
        "velocities": ["vtk_surfaces:faces_of_a_pvd_may_change"],
        "normals": ["vtk_surfaces:faces_of_a_pvd_may_change"],
        "axes": ["vtk_surfaces:a_pvd_shows_its_files_at_their_times"],
        "refused by name": ["vtk_surfaces:what_cannot_be_read", "vtk_surfaces:a_pvd_of_one_time"],
        "largest file": ["vtk_surfaces:a_larger_file"],
    },
}
"""Tests of formats of surfaces that move, by row, as in SHOWN."""

SHOWN = {
    "OBJ": {
        "encodings": ["obj:encodings_and_line_ends_of_other_systems"],
        "line ends": ["obj:encodings_and_line_ends_of_other_systems"],
        "faces": ["obj:corners_of_every_form"],
        "vertices": ["obj:forms_that_other_programs_write"],
        "creases": ["polygon:edges_between_groups_are_creases", "polygon:crease_tags_of_a_file"],
        "left out, with a note": ["obj:what_else_a_file_shows"],
        "refused by name": ["obj:what_cannot_be_read"],
    },
    "PLY": {
        "encodings": ["ply:text_of_other_encodings", "ply:lists_of_every_type"],
        "line ends": ["ply:headers_of_every_line_end"],
        "faces": ["ply:strips_are_triangles", "ply:strips_beside_faces", "ply:a_face_of_two_hundred_corners"],
        "vertices": ["ply:forms_of_headers_and_text"],
        "header": ["ply:forms_of_headers_and_text"],
        "normals, in sequences": ["sequence_subjects:normals_of_files_shade_faces_that_change"],
        "velocities, in sequences": ["ply:velocities_are_read_by_the_names"],
        "refused by name": ["ply:what_cannot_be_read"],
    },
    "OFF": {
        "encodings": ["off:encodings_and_line_ends", "off:binary_files"],
        "line ends": ["off:encodings_and_line_ends"],
        "faces": ["off:forms_of_text"],
        "vertices": ["off:forms_of_text"],
        "header": ["off:forms_of_text"],
        "refused by name": ["off:what_cannot_be_read"],
    },
    "STL": {
        "encodings": ["stl:encodings_and_line_ends", "stl:binary_files"],
        "line ends": ["stl:encodings_and_line_ends", "stl:forms_of_text"],
        "faces": ["stl:forms_of_text"],
        "refused by name": ["stl:what_cannot_be_read"],
    },
    "FBX": {
        "needs": ["fbx:without_ufbx"],
        "files": ["fbx:quads_stay_quads"],
        "faces": ["fbx:quads_stay_quads", "fbx:hidden_meshes_are_left_out_with_a_note_and_holes"],
        "placed by": ["fbx:nodes_pivots_and_geometric", "fbx:a_mirrored_instance"],
        "axes": ["fbx:axes_other_than_y_and_z"],
        "unit": ["fbx:quads_stay_quads"],
        "creases": ["fbx:materials_weights_and_hard_edges", "fbx:edges_that_part"],
        "left out, with a note": ["fbx:hidden_meshes"],
        "left out": ["fbx:of_levels_of_detail"],
        "not applied": ["fbx:a_skinned_mesh"],
        "refused by name": ["fbx:a_file_that_contradicts_itself", "fbx:a_file_that_is_not_fbx"],
    },
    "DAE (COLLADA 1.4, 1.5)": {
        "files": ["collada:polygons_unit_and_axis"],
        "faces": ["collada:every_kind_of_face"],
        "placed by": ["collada:nodes_instances_and_mirrors"],
        "axes": ["collada:polygons_unit_and_axis"],
        "unit": ["collada:polygons_unit_and_axis"],
        "creases": ["collada:edges_between_materials"],
        "left out, with a note": ["collada:every_kind_of_face"],
        "not applied": ["collada:a_skinned_mesh"],
        "refused by name": ["collada:what_contradicts_itself"],
    },
    "3MF": {
        "files": ["threemf:items_and_components"],
        "faces": ["threemf:triangles_unit_and_axis"],
        "placed by": ["threemf:items_and_components"],
        "axes": ["threemf:triangles_unit_and_axis"],
        "unit": ["threemf:triangles_unit_and_axis"],
        "creases": ["threemf:edges_between_materials"],
        "left out, with a note": ["threemf:edges_between_materials_are_creases_and_supports"],
        "left out": ["threemf:vertices_of_slices"],
        "refused by name": ["threemf:what_is_not_read", "threemf:a_file_that_is_no_package"],
    },
    "VTP, PVTP": {
        "encodings": ["vtk_surfaces:files_of_vtk_are_read_in_every_encoding"],
        "faces": ["vtk_surfaces:strips_are_triangles", "vtk_surfaces:a_pvd_shows_its_files"],
        "pieces": ["vtk_surfaces:pieces_of_polygons"],
        "velocities, in sequences": ["vtk_surfaces:velocities_of_cells_become_means"],
        "normals, in sequences": ["vtk_surfaces:strips_are_triangles_and_normals"],
        "left out, with a note": ["vtk_surfaces:what_cannot_be_read"],
        "refused by name": ["vtk_surfaces:what_cannot_be_read"],
    },
    "VTU, PVTU": {
        "encodings": ["vtk_surfaces:files_of_vtk_are_read_in_every_encoding"],
        "faces": [
            "vtk_surfaces:every_kind_of_cell",
            "vtk_surfaces:flat_cells_on_solid_ones",
            "vtk_surfaces:polyhedra_are_read_as_older",
        ],
        "pieces": ["vtk_surfaces:no_skin_lies_between", "vtk_surfaces:cells_that_another_piece_has"],
        "velocities, in sequences": ["vtk_surfaces:files_of_vtk_are_read_in_every_encoding"],
        "normals, in sequences": ["vtk_surfaces:normals_of_a_grid"],
        "left out, with a note": ["vtk_surfaces:every_kind_of_cell"],
        "refused by name": ["vtk_surfaces:what_cannot_be_read"],
    },
    "USD": {
        "which meshes": ["usd:only_active_visible_meshes"],
        "where they stand": ["usd:a_mesh_stands_where_usd_computes_it"],
        "instances": ["usd:points_of_an_instancer"],
        "other prims": ["usd:only_active_visible_meshes"],
        "axis and unit": ["usd:a_shot_heeds_the_axis"],
        "when": ["usd:a_moving_stage_is_read"],
        "faces": ["usd:a_mesh_stands_where_usd_computes_it", "usd:holes_are_left_out"],
        "creases": ["usd:holes_are_left_out_and_sharp_edges"],
        "subdivision": ["usd:every_form_of_stage"],
        "layers": ["usd:a_shot_heeds_the_axis_and_follows_every_layer", "usd:layers_that_cannot_be_read"],
    },
    "glTF": {
        "scene": ["gltf:the_default_scene", "gltf:nodes_that_are_hidden", "gltf:nodes_below_themselves"],
        "primitives": ["gltf:lists_strips_and_fans", "gltf:strips_begin_again", "gltf:points_and_lines"],
        "accessors": [
            "gltf:normalized_positions",
            "gltf:interleaved_positions",
            "gltf:sparse_accessors",
            "gltf:a_damaged_accessor",
            "gltf:an_index_beyond_the_vertices",
        ],
        "copies": ["gltf:instances_stand_where_their_arrays_say", "gltf:meshes_that_nodes_multiply"],
        "compression": [
            "gltf:draco_data_is_read",
            "gltf:views_that_meshoptimizer",
            "gltf:other_modes_and_filters",
        ],
        "skins": ["gltf:a_skinned_mesh_stands", "gltf:morph_targets_are_not_applied"],
        "buffers": [
            "gltf:buffers_are_found_at_addresses",
            "gltf:addresses_that_are_not_relative",
            "gltf:a_missing_buffer",
            "gltf:what_the_surface_does_not_rest_on",
        ],
        "other extensions": ["gltf:extensions_that_are_required_and_unknown"],
        "glTF 1.0": ["gltf:version_1_is_read", "gltf:what_is_not_read_of_version_1"],
    },
    "OBJ with MTL": {
        "texture coordinates": ["model_paint:corners_take_the_texture_coordinates"],
        "vertex colours": ["model_paint:vertex_colours_of_an_obj_are_srgb"],
        "colour": ["model_paint:materials_of_an_obj_are_read"],
        "roughness, metalness": ["model_paint:roughness_and_metalness_of_an_obj"],
        "normals": ["model_paint:a_normal_map_of_an_obj"],
        "beyond a picture": ["model_materials:what_is_shown_beyond_a_picture"],
        "opacity": ["opacity:the_opacity_of_an_obj_is_a_number", "opacity:a_picture_of_an_obj_is_its_alpha"],
        "files": ["model_paint:a_path_of_another_machine", "model_paint:pictures_lie_beside_the_materials"],
        "not shown": [
            "model_paint:roughness_and_metalness_of_an_obj",
            "model_materials:what_is_not_shown_of_a_material_of_an_obj",
        ],
        "refused": ["model_paint:a_moved_texture_of_an_obj"],
    },
    "glTF 2.0": {
        "texture coordinates": [
            "model_paint:a_transformed_texture",
            "model_paint:what_is_not_read_of_a_gltf",
        ],
        "vertex colours": [
            "model_paint:vertex_colours_of_a_gltf_file",
            "model_paint:what_is_not_read_of_a_gltf",
        ],
        "colour": ["model_paint:a_picture_within_a_gltf_file"],
        "roughness, metalness": ["model_paint:a_picture_within_a_gltf_file"],
        "normals": ["model_paint:a_normal_map_of_a_gltf_file"],
        "beyond a picture": ["model_materials:what_is_shown_beyond_a_picture"],
        "opacity": ["opacity:gltf_masks_and_blends"],
        "files": ["model_paint:a_picture_within_a_gltf_file"],
        "not shown": [
            "model_paint:maps_of_light_and_opacity_of_a_gltf_file",
            "model_materials:what_is_not_shown_of_a_material_of_a_gltf",
        ],
        "refused": ["model_paint:paint_of_gltf_1_is_refused"],
    },
    "FBX with materials": {
        "texture coordinates": [
            "fbx_paint:corners_of_an_fbx_take",
            "fbx_paint:the_texture_coordinates_that_a_picture_names",
        ],
        "vertex colours": ["fbx_paint:vertex_colours_of_an_fbx_are_srgb"],
        "colour": ["fbx_paint:corners_of_an_fbx_take", "fbx_paint:metalness_and_roughness_of_3ds_max"],
        "roughness, metalness": [
            "fbx_paint:roughness_and_metalness_of_blender",
            "fbx_paint:metalness_and_roughness_of_3ds_max",
        ],
        "normals": ["fbx_paint:normal_maps_of_an_fbx_are_read"],
        "beyond a picture": ["model_materials:what_is_shown_beyond_a_picture"],
        "opacity": ["opacity:the_opacity_of_an_fbx", "opacity:a_picture_of_an_fbx_needs_alpha"],
        "files": ["fbx_paint:a_picture_within_an_fbx", "fbx_paint:a_missing_picture_of_an_fbx"],
        "not shown": ["fbx_paint:maps_of_bumps_and_light", "model_materials:a_glow_of_an_fbx"],
        "refused": ["fbx_paint:what_is_not_read_of_an_fbx"],
    },
    "USD with preview surfaces": {
        "texture coordinates": ["usd_paint:corners_of_a_stage_take", "usd_paint:maps_of_numbers_and_normals"],
        "vertex colours": [
            "usd_paint:display_colours_are_vertex_colours",
            "usd_paint:a_material_that_reads_a_primvar",
        ],
        "colour": ["usd_paint:corners_of_a_stage_take"],
        "roughness, metalness": ["usd_paint:maps_of_numbers_and_normals"],
        "normals": ["usd_paint:maps_of_numbers_and_normals"],
        "beyond a picture": ["model_materials:what_is_shown_beyond_a_picture"],
        "opacity": ["opacity:usd_has_a_channel_and_a_threshold"],
        "files": ["usd_paint:a_picture_within_a_package", "usd_paint:a_missing_picture_and_missing"],
        "not shown": [
            "usd_paint:maps_of_light_of_a_stage_are_not_opened",
            "model_materials:what_is_not_shown_of_a_material_of_a_stage",
        ],
        "refused": [
            "usd_paint:materials_that_would_be_shown_wrong",
            "usd_paint:a_stage_with_materials_of_other_renderers",
        ],
    },
}
"""By format and row, the tests that show a cell: `module:beginning of the name`."""


def cells() -> list[tuple[str, str]]:
    """Return format and row of every cell of the tables that says something."""
    found = []
    for block in re.findall(r"(?:^\|.*\n)+", SECTION, re.MULTILINE):
        head, _, *rows = (
            [cell.strip() for cell in line.strip("|\n").split(" |")] for line in block.splitlines()
        )
        names = head[1:] if any(head) else ["USD" if "which meshes" in block else "glTF"]
        for name, *row in rows:
            found += [
                (format, name) for format, cell in zip(names, row, strict=True) if cell not in ("", "–")
            ]
    return found


def test_every_cell_of_the_tables_is_shown_by_tests_and_no_other_is_claimed() -> None:
    claimed = {(format, row) for tests in (SHOWN, MOVING) for format, rows in tests.items() for row in rows}
    assert claimed == set(cells())


@pytest.mark.parametrize("format", {**SHOWN, **MOVING})
def test_the_tests_that_show_a_format_are_there(format: str) -> None:
    for row, shown in (*SHOWN.get(format, {}).items(), *MOVING.get(format, {}).items()):
        for name in shown:
            module, _, beginning = name.partition(":")
            files = (f"test_{module}_files.py", f"test_{module}.py")
            file = next(found for file in files for found in (ROOT / "tests").glob(f"**/{file}"))
            text = file.read_text(encoding="utf-8")
            assert f"def test_{beginning}" in text, f"{row}: {name}"
