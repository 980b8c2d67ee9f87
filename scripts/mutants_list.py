"""One line of each module that computes, and of each shader, what breaks it, and the test that must notice it.

See mutants.py. A text stands once in its file, what replaces it gives wrong pictures or numbers, and the test is the
cheapest that fails; it runs in `scripts/test`, however its file's other cases are chosen.
"""

from __future__ import annotations

from typing import NamedTuple


class Mutant(NamedTuple):
    """A text in a file, what replaces it, and the test that fails then."""

    file: str
    text: str
    replacement: str
    test: str

    def __str__(self) -> str:
        text, replacement = (" ".join(each.split()) for each in (self.text, self.replacement))
        return f"{self.file}: {text!r} -> {replacement!r}"


MUTANTS: tuple[Mutant, ...] = (
    Mutant(
        "splatgl/data/coarse.py",
        "(np.array(steps[::-1]) - 1)",
        "np.array(steps[::-1])",
        "tests/test_view.py::test_coarser_volumes_stay_where_they_are",
    ),
    Mutant("splatgl/data/color.py", "2.4", "2.2", "tests/test_transfer.py::test_color_spans_the_window"),
    Mutant(
        "splatgl/data/mask.py",
        "np.flatnonzero((place >= 0) &",
        "np.flatnonzero((place > 0) &",
        "tests/test_mask.py::test_a_block_is_as_deep_as_what_its_mask_keeps[sheared-wide-tiles]",
    ),
    Mutant(
        "splatgl/data/mesh.py",
        "line[ringed(line)]",
        "line[ringed(line)[::2]]",
        "tests/test_meshes.py::test_spheres_and_tubes_have_their_radius",
    ),
    Mutant(
        "splatgl/data/readers/dicom_grid.py",
        "axes[1], step / length])",
        "axes[1], np.cross(axes[0], axes[1])])",
        "tests/test_dicom.py::test_tilted_gantry_shears_the_grid",
    ),
    Mutant(
        "splatgl/data/readers/dicom_pixels.py",
        "header.offset + number *",
        "header.offset + (number - 1) *",
        "tests/test_dicom.py::test_other_files[zip]",
    ),
    Mutant(
        "splatgl/data/readers/nifti.py",
        "source * np.float64(slope) + intercept",
        "(source + intercept) * np.float64(slope)",
        "tests/test_readers.py::test_nifti_agrees_with_nibabel",
    ),
    Mutant(
        "splatgl/data/readers/terrain.py",
        "np.minimum.reduce(around))",
        "np.maximum.reduce(around))",
        "tests/test_readers_terrain.py::test_picture_row_0_is_the_northern_edge[png16]",
    ),
    Mutant(
        "splatgl/data/volume.py",
        "for z in (-0.5, d - 0.5)",
        "for z in (-0.5, d + 0.5)",
        "tests/test_camera.py::test_parallel_keeps_the_middle",
    ),
    Mutant(
        "splatgl/splat/bound/bound.py",
        "self.footprint + self.hidden",
        "0.0 * self.footprint + self.hidden",
        "tests/test_bound.py::test_the_bound_follows_what_makes_the_error",
    ),
    Mutant(
        "splatgl/splat/bound/ray_overlap.py",
        "DISCRETE = 1.35",
        "DISCRETE = 0.1",
        "tests/test_bound.py::test_no_ray_meets_more_than_is_said[block-one by one]",
    ),
    Mutant(
        "splatgl/splat/bricks/bricks.py",
        "> first - sheets.count)",
        "> first)",
        "tests/test_bricks.py::test_shells_hold_what_reaches_them[parallel]",
    ),
    Mutant(
        "splatgl/splat/classification/ground.py",
        "LOPSIDED = 2.0",
        "LOPSIDED = 200.0",
        "tests/test_ground.py::test_other_values_have_no_ground[a slope]",
    ),
    Mutant(
        "splatgl/splat/classification/medical.py",
        "first.value, second.below,",
        "first.value, second.value,",
        "tests/test_named_presets.py::test_values_of_another_scale_are_adapted_to[ct-muscle]",
    ),
    Mutant(
        "splatgl/splat/classification/post.py",
        "np.float64(low) <= np.float64(",
        "np.float64(low) >= np.float64(",
        "tests/test_ends.py::test_voxels_at_ends_are_lit_as_within_air[full]",
    ),
    Mutant(
        "splatgl/splat/classification/shading.py",
        "(2.0**light.sharpness) *",
        "(2.0 * light.sharpness) *",
        "tests/test_light.py::test_lit_pictures_are_the_reference[how0-quads]",
    ),
    Mutant(
        "splatgl/splat/classification/transfer.py",
        "-np.log1p(-np.minimum(np.asarray(opacity, dtype=np.float64), OPAQUE))",
        "np.minimum(np.asarray(opacity, dtype=np.float64), OPAQUE)",
        "tests/test_transfer.py::test_extinction_keeps_tiny_and_full_opacities",
    ),
    Mutant(
        "splatgl/splat/cues/coarse.py",
        "corner, part, 1 - part).prod(",
        "corner, 1 - part, part).prod(",
        "tests/test_depth_cues.py::test_voxels_of_other_grids_lie_where_they_are",
    ),
    Mutant(
        "splatgl/splat/cues/cues.py",
        "self.shadows * (1 - trilinear(",
        "self.shadows * (1 - 0.9 * trilinear(",
        "tests/test_twins_cues.py::test_cues[parallel]",
    ),
    Mutant(
        "splatgl/splat/cues/sweep.py",
        "step = 1 / abs(float(along[axis]))",
        "step = abs(float(along[axis]))",
        "tests/test_depth_cues.py::test_light_through_fog[direction2]",
    ),
    Mutant(
        "splatgl/splat/extraction/post.py",
        "np.clip(value[outer], *extremes(values.u, x[outer], y[outer], z[outer]))",
        "value[outer]",
        "tests/test_extract.py::test_voxels_beside_what_is_opaque_are_not",
    ),
    Mutant(
        "splatgl/splat/extraction/pre.py",
        "gradient /= steps",
        "gradient /= 2",
        "tests/test_extract.py::test_normals_are_world_gradients_on_the_original_grid",
    ),
    Mutant(
        "splatgl/splat/extraction/run_lengths.py",
        "- lattice.cell[first] + 1",
        "- lattice.cell[first] + 2",
        "tests/test_fill.py::test_runs_of_a_thread[shape0-0]",
    ),
    Mutant(
        "splatgl/splat/flow/arrows.py",
        "** (1 / 3)",
        "** (1 / 2)",
        "tests/test_flow.py::test_meshes_of_lines_and_arrows",
    ),
    Mutant(
        "splatgl/splat/flow/streamlines.py",
        "/ 6 * (a + 2 * b + 2 * c + d)",
        "* a",
        "tests/test_flow.py::test_rotations_close[turned]",
    ),
    Mutant(
        "splatgl/splat/integral/approximations.py",
        "(1 - 3 * t / (q2 * z))",
        "(1 - 2 * t / (q2 * z))",
        "tests/test_twins_footprints.py::test_quads_beyond_table_1[cubic_quad]",
    ),
    Mutant(
        "splatgl/splat/integral/attenuation.py",
        "column = depth * layers",
        "column = depth * np.sqrt(layers)",
        "tests/test_twins.py::test_matter_that_is_widened[turned]",
    ),
    Mutant(
        "splatgl/splat/integral/curved_ray.py",
        "t / (1 - t / self.depth)\n",
        "t / (1 + t / self.depth)\n",
        "tests/test_exact.py::test_two_thousand_voxels[gaussian]",
    ),
    Mutant(
        "splatgl/splat/integral/line_integral.py",
        "w_x * w_x + w_y * w_y) /",
        "w_x * w_x) /",
        "tests/test_affine.py::test_cubes_are_table_1[matrix1-gaussian]",
    ),
    Mutant(
        "splatgl/splat/integral/quads.py",
        "ellipse.width[0] * ellipse.width[1]",
        "ellipse.width[0] * ellipse.width[0]",
        "tests/test_twins_geometry.py::test_quads_of_table_1[1:2:5-far-grid]",
    ),
    Mutant(
        "splatgl/splat/integral/table1.py",
        "-1.0 if self.planar else -2.0)",
        "-2.0 if self.planar else -1.0)",
        "tests/test_footprint.py::test_rows_match_the_pinned_vectors[row2]",
    ),
    Mutant(
        "splatgl/splat/kernel/kernels.py",
        "1.0, size))) / (2 * whole))",
        "1.0, size))) / (3 * whole))",
        "tests/test_twins_footprints.py::test_half_lines[turned]",
    ),
    Mutant(
        "splatgl/splat/kernel/tabulated.py",
        "thirds * thirds * (knot",
        "thirds * (knot",
        "tests/test_affine.py::test_tabled_footprints[gaussian]",
    ),
    Mutant(
        "splatgl/splat/layers/layers.py",
        "clear = np.prod([1.0 - each[...,",
        "clear = np.min([1.0 - each[...,",
        "tests/test_scenes_of_layers.py::test_without_an_order_layers_hide_by_turns",
    ),
    Mutant(
        "splatgl/splat/motion/moments.py",
        "STEP = 1.5",
        "STEP = 15.0",
        "tests/test_streaks.py::test_as_many_moments_as_paths_are_long",
    ),
    Mutant(
        "splatgl/splat/sheets/sheets.py",
        "LEAST_MASS = 0.02",
        "LEAST_MASS = 0.2",
        "tests/test_ends.py::test_a_voxel_alone_ends_at_its_corners",
    ),
    Mutant(
        "splatgl/splat/view/ahead.py",
        "ON_PLANE = 1e-9",
        "ON_PLANE = -0.01",
        "tests/test_agreement.py::test_what_is_behind_a_parallel_view_is_decided_once[1:2:5]",
    ),
    Mutant(
        "splatgl/splat/view/block_culling.py",
        "half[2] > -self.view.reach",
        "half[2] > self.view.reach",
        "tests/test_twins_geometry.py::test_what_reaches_into_the_picture",
    ),
    Mutant(
        "splatgl/splat/view/camera.py",
        "pitch = self.extent / self.size[1]\n        return",
        "pitch = self.extent / self.size[0]\n        return",
        "tests/test_camera.py::test_z_k",
    ),
    Mutant(
        "splatgl/splat/view/clip.py",
        "\nFACE = 1.0",
        "\nFACE = 2.0",
        "tests/test_clip.py::test_faces_are_one_voxel_deep[tiles]",
    ),
    Mutant(
        "splatgl/splat/view/cuts.py",
        "@ (corners[0] + sides[a])",
        "@ (corners[0] + 0.9 * sides[a])",
        "tests/test_view_cuts.py::test_planes_cut_the_box_in_polygons",
    ),
    Mutant(
        "splatgl/splat/view/ellipse.py",
        "* np.arctan2(2 * mixed,",
        "* np.arctan2(mixed,",
        "tests/test_twins_geometry.py::test_ellipses_on_planes[1:2:5]",
    ),
    Mutant(
        "splatgl/splat/view/mask.py",
        "\nREACH = 5",
        "\nREACH = 2",
        "tests/test_mask.py::test_values_as_far_as_a_kernel_reaches_are_kept",
    ),
    Mutant(
        "splatgl/splat/view/rigid.py",
        "_swept(share * turn) @ (",
        "_swept(turn) @ (",
        "tests/test_motion.py::test_parts_of_a_rigid_motion",
    ),
    Mutant(
        "splatgl/splat/view/screen_bounds.py",
        "max(float(np.linalg.norm(steps[:2], axis=1).max()) / view.pitch, STRETCHED * view.kernel.radius)",
        "float(np.linalg.norm(steps[:2], axis=1).max()) / view.pitch / 2",
        "tests/test_reach.py::test_the_window_holds_all_that_the_reference_reaches[1:2:5-True]",
    ),
    Mutant(
        "splatgl/splat/view/trilinear.py",
        "corner, part, 1 - part).prod(",
        "corner, 1 - part, part).prod(",
        "tests/test_twins_cues.py::test_cues[parallel]",
    ),
    Mutant(
        "splatgl/gl/draw_order.py",
        "found[::-1] if order.nearest_first else found",
        "found",
        "tests/test_tiles.py::test_attenuation_is_the_same[1:2:5-parallel, far-fill]",
    ),
    Mutant(
        "splatgl/gl/levels.py",
        "SLACK = 1.05",
        "SLACK = 1.6",
        "tests/test_levels.py::test_thin_things_take_the_finest_level[0.3]",
    ),
    Mutant(
        "splatgl/gl/sheet_order.py",
        "dtype=np.uint32).reshape(number + 1, runs)",
        "dtype=np.uint32).reshape(number + 1, runs) - found.T",
        "tests/test_sheets.py::test_pictures_of_light_and_of_widened_splats_are_their_twins[tiles]",
    ),
    Mutant(
        "splatgl/gl/surfaces.py",
        "mesh.shades.reshape(-1, 3), mesh.opacity",
        "mesh.shades.reshape(-1, 3), 1.0",
        "tests/test_meshes.py::test_discs_in_fog[9.37-opacities3]",
    ),
    Mutant(
        "splatgl/gl/uniforms.py",
        "splats.unit / splats.grid.mean_spacing",
        "splats.unit",
        "tests/test_one_value.py::test_maxima_of_voxels_classified_before_are_their_opacities",
    ),
    Mutant(
        "splatgl/truth/blend.py",
        "= before + value * length",
        "= before + value",
        "tests/test_one_value.py::test_joins",
    ),
    Mutant(
        "splatgl/truth/boxes.py",
        "FACE / np.linalg.norm(direction, axis=0))",
        "FACE)",
        "tests/test_twins_boxes.py::test_boxes_of_voxels[parallel]",
    ),
    Mutant(
        "splatgl/truth/compare.py",
        "found.squares / (4 * count)",
        "found.squares / (3 * count)",
        "tests/test_compare.py::test_one_changed_channel[-0.5]",
    ),
    Mutant(
        "splatgl/truth/depth.py",
        "return Surfaces(distance",
        "return Surfaces(0.9 * distance",
        "tests/test_depth.py::test_surfaces_pass_what_they_do_not_hide",
    ),
    Mutant(
        "splatgl/truth/depth_field.py",
        "+ (far - near) * share[2]",
        "+ (far - near) * share[1]",
        "tests/test_depth.py::test_a_wall_at_an_angle[cubes-False]",
    ),
    Mutant(
        "splatgl/truth/field.py",
        "step, part, 1 - part).prod(",
        "step, 1 - part, part).prod(",
        "tests/test_field.py::test_fields_pass_through_what_they_interpolate",
    ),
    Mutant(
        "splatgl/truth/flicker.py",
        "CLOSE = 0.01",
        "CLOSE = 10.0",
        "tests/test_flicker.py::test_popping_is_where_planes_turn",
    ),
    Mutant(
        "splatgl/truth/layers.py",
        "(last - first) / np.where(inside, end - begin, 1.0),",
        "1.0,",
        "tests/test_scenes_of_layers.py::test_as_in_float64[changes1-0.0004-True]",
    ),
    Mutant(
        "splatgl/truth/metrics.py",
        "sample = count / (count - 1)",
        "sample = 1.0",
        "tests/test_compare_metrics.py::test_ssim_and_psnr_are_scikit_images[tunnel-composite]",
    ),
    Mutant(
        "splatgl/truth/pick.py",
        "for each in found))), MOST)",
        "for each in found) / 8)), MOST)",
        "tests/test_pick.py::test_half_of_the_light_is_absorbed_there[1:2:5-False]",
    ),
    Mutant(
        "splatgl/truth/pixel_means.py",
        "-1] - inner[:, 0] + before)",
        "-1] + inner[:, 0] - before)",
        "tests/test_pixel_means.py::test_means_of_cubics_are_exact[2]",
    ),
    Mutant(
        "splatgl/truth/quantization.py",
        "over |= off[..., channel]",
        "over &= off[..., channel]",
        "tests/test_compare_steps.py::test_two_steps_of_an_opaque_color_are_not[-2]",
    ),
    Mutant(
        "splatgl/truth/rays.py",
        "np.linalg.norm(along, axis=0)",
        "1",
        "tests/test_post.py::test_quads_composite_what_lies_behind_a_gap[2]",
    ),
    Mutant(
        "splatgl/truth/sheet_field.py",
        "rays.stretch * sheets.thickness",
        "rays.stretch",
        "tests/test_twins_sheets.py::test_light_over_sheets[1]",
    ),
    Mutant(
        "splatgl/truth/streak_row.py",
        "t = -(o * line).sum(axis=0)",
        "t = (o * line).sum(axis=0)",
        "tests/test_twins_motion.py::test_kernels_on_their_paths[fitted-cubes]",
    ),
    Mutant(
        "splatgl/truth/surfaces.py",
        "from_a, across), (ray, along),",
        "ray, along), (from_a, across),",
        "tests/test_meshes.py::test_rays_cross_balls_where_spheres_are",
    ),
    Mutant(
        "splatgl/distributed/parts.py",
        "near + (1 - near[..., 3:]) * far",
        "far + (1 - far[..., 3:]) * near",
        "tests/test_distributed.py::test_over_is_what_compositing_both_gives",
    ),
    Mutant(
        "splatgl/app/annotations/ticks.py",
        "STEPS = (1.0, 2.0, 5.0)",
        "STEPS = (1.0, 2.0, 4.0)",
        "tests/test_annotations.py::test_logarithmic_ticks[0.9-60-right0]",
    ),
    Mutant(
        "splatgl/app/viewer/pacing.py",
        "self.work[level] / self.work[nearest]",
        "self.work[nearest] / self.work[level]",
        "tests/test_view.py::test_a_slow_scene_settles_on_a_level_that_keeps_the_target",
    ),
    Mutant(
        "splatgl/app/viewer/pose.py",
        "camera.eye - target) * factor)",
        "camera.eye - target) / factor)",
        "tests/test_view.py::test_a_zoom_keeps_what_is_under_the_cursor[False]",
    ),
    Mutant(
        "shaders/approximations.glsl",
        "float trapezoid = 3.0 * a_q",
        "float trapezoid = 2.0 * a_q",
        "tests/test_twins_footprints.py::test_line_integrals[tiles-wide-cubes]",
    ),
    Mutant(
        "shaders/attenuation.glsl",
        "max(wider.x, max(wider.y,",
        "min(wider.x, min(wider.y,",
        "tests/test_twins.py::test_matter_that_is_widened[turned]",
    ),
    Mutant(
        "shaders/boxes.glsl",
        "high.y), min(high.z, it.far)));",
        "high.y), high.z));",
        "tests/test_boxes.py::test_meshes_end_rays_within_boxes",
    ),
    Mutant(
        "shaders/cues.glsl",
        "seen.a + 2.0 * dot(n, seen.rgb)",
        "seen.a + dot(n, seen.rgb)",
        "tests/test_twins_cues.py::test_cues[parallel]",
    ),
    Mutant(
        "shaders/ellipse.glsl",
        "float middle = b - a * x / z,",
        "float middle = b,",
        "tests/test_twins_geometry.py::test_planes_that_touch_a_kernel[turned]",
    ),
    Mutant(
        "shaders/footprint_eval.glsl",
        "return radial(d2) * share",
        "return 0.99 * radial(d2) * share",
        "tests/test_near.py::test_tiles_draw_what_quads_draw[look2-cubes]",
    ),
    Mutant(
        "shaders/layers_over.comp",
        "far[n] > end ? (end - begin) / (far[n] - begin) : ",
        "",
        "tests/test_scenes_of_layers.py::test_as_in_float64[changes1-0.0004-True]",
    ),
    Mutant(
        "shaders/light.glsl",
        "style.sharpness); k++) power *= power;",
        "style.sharpness); k++) power *= cosine;",
        "tests/test_light.py::test_light_on_slopes[tilt2-glossy]",
    ),
    Mutant(
        "shaders/mesh_maps.glsl",
        "row = int(value.y + 0.5);",
        "row = 0;",
        "tests/test_mesh_values.py::test_windows_missing_values_and_several_maps",
    ),
    Mutant(
        "shaders/motion.glsl",
        "* (v.z / 6.0), (after -",
        "* (v.z / 2.0), (after -",
        "tests/test_twins_motion.py::test_paths[fitted]",
    ),
    Mutant(
        "shaders/motion_opacity.glsl",
        "1.0 + DENSE * most / (1.0 + DENSEST * most);",
        "1.0;",
        "tests/test_twins_motion.py::test_what_moves_hides",
    ),
    Mutant(
        "shaders/optics.glsl",
        "int k = 0; k < DOUBLINGS;",
        "int k = 1; k < DOUBLINGS;",
        "tests/test_twins.py::test_blending",
    ),
    Mutant(
        "shaders/projection.glsl",
        "reach)) && all(lessThanEqual(v.xy - edges.zw * z, reach));",
        "vec2(0.0))) && all(lessThanEqual(v.xy - edges.zw * z, vec2(0.0)));",
        "tests/test_twins_geometry.py::test_what_reaches_into_the_picture",
    ),
    Mutant(
        "shaders/quads.glsl",
        "float area = g.x * g.y;",
        "float area = g.x * g.x;",
        "tests/test_twins_geometry.py::test_quads_of_table_1[1:2:5-fitted-ray]",
    ),
    Mutant(
        "shaders/records.glsl",
        "ivec2(halves << 16) >> 16,",
        "ivec2(halves & 0xffffu),",
        "tests/test_light.py::test_light_on_slopes[tilt2-glossy]",
    ),
    Mutant(
        "shaders/resolve.frag",
        "j == samples - 1) inside",
        "j == samples) inside",
        "tests/test_twins.py::test_weights_of_samples[3]",
    ),
    Mutant(
        "shaders/sheet_close.glsl",
        "0.5 * (part.x + part.y);",
        "part.x;",
        "tests/test_twins_sheets.py::test_light_over_sheets[3]",
    ),
    Mutant(
        "shaders/sheets.glsl",
        "1.0, 0.0, 1.0), q = 1.0",
        "1.0, 0.0, 0.9), q = 1.0",
        "tests/test_twins_sheets.py::test_weights_of_sheets[4]",
    ),
    Mutant(
        "shaders/streak.glsl",
        "-0.5 * size, 0.5 * size);",
        "-size, size);",
        "tests/test_twins_motion.py::test_kernels_on_their_paths[far-sheared]",
    ),
    Mutant(
        "shaders/surface.frag",
        "shine.y, 1.0) * color.a;",
        "shine.y, 1.0);",
        "tests/test_meshes.py::test_discs_in_fog[9.37-opacities3]",
    ),
    Mutant(
        "shaders/tile_draw.comp",
        "if (at + 3u >= end) next[3].splat.a = 0.0;",
        "",
        "tests/test_tiles.py::test_tiles_draw_what_quads_draw[cubes-wide-composite]",
    ),
    Mutant(
        "shaders/tile_list.comp",
        "uint place = cursors[slot];",
        "uint place = cursors[slot] + 1u;",
        "tests/test_tiles.py::test_tiles_draw_what_quads_draw[cubes-fitted-xray]",
    ),
    Mutant(
        "shaders/tile_place.frag",
        "blocks[n / BLOCK] * BLOCK + n % BLOCK;",
        "blocks[0] * BLOCK + n;",
        "tests/test_near.py::test_point_clouds",
    ),
    Mutant(
        "shaders/tiles.glsl",
        "float furthest = it.k *",
        "float furthest = 0.5 * it.k *",
        "tests/test_twins_geometry.py::test_tiles_of_splats",
    ),
    Mutant(
        "shaders/trilinear.glsl",
        "planes[i] = mix(a, b, part.y);",
        "planes[i] = mix(a, b, part.x);",
        "tests/test_twins_cues.py::test_cues[parallel]",
    ),
)
