"""Masks along rays and colours of meshes in GLSL, and their float64 twins."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.geometry.mask_field import EDGE, ONE, ZERO, MaskField, clip_to_mask
from splatgl.gl.meshes import MAPS_UNIT
from splatgl.reference.rays import Bounds, Rays, pixel_slopes
from splatgl.reference.sheets import ray_offset
from splatgl.transfer.colormaps import FURTHEST, UNKNOWN, map_color, map_tables
from tests.helpers.noise import views
from tests.helpers.sheet_twins import RAMP, uniforms
from tests.helpers.twins import COUNT, Twin

MASKED = {"MASKED": True, "SHEETS": 2, "STEPS": 2, "SHADING": True}


def mask_at(mask: MaskField, places: np.ndarray) -> np.ndarray:
    """[N, 4]: the mask and, decoded by `normal_in`, its gradient."""
    return np.column_stack([mask.at(places) + EDGE, normal_in((mask.normals(places) * ONE + ZERO) / 255)])


def normal_in(texels: np.ndarray) -> np.ndarray:
    return (texels * 255 - ZERO) / ONE


@pytest.mark.parametrize("view", ["fitted", "parallel"])
def test_masks_along_rays(view: str, twin: Twin, renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """At any sheet of any pixel, beyond the mask's box, too."""
    cells = np.random.default_rng(3).random((14, 12, 16))
    inside = np.zeros(cells.shape, bool)
    inside[5:9, 2:12, 6:11] = rng.random((4, 10, 5)) < 0.7
    volume = sg.Volume(cells, direction=np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])).masked(inside)
    splats = sg.extract(volume, RAMP, classification="post-all")
    plan = sg.plan(splats, views(splats)[view], sg.Settings(sheets=2, antialias="off"), tiles=True)
    mask, camera = plan.resolved.mask, plan.resolved.camera
    assert mask is not None and plan.program.appearance.masked and plan.resolved.sheets is not None
    pixel = rng.integers(0, camera.size[0] * camera.size[1], COUNT)
    state = uniforms(splats, plan)
    at = np.stack([pixel % camera.size[0], pixel // camera.size[0]], axis=1) + 0.5
    sheet = rng.uniform(0, 30, COUNT)
    given = {"a": at, "s": sheet}
    found = twin(
        "sheet_draw.comp",
        "first = a; set_ray(0); result = mask_at(0, s); result.gba = normal_in(result)",
        plan,
        splats,
        state,
        **given,
    )
    bounds, slopes = Bounds.of_voxels(splats.post.shape), pixel_slopes(pixel, camera, plan.view.pitch)
    rays = Rays.of(plan.view, camera, bounds, slopes)
    along = (sheet + state["first_sheet"]) * plan.resolved.sheets.thickness - ray_offset(plan.view, rays)
    right = mask_at(mask, rays.start + rays.direction * along)
    assert np.abs(found - right).max() < 1e-4
    assert 20 < (right[:, 0] > 0.5).sum() < COUNT - 20 and np.ptp(right[:, 1:]) > 0.5


def test_what_is_kept_of_parts(twin: Twin, rng: np.random.Generator) -> None:
    """Of masks that rise, fall, keep all and nothing; a part without a length stays one."""
    part = np.sort(rng.random((COUNT, 2)), axis=1)
    part[::7, 1] = part[::7, 0]
    m = rng.uniform(-0.5, 0.5, (COUNT, 2))
    m[::5, 1] = m[::5, 0]
    found = twin("sheet_draw.comp", "result.xy = kept_part(p, m)", state=MASKED, p=part, m=m)[:, :2]
    right = np.stack(clip_to_mask((m[:, 0], m[:, 1]), (part[:, 0], part[:, 1])), axis=1)
    assert np.abs(found - right).max() < 1e-5
    kinds = {(bool(a), bool(b)) for a, b in m >= 0}
    assert len(kinds) == 4 and ((right[:, 1] - right[:, 0]) >= 0).all()


def test_shares_of_faces(twin: Twin, rng: np.random.Generator) -> None:
    gradient = rng.normal(size=(COUNT, 3)) * 10.0 ** rng.uniform(-4, 0.5, (COUNT, 1))
    normal = rng.normal(size=(COUNT, 3))
    normal *= rng.random((COUNT, 1)) / np.linalg.norm(normal, axis=1, keepdims=True)
    gradient[::9], normal[4::9] = 0, 0
    gradient[2::9] = 3 * normal[2::9]
    mask = MaskField(np.zeros((1, 1, 1), np.uint8), (0, 0, 0), np.eye(3), (1, 1, 1), sure=0.1)
    state = {**MASKED, "mask_sure": mask.sure_of(2.0)}
    found = twin("sheet_draw.comp", "result.x = face_share(g, n)", state=state, g=gradient, n=normal)[:, 0]
    right = mask.face_share(gradient, normal, 2.0)
    assert np.abs(found - right).max() < 1e-5 and right.min() < 0.01 and right.max() > 0.9


def test_colours_of_values(twin: Twin, renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """Within the window, beyond it, without a value, and of no map."""
    meshes = [sg.Mesh(np.eye(3), [[0, 1, 2]], values=[0, 1, 2], colormap=name) for name in ("hot", "viridis")]
    tables = map_tables(meshes)
    texture = renderer.ctx.texture(tables.shape[1::-1], 3, tables.tobytes(), dtype="f4")
    texture.use(MAPS_UNIT)
    place, row = rng.uniform(-0.5, 1.5, COUNT), rng.integers(-1, 2, COUNT)
    place[::11], place[1::11], place[2::11] = UNKNOWN, FURTHEST, -FURTHEST
    plain = rng.random((COUNT, 3))
    given = {"v": np.stack([place, row], axis=1), "p": plain}
    found = twin("mesh_maps.glsl", "result.xyz = mapped_color(v, p)", state={"maps": MAPS_UNIT}, **given)[:, :3]
    texture.release()
    for n, table in enumerate(tables.astype(np.float64)):
        some = row == n
        assert np.abs(found[some] - map_color(table, place[some], plain[some])).max() < 1e-4
    assert np.abs(found[row < 0] - plain[row < 0]).max() < 1e-6
