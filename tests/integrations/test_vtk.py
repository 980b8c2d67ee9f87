"""Plotters of PyVista become scenes, and scenes plotters: the same volumes, colours, planes and views."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.color import linear_from_srgb, srgb_from_linear

SIZE = (48, 40)
POINTS = [(20.0, 0.0), (90.0, 0.2), (90.0, 0.6), (200.0, 0.4)]
TRANSFER = sg.Transfer(POINTS, "fire", (30.0, 180.0), unit=1.7)


@pytest.fixture
def pyvista(monkeypatch: pytest.MonkeyPatch) -> Any:
    found = pytest.importorskip("pyvista", reason="plotters come from pyvista")
    # it is looked for where there is none
    monkeypatch.delenv("DISPLAY", raising=False)
    return found


def some(shape: tuple[int, int, int] = (7, 8, 9), **given: Any) -> sg.Volume:
    samples = np.random.default_rng(3).integers(0, 200, shape).astype(np.uint8)
    return sg.Volume(samples, **{"spacing": (1.0, 2.0, 1.5), "origin": (3.0, -4.0, 5.0), "name": "some", **given})


def plotter(pyvista: Any, volume: sg.Volume, **options: Any) -> Any:
    made = pyvista.Plotter(off_screen=True, window_size=list(SIZE))
    made.add_volume(volume.to_pyvista(), show_scalar_bar=False, **options)
    return made


def only(x: Any) -> sg.Layer:
    (layer,) = sg.Scene.of(x).shown
    return layer


def corners(volume: sg.Volume) -> np.ndarray:
    return np.asarray(volume.corners)


# --- volumes ---


@pytest.mark.parametrize("kind", ["u1", ">u2", "i2", ">f4", "f8", "f2", "bool"])
def test_image_data_and_back(pyvista: Any, kind: str) -> None:
    turn = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    volume = some(direction=turn)
    volume = sg.Volume(volume.samples.astype(kind), volume.spacing, volume.origin, turn, name="some")
    back = sg.Volume.of(volume.to_pyvista())
    assert np.array_equal(back.samples, volume.samples) and back.name == "some"
    assert np.allclose(corners(back), corners(volume), atol=1e-12)


def test_image_data_shares_memory_and_has_colours_and_vectors(pyvista: Any) -> None:
    volume = some()
    assert np.shares_memory(np.asarray(volume.to_pyvista().active_scalars), volume.samples)
    color = np.random.default_rng(1).integers(0, 255, (*volume.shape, 3)).astype(np.uint8)
    rich = sg.Volume(volume.samples, color=color, vectors=color.astype(float))
    data = rich.to_pyvista()
    assert data.active_scalars_name == "values" and np.array_equal(data["colors"], color.reshape(-1, 3))
    assert np.array_equal(data["vectors"], color.reshape(-1, 3))


def test_without_the_library_its_extra_is_named() -> None:
    if importlib.util.find_spec("pyvista"):
        pytest.skip("pyvista is installed")
    for make in (some().to_pyvista, sg.Scene([some()]).to_pyvista, sg.Mesh.of_points([[0, 0, 0]], 1.0).to_pyvista):
        with pytest.raises(sg.InputError, match=r"needs the library pyvista; install it with: .*splatgl\[pyvista\]"):
            make()


def test_what_is_no_plotter_is_refused() -> None:
    for make in (sg.Scene.of, sg.Settings.of):
        with pytest.raises(sg.InputError, match="a plotter of PyVista, or a window or renderer of VTK, got a list"):
            make([1, 2])


@pytest.mark.long
def test_several_volumes_of_one_prop_are_layers(pyvista: Any) -> None:
    """Each has the data of its port, and its own look and place."""
    vtk = pytest.importorskip("vtk")
    prop, mapper = vtk.vtkMultiVolume(), vtk.vtkGPUVolumeRayCastMapper()
    prop.SetMapper(mapper)
    for port, opacity in ((0, 0.25), (3, 0.75)):
        mapper.SetInputDataObject(port, some(origin=(port, 0.0, 0.0)).to_pyvista())
        volume, curve = vtk.vtkVolume(), vtk.vtkPiecewiseFunction()
        curve.AddPoint(0, 0.0)
        curve.AddPoint(200, opacity)
        volume.GetProperty().SetScalarOpacity(curve)
        volume.SetPosition(0.0, 0.0, 10.0 * port)
        prop.SetVolume(volume, port)
    made = pyvista.Plotter(off_screen=True, window_size=list(SIZE))
    made.renderer.AddVolume(prop)
    first, second = sg.Scene.of(made).shown
    assert first.volume.origin == (0, 0, 0) and second.volume.origin == (3, 0, 30)
    assert first.transfer.points[-1][1] == 0.25 and second.transfer.points[-1][1] == 0.75


def test_masks_of_mappers(pyvista: Any) -> None:
    """Binary ones mask the volume, where it lies; others are refused, and by plotters those of volumes."""
    made = plotter(pyvista, some(), mapper="gpu")
    (volume,) = list(made.renderer.GetVolumes())
    inside = np.indices(some().shape)[2] < 4
    mask = sg.Volume(inside.astype(np.uint8) * 255, (1.0, 2.0, 1.5), (3.0, -4.0, 5.0))
    volume.GetMapper().SetMaskInput(mask.to_pyvista())
    volume.GetMapper().SetMaskTypeToBinary()
    found = only(made).volume
    assert (found.kept((0, 0, 0), found.shape) == inside).all()
    with pytest.raises(sg.InputError, match="some: expected no masks"):
        sg.Scene([some().masked(inside)]).to_pyvista(off_screen=True)
    volume.GetMapper().SetMaskTypeToLabelMap()
    with pytest.raises(sg.InputError, match="mask: expected a binary one"):
        sg.Scene.of(made)
    volume.GetMapper().SetMaskTypeToBinary()
    volume.GetMapper().SetMaskInput(some((3, 3, 3)).to_pyvista())
    with pytest.raises(sg.InputError, match="mask: expected a binary one"):
        sg.Scene.of(made)


def test_values_of_meshes_are_kept(pyvista: Any) -> None:
    mesh = sg.Mesh(np.eye(3), [[0, 1, 2]], values=[1.0, 2.0, 4.0], quantity="t", colormap="gray")
    assert mesh.to_pyvista().point_data["t"].tolist() == [1.0, 2.0, 4.0]
    made = sg.Scene([some()], meshes=[mesh]).to_pyvista(off_screen=True)
    (back,) = [each for each in sg.Scene.of(made).meshes if len(each) == 1]
    assert back.colors.tolist() == [[0] * 3, [85] * 3, [255] * 3]


# --- plotters to scenes ---


def test_transfer_functions_of_volumes(pyvista: Any) -> None:
    made = plotter(pyvista, some(), clim=(50, 150), cmap="viridis", opacity=[0.0, 0.3, 0.8], opacity_unit_distance=2.5)
    layer, looks = only(made), made.volume.prop
    values = np.linspace(20, 190, 300)
    theirs = [looks.GetScalarOpacity().GetValue(value) for value in values]
    assert np.allclose(layer.seen.opacity(values), theirs, atol=1e-6)
    assert layer.seen.unit == 2.5 and layer.seen.shading is False
    shown = values[(values > 60) & (values < 150)]
    colors = np.array([looks.GetRGBTransferFunction().GetColor(value) for value in shown])
    # colour maps are of 8 bits; VTK's are sRGB, ours linear light
    assert np.abs(srgb_from_linear(layer.seen.color(shown)) - colors).max() < 0.01
    assert np.abs(layer.seen.color(shown) - linear_from_srgb(colors)).max() < 0.02
    looks.shade = True
    assert only(made).seen.shading is True


def test_functions_of_vtk_that_are_not_linear_or_end(pyvista: Any) -> None:
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction

    made = plotter(pyvista, some())
    function = vtkPiecewiseFunction()
    function.ClampingOff()
    function.AddPoint(50.0, 0.5, 0.3, 0.7)
    function.AddPoint(150.0, 0.9)
    made.volume.prop.SetScalarOpacity(function)
    values = np.linspace(50, 149.9, 400)
    transfer = only(made).seen
    assert np.abs(transfer.opacity(values) - [function.GetValue(value) for value in values]).max() < 2e-3
    assert (transfer.opacity([20, 49.9, 150.1, 190]) == 0).all()


def test_gradients_are_per_length(pyvista: Any) -> None:
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction

    made = plotter(pyvista, some(spacing=(2.0, 2.0, 2.0)))
    weights = vtkPiecewiseFunction()
    weights.AddPoint(0, 0)
    weights.AddPoint(60, 1)
    made.volume.prop.SetGradientOpacity(weights)
    assert only(made).seen.gradient == ((0.0, 0.0), (30.0, 1.0))


def test_volumes_stand_where_their_actors_are(pyvista: Any) -> None:
    volume = some()
    made = plotter(pyvista, volume)
    actor = made.volume
    actor.SetScale(1, 2, 0.5)
    actor.RotateZ(30)
    actor.SetPosition(5, 6, 7)
    matrix = pyvista.array_from_vtkmatrix(actor.GetMatrix())
    right = corners(volume) @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.allclose(corners(only(made).volume), right, atol=1e-9)


def test_planes_and_cropping(pyvista: Any) -> None:
    from vtkmodules.vtkCommonDataModel import vtkPlane

    made = plotter(pyvista, some())
    plane, mapper = vtkPlane(), made.volume.mapper
    plane.SetOrigin(1, 2, 10)
    plane.SetNormal(0, 0, -2)
    mapper.AddClippingPlane(plane)
    mapper.SetCropping(True)
    mapper.SetCroppingRegionFlagsToSubVolume()
    mapper.SetCroppingRegionPlanes(4, 9, -2, 6, 6, 11)
    made.volume.SetPosition(10, 0, 0)
    scene = sg.Scene.of(made)
    (planes,) = scene.planes
    sides = [(1, 0, 0, 14), (-1, 0, 0, -19), (0, 1, 0, -2), (0, -1, 0, -6), (0, 0, 1, 6), (0, 0, -1, -11)]
    assert np.allclose(planes, [(0, 0, -1, -10), *sides])
    mapper.SetCroppingRegionFlagsToFence()
    with pytest.raises(sg.InputError, match="the box between the planes"):
        sg.Scene.of(made)


def test_colours_and_independent_components(pyvista: Any) -> None:
    volume = some()
    rgba = np.random.default_rng(5).integers(0, 255, (volume.count, 4)).astype(np.uint8)
    made = pyvista.Plotter(off_screen=True)
    made.add_volume(volume.to_pyvista(), scalars=rgba, show_scalar_bar=False)
    layer = only(made)
    assert layer.volume.color is not None
    assert np.array_equal(layer.volume.color.reshape(-1, 3), rgba[:, :3])
    assert np.array_equal(layer.volume.samples.ravel(), rgba[:, 3])
    made.volume.prop.independent_components = True
    parts = sg.Scene.of(made).shown
    assert [part.volume.samples.ravel().tolist() for part in parts] == rgba.T.tolist()


def test_blends_background_and_light(pyvista: Any) -> None:
    made = plotter(pyvista, some(), blending="maximum")
    made.set_background("#804020")
    settings = sg.Settings.of(made)
    assert settings.blend == "mip"
    assert settings.background == pytest.approx(linear_from_srgb(np.array([128, 64, 32]) / 255).tolist())
    # a light kit: its key light is above, and a little to the right
    assert settings.light == "matte" and settings.light_from == pytest.approx((10.0, 50.0))
    made.remove_all_lights()
    made.add_light(pyvista.Light(light_type="headlight"))
    assert sg.Settings.of(made).light == "head"
    made.volume.mapper.SetBlendMode(6)
    with pytest.raises(sg.InputError, match="composite, maximum, minimum, average or additive, got slice"):
        sg.Settings.of(made)


def ball_under_headlight(pyvista: Any, intensity: float = 1.0, **look: Any) -> Any:
    made = pyvista.Plotter(off_screen=True, window_size=SIZE, lighting="none")
    made.add_light(pyvista.Light(light_type="headlight", intensity=intensity))
    made.set_background("black")
    made.add_mesh(pyvista.Sphere(), color="#a0a0a0", **look)
    return made


def test_surfaces_reflect_light_as_their_actors_say(pyvista: Any) -> None:
    made = ball_under_headlight(pyvista, ambient=0.2, diffuse=0.5, specular=0.1)
    settings = sg.Settings.of(made)
    assert (settings.ambient, settings.diffuse, settings.specular) == pytest.approx((0.2, 0.5, 0.1))
    assert settings.light == "glossy" and settings.light_from == (0.0, 0.0)
    weak = sg.Settings.of(ball_under_headlight(pyvista, intensity=0.5, ambient=0.2, diffuse=0.5))
    assert (weak.ambient, weak.diffuse, weak.specular) == pytest.approx((0.2, 0.25, 0.0))
    glaring = ball_under_headlight(pyvista, ambient=0.2, diffuse=1.0, specular=0.5)
    assert (limited := sg.Settings.of(glaring)).strengths == pytest.approx((0.2, 0.3, 0.5)), limited
    notes: Any = sg.render(glaring).info["notes"]
    assert any("limited to a sum of 1" in note for note in notes) and any("linear light" in note for note in notes)
    glaring.add_mesh(pyvista.Cube(), ambient=0.5)
    assert any("as the first" in note for note in sg.render(glaring).info["notes"])  # type: ignore[attr-defined]


def test_actors_without_lighting_keep_their_colour(pyvista: Any) -> None:
    made = ball_under_headlight(pyvista, lighting=False)
    samples = sg.render(made).samples8()
    middle = samples[SIZE[1] // 2, SIZE[0] // 2, :3]
    assert np.abs(middle.astype(int) - 0xA0).max() <= 1
    # plane faces and those that planes cut are of one brightness, too
    clipped = [mesh.cut([(1.0, 0.0, 0.0, 0.0)]) for mesh in sg.Scene.of(made).meshes]
    assert all((mesh.normals == 0).all() for mesh in clipped)


@pytest.mark.parametrize("where", ["camera", "world"])
def test_the_side_of_lights(pyvista: Any, where: str) -> None:
    made = plotter(pyvista, some())
    made.remove_all_lights()
    made.camera_position = [(0, -50, 0), (0, 0, 0), (0, 0, 1)]
    light = pyvista.Light(light_type="camera light" if where == "camera" else "scene light")
    # to the right: +x, above: +z
    light.position, light.focal_point = ((1, 1, 1) if where == "camera" else (1, -1, 1)), (0, 0, 0)
    made.add_light(light)
    assert sg.Settings.of(made).light_from == pytest.approx((45.0, np.degrees(np.arcsin(3**-0.5))))


def test_what_has_no_like_is_refused(pyvista: Any) -> None:
    empty = pyvista.Plotter(off_screen=True)
    empty.add_mesh(pyvista.Sphere(), opacity=0.0)
    with pytest.raises(sg.InputError, match="a visible volume or mesh, got none"):
        sg.Scene.of(empty)
    mixed_up = pyvista.RectilinearGrid([0.0, 3, 1], [0.0, 1, 2], [0.0, 1.0])
    mixed_up["a"] = np.arange(18.0)
    with pytest.raises(sg.InputError, match="expected coordinates that rise or fall throughout"):
        sg.Volume.of(mixed_up)
    with pytest.raises(sg.InputError, match="image data, got a UnstructuredGrid; resample it"):
        sg.Volume.of(pyvista.UnstructuredGrid())
    mixed = plotter(pyvista, some(), blending="maximum")
    mixed.add_volume(some().to_pyvista(), name="b", show_scalar_bar=False)
    with pytest.raises(sg.InputError, match="one blend mode, got composite and mip"):
        sg.Settings.of(mixed)


def test_hidden_things_are_left_out(pyvista: Any) -> None:
    made = plotter(pyvista, some())
    made.add_volume(some().to_pyvista(), name="b", show_scalar_bar=False).visibility = False
    made.add_mesh(pyvista.Sphere()).visibility = False
    made.show_bounds()
    made.add_axes()
    made.add_text("text")
    scene = sg.Scene.of(made)
    assert len(scene.shown) == 1 and scene.meshes == ()


# --- meshes ---


def meshes(made: Any) -> tuple[sg.Mesh, ...]:
    return tuple(sg.Scene.of(made).meshes)


def test_surfaces_and_their_colours(pyvista: Any) -> None:
    made = plotter(pyvista, some())
    box = made.add_mesh(pyvista.Cube(), color="#ff8000", opacity=0.4)
    box.SetPosition(10, 0, 0)
    (mesh,) = meshes(made)
    assert len(mesh) == 12 and mesh.opacity == pytest.approx(0.4)
    assert mesh.color == pytest.approx(linear_from_srgb(np.array([255, 128, 0]) / 255).tolist())
    assert mesh.vertices.min(axis=0).tolist() == [9.5, -0.5, -0.5] and mesh.vertices.max() == 10.5
    made.remove_actor(box)
    plane = pyvista.Plane(i_resolution=2, j_resolution=1)
    plane.point_data["v"] = plane.points[:, 0]
    made.add_mesh(plane, scalars="v", cmap="gray", clim=(-0.5, 0.5), show_scalar_bar=False)
    (mesh,) = meshes(made)
    assert mesh.colors is not None
    gray = np.rint(255 * (mesh.vertices[:, 0] + 0.5))
    assert np.abs(mesh.colors.astype(int) - gray[:, None]).max() <= 1


def test_colours_of_cells_end_at_their_edges(pyvista: Any) -> None:
    made = plotter(pyvista, some())
    plane = pyvista.Plane(i_resolution=2, j_resolution=1)
    plane.cell_data["rgb"] = np.array([[255, 0, 0], [0, 0, 255]], np.uint8)
    made.add_mesh(plane, scalars="rgb", rgb=True)
    (mesh,) = meshes(made)
    assert mesh.colors is not None
    left = mesh.vertices[mesh.faces].mean(axis=1)[:, 0] < 0
    assert (mesh.colors[mesh.faces[left]] == (255, 0, 0)).all()
    assert (mesh.colors[mesh.faces[~left]] == (0, 0, 255)).all()


def test_lines_points_and_edges(pyvista: Any) -> None:
    made = plotter(pyvista, some())
    made.camera_position = [(0, 0, 50), (0, 0, 0), (0, 1, 0)]
    made.camera.parallel_projection, made.camera.parallel_scale = True, 20.0
    # pixels of one unit
    line = made.add_mesh(pyvista.Line((-5, 0, 0), (5, 0, 0)), color="red", line_width=4)
    (tube,) = meshes(made)
    assert np.abs(tube.vertices[:, 1:]).max() == pytest.approx(2.0)
    made.remove_actor(line)
    dots = made.add_points(np.array([[0.0, 0, 0], [8, 0, 0]]), color="red", point_size=6)
    (balls,) = meshes(made)
    assert balls.vertices[:, 0].min() == pytest.approx(-3.0) and balls.vertices[:, 0].max() == pytest.approx(11.0)
    made.remove_actor(dots)
    wire = made.add_mesh(pyvista.Cube(), style="wireframe", line_width=0.2)
    (edges,) = meshes(made)
    # 12 edges, each a tube of 8 sides
    assert len(edges) == 12 * 16
    made.remove_actor(wire)
    made.add_mesh(pyvista.Cube(), show_edges=True, edge_color="black")
    shown = meshes(made)
    assert sorted(len(mesh) for mesh in shown) == [12, 192] and (0.0, 0.0, 0.0) in {mesh.color for mesh in shown}


def test_planes_cut_surfaces(pyvista: Any) -> None:
    from vtkmodules.vtkCommonDataModel import vtkPlane

    made = plotter(pyvista, some())
    actor = made.add_mesh(pyvista.Sphere(radius=2.0))
    actor.SetPosition(10, 0, 0)
    plane = vtkPlane()
    plane.SetOrigin(10.5, 0, 0)
    plane.SetNormal(1, 0, 0)
    actor.mapper.AddClippingPlane(plane)
    (mesh,) = meshes(made)
    assert mesh.vertices[:, 0].min() == pytest.approx(10.5) and mesh.vertices[:, 0].max() == pytest.approx(
        12.0, abs=0.1
    )


def test_several_opacities_are_refused(pyvista: Any) -> None:
    made = plotter(pyvista, some())
    sphere = pyvista.Sphere()
    made.add_mesh(sphere, scalars=sphere.points[:, 2], opacity=[0.0, 1.0], show_scalar_bar=False)
    with pytest.raises(sg.InputError, match="mesh: expected one opacity, got some from 0 to 1"):
        sg.Scene.of(made)


# --- scenes to plotters ---


@pytest.mark.parametrize("orthographic", [False, True])
def test_scenes_are_the_same_after_a_plotter(pyvista: Any, orthographic: bool) -> None:
    sheared = some(direction=[[1, 0.3, 0], [0, 0.9, 0], [0, 0, -1]])
    layers = [sg.Layer(sheared, TRANSFER), sg.Layer(some(), sg.Transfer(POINTS, gradient=[(0, 0), (9, 1)]), clip=[])]
    mesh = sg.Mesh.of_points([[1, 2, 3]], 4.0, color="#d04020", opacity=0.5)
    scene = sg.Scene(layers, clip=[(1.0, 0.0, 0.0, 3.5)], meshes=[mesh])
    camera = sg.Camera.orbit(scene, 40, 10, size=SIZE)
    camera = camera.parallel(scene) if orthographic else camera
    settings = sg.Settings(blend="mip", background=(0.1, 0.2, 0.4), light="glossy")
    made = scene.to_pyvista(camera, settings, off_screen=True)
    back, view, how = sg.Scene.of(made), sg.Camera.of(made), sg.Settings.of(made)
    assert np.allclose(back.planes[0], scene.planes[0]) and back.planes[1] == ()
    values = np.linspace(0, 250, 333)
    for ours, theirs in zip(scene.shown, back.shown, strict=True):
        assert np.array_equal(theirs.volume.samples, ours.volume.samples)
        assert np.allclose(corners(theirs.volume), corners(ours.volume), atol=1e-9)
        assert np.allclose(theirs.seen.opacity(values), ours.seen.opacity(values), atol=1e-4)
        seen = values[ours.seen.opacity(values) > 0]
        assert np.abs(srgb_from_linear(theirs.seen.color(seen)) - srgb_from_linear(ours.seen.color(seen))).max() < 0.01
        assert theirs.seen.unit == pytest.approx(ours.seen.length(ours.volume))
    assert np.allclose(back.shown[1].seen.gradient, [(0, 0), (9, 1)])
    assert np.allclose(view.eye, camera.eye) and np.allclose(view.eye_from_world, camera.eye_from_world, atol=1e-9)
    assert view.size == SIZE and view.extent == pytest.approx(camera.extent) and view.perspective != orthographic
    assert (how.blend, how.light) == ("mip", "glossy") and how.light_from == pytest.approx((-35.0, 35.0))
    assert how.background == pytest.approx(settings.background, abs=0.005)
    (surface,) = back.meshes
    assert np.allclose(surface.vertices, mesh.vertices, atol=1e-5) and surface.opacity == 0.5
    assert np.abs(np.array(surface.color) - mesh.color).max() < 0.01


def test_labels_logarithms_and_colours_reach_a_plotter(pyvista: Any) -> None:
    labels = sg.Transfer([(1, 0.0), (5, 0.9)], labels=[(1, "#ff0000", 0.5), (4, "#00ff00", 0.9)])
    logarithmic = sg.Transfer([(1.0, 0.0), (100.0, 0.5)], "viridis", scale="log")
    for transfer, values in ((labels, np.array([0, 1, 2, 3, 4, 5, 6])), (logarithmic, np.geomspace(1.1, 90, 50))):
        made = sg.Scene([sg.Layer(some(), transfer)]).to_pyvista(off_screen=True)
        looks = next(iter(made.renderer.volumes)) if hasattr(made.renderer, "volumes") else None
        looks = (looks or made.renderer.GetVolumes().GetItemAsObject(0)).GetProperty()
        theirs = [looks.GetScalarOpacity().GetValue(value) for value in values]
        assert np.allclose(theirs, transfer.opacity(values), atol=0.005)
        shown = values[transfer.opacity(values) > 0]
        colors = [looks.GetRGBTransferFunction().GetColor(value) for value in shown]
        assert np.abs(np.array(colors) - srgb_from_linear(transfer.color(shown))).max() < 0.02
    volume = some()
    color = np.random.default_rng(1).integers(0, 255, (*volume.shape, 3)).astype(np.uint8)
    colored = sg.Volume(volume.samples, color=color)
    layer = only(sg.Scene([sg.Layer(colored, sg.Transfer([(0, 0.0), (255, 1.0)]))]).to_pyvista(off_screen=True))
    assert np.array_equal(layer.volume.color, color) and np.array_equal(layer.volume.samples, volume.samples)


def test_a_blend_that_vtk_has_not_is_refused(pyvista: Any) -> None:
    with pytest.raises(sg.InputError, match="one that VTK has: composite, mip, minip, mean, got xray"):
        sg.Scene([some()]).to_pyvista(settings=sg.Settings(blend="xray"))


# --- pictures ---


def test_pictures_are_those_of_vtk(pyvista: Any, tmp_path: Path) -> None:
    """Alpha of two balls, seen by VTK and here, by the same transfer function and camera."""
    z, y, x = np.indices((24, 20, 28))
    samples = 255 * np.exp(-((x - 9) ** 2 + (y - 8) ** 2 + (z - 15) ** 2) / 24)
    samples += 200 * np.exp(-((x - 20) ** 2 + (y - 11) ** 2 + (z - 7) ** 2) / 9)
    volume = sg.Volume(samples.astype(np.float32), (1.0, 1.3, 0.8), (2.0, 3.0, -9.0))
    scene = sg.Scene([sg.Layer(volume, sg.Transfer([(40, 0.0), (255, 0.6)], "fire", shading=False))])
    made = scene.to_pyvista(sg.Camera.orbit(scene, 50, 30, size=(96, 80)), off_screen=True)
    try:
        made.show(auto_close=False)
        theirs = np.asarray(made.screenshot(return_img=True, transparent_background=True))[..., 3] / 255
    finally:
        made.close()
    with sg.Renderer() as renderer:
        ours = renderer.render(scene, sg.Camera.orbit(scene, 50, 30, size=(96, 80))).pixels[..., 3]
    assert ours.max() > 0.9 and np.abs(ours - theirs).max() < 0.06
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] > 0.999


@pytest.mark.parametrize("opacity", [[0, 1], [1, 1], [0, 0.2, 0.9]])
def test_averages_are_those_of_vtk(pyvista: Any, opacity: list[float]) -> None:
    """VTK averages values times their opacities, and shows the mean's colour, opaque."""
    z, y, x = np.indices((24, 28, 32)) - np.reshape((12, 14, 14), (3, 1, 1, 1))
    samples = (np.clip((9 - np.sqrt(x * x + y * y + z * z)) / 4 + 0.5, 0, 1) * 200).astype(np.uint8)
    made = pyvista.Plotter(off_screen=True, window_size=[96, 80], lighting="none")
    look = {"blending": "average", "cmap": "gray", "clim": (0, 200), "show_scalar_bar": False, "mapper": "gpu"}
    made.add_volume(sg.Volume(samples).to_pyvista(), opacity=opacity, **look)
    made.set_background("black")
    ours = np.asarray(sg.render(made).to_pil().convert("RGB")).astype(float)
    try:
        made.show(auto_close=False)
        theirs = np.asarray(made.screenshot(return_img=True)).astype(float)
    finally:
        made.close()
    # VTK's rays end at the outer samples: their means are of 27 voxels for 28
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] > 0.998
    assert ours.sum() == pytest.approx(theirs.sum(), rel=0.12)


@pytest.mark.parametrize("way", ["grid", "cells"])
def test_rectilinear_grids_are_resampled(pyvista: Any, way: str) -> None:
    """A linear field stays one, on a grid of its least distances; even axes stay."""
    axes = [np.array([0.0, 1, 2, 5, 9]), np.array([1.0, 3, 5]), np.array([-2.0, 0, 1, 4])]
    grid = pyvista.RectilinearGrid(*axes)
    points = grid.points if way == "grid" else grid.cell_centers().points
    (grid.point_data if way == "grid" else grid.cell_data)["v"] = points @ (1.0, 10.0, -3.0)
    volume = sg.Volume.of(grid)
    z, y, x = np.indices(volume.shape)
    places = np.stack([x, y, z], axis=-1) * volume.spacing + volume.origin
    np.testing.assert_allclose(volume.samples, places @ (1.0, 10.0, -3.0), rtol=1e-5)
    assert volume.spacing == ((1.0, 2.0, 1.0) if way == "grid" else pytest.approx((6.5 / 7, 2.0, 3.5 / 3)))
    np.testing.assert_allclose(np.max(places, axis=(0, 1, 2)), points.max(axis=0), atol=1e-9)
    assert "resampled every" in volume.notes[0] and "RMSE at its own points" in volume.notes[0]


def shown(made: Any) -> np.ndarray:
    """VTK's own picture of a plotter, which is closed."""
    try:
        made.show(auto_close=False)
        return np.asarray(made.screenshot(return_img=True)).astype(float)
    finally:
        made.close()


def shot(made: Any, **options: Any) -> np.ndarray:
    return np.asarray(sg.render(made, **options).to_pil().convert("RGB")).astype(float)


def blob() -> sg.Volume:
    z, y, x = np.indices((24, 28, 32)) - np.reshape((12, 14, 14), (3, 1, 1, 1))
    return sg.Volume((255 * np.exp(-(x * x + y * y + z * z) / 60)).astype(np.float32))


def test_meshes_alone_and_their_textures(pyvista: Any) -> None:
    """Left red, right blue, and darker by the actor's colour; texels are as sharp as the mesh is cut."""
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:, :4, 0], pixels[:, 4:, 2] = 200, 240
    made = pyvista.Plotter(off_screen=True, window_size=[64, 64], lighting="none")
    made.add_mesh(
        pyvista.Plane(i_resolution=1, j_resolution=1),
        texture=pyvista.numpy_to_texture(pixels),
        color="#ffffff",
        lighting=False,
    )
    made.view_xy()
    made.actors[next(iter(made.actors))].prop.color = (0.5, 0.5, 0.5)
    (mesh,) = meshes(made)
    assert len(mesh) == 2 * 16**2 and mesh.colors is not None
    # at its ends the texture is repeated
    left, right = (mesh.colors[np.abs(mesh.vertices[:, 0] - middle) < 0.1] for middle in (-0.3, 0.3))
    assert (left == (100, 0, 0)).all() and (right == (0, 0, 120)).all()
    ours = shot(made)
    assert (ours[32, 20] > ours[32, 44])[0] and (ours[32, 44] > ours[32, 20])[2]
    assert sg.render(made).info["notes"] == ()
    # of what is asked for, not of what the plotter sets
    (note,) = sg.render(made, samples=2).notes
    assert note.startswith("samples: no effect")


def test_the_active_view_of_several(pyvista: Any) -> None:
    made = pyvista.Plotter(off_screen=True, window_size=[96, 64], shape=(1, 2), lighting="none")
    for column, color in enumerate(("red", "blue")):
        made.subplot(0, column)
        made.add_mesh(pyvista.Sphere(), color=color)
    assert sg.Camera.of(made).size == (48, 64)
    assert [shot(made)[32, 24].argmax(), sg.Scene.of(made).meshes[0].color[2]] == [2, 1.0]
    made.subplot(0, 0)
    assert shot(made)[32, 24].argmax() == 0
    # of a window the first view that shows anything
    assert sg.Scene.of(made.render_window).meshes[0].color[0] == 1.0
    assert sg.Camera.of(made.render_window).size == (48, 64)


@pytest.mark.long
def test_what_is_left_out_is_told(pyvista: Any) -> None:
    made = plotter(pyvista, some())
    made.remove_all_lights()
    made.add_light(pyvista.Light(light_type="headlight"))
    assert sg.render(made).info["notes"] == ("not rendered: steps between voxels (nearest interpolation)",)
    made.volume.prop.interpolation_type = "linear"
    assert sg.render(made).info["notes"] == ()
    made.add_mesh(pyvista.Plane(center=(5, 5, 5)), texture=pyvista.numpy_to_texture(np.zeros((4, 4, 3), np.uint8)))
    made.add_mesh(pyvista.Sphere(), scalars=np.arange(842), scalar_bar_args={"title": "bar"})
    made.add_text("text")
    made.add_text("another", position="lower_left")
    made.add_text("hidden").SetVisibility(False)
    made.show_bounds()
    made.add_point_labels([[1.0, 2.0, 3.0]], ["point"])
    made.add_light(pyvista.Light(position=(1, 2, 3)))
    made.set_background("black", top="white")
    notes: Any = sg.render(made).info["notes"]
    for part in ("axes", "labels", "a scalar bar", "a text, 2 times"):
        assert f"not rendered: {part}" in notes, notes
    assert {"lit by the brightest of 2 lights", "the background is the mean of its gradient"} <= set(notes)


def test_render_takes_plotters_and_scenes(pyvista: Any) -> None:
    made = plotter(pyvista, some())
    made.set_background("black")
    image = sg.render(made)
    with sg.Renderer() as renderer:
        right = renderer.render(sg.Scene.of(made), sg.Camera.of(made), sg.Settings.of(made))
    assert np.array_equal(image.pixels, right.pixels) and image.pixels.shape[:2] == SIZE[::-1]
    assert sg.render(made, size=20, background="white").pixels[0, 0].tolist() == [1, 1, 1, 1]


def test_render_takes_scenes() -> None:
    scene = sg.Scene([sg.Layer(some(), TRANSFER)])
    image = sg.render(scene, azimuth=70, size="30x20", blend="mip")
    camera = sg.Camera.orbit(scene, azimuth=70, elevation=20, size=(30, 20))
    with sg.Renderer() as renderer:
        right = renderer.render(scene, camera, sg.Settings(blend="mip", background="black"))
    assert np.array_equal(image.pixels, right.pixels)
    with pytest.raises(sg.InputError, match=r"options: expected fields of Settings, azimuth.*got spacing"):
        sg.render(scene, spacing=(1, 1, 1))
    with pytest.raises(sg.InputError, match="none together with a scene"):
        sg.render(scene, "mri")
