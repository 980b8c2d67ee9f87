"""Snapshots of a napari viewer: plain data of its layers at the sliders, camera and canvas, for other processes."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from types import SimpleNamespace
from typing import Any

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.integrations.napari.meshes import meshes_of, world_matrix
from splatgl.splat.scene import Scene
from splatgl.splat.settings import Blend, Lights

# entries of a stored colour map
ENTRIES = 1024
# largest level of a multiscale layer that is drawn, voxels
MOST_VOXELS = 2**26
# most scenes that are kept with their splats
MOST_SCENES = 8
# kinds of layers of voxels, and kinds that are drawn as meshes
FIELDS, SHAPES = ("Image", "Labels"), ("Points", "Shapes", "Surface", "Tracks", "Vectors")
# overlays of a canvas, and of a layer, that may be visible but are not drawn
CANVAS_EXTRAS = {"scale_bar": "scale bar", "axes": "axes", "text": "text"}
OLD_EXTRAS = {"scale_bar": "scale bar", "axes": "axes", "text_overlay": "text"}
LAYER_EXTRAS = {"bounding_box": "bounding box", "colorbar": "colour bar", "name_overlay": "name"}
# attributes of image layers, which have the values of `LayerSnapshot` where a layer lacks them
LOOKS = (
    *("gamma", "iso_threshold", "attenuation", "rendering", "depiction", "interpolation2d", "interpolation3d"),
    *("projection_mode", "contour", "rgb"),
)


@dataclass(frozen=True)
class Look:
    """How a picture differs from the viewer's. blend: None: each layer's. size: (width, height); None: the canvas'.
    preset: name of a transfer function of images, or "". annotate: as of `annotated`. stride, scale: of a preview, of
    voxels and pixels.
    """

    blend: Blend | None = None
    size: tuple[int, int] | None = None
    light: Lights = "head"
    preset: str = ""
    annotate: tuple[str, ...] = ()
    stride: int = 1
    scale: float = 1.0


@dataclass(frozen=True)
class ColorTable:
    """A colour map as sRGB and alpha [ENTRIES, 3 or 4] at even places from 0 to 1."""

    name: str
    colors: np.ndarray

    def map(self, places: Any) -> np.ndarray:
        """Colours [..., 3 or 4] at places from 0 to 1."""
        at = np.clip(np.asarray(places, float), 0.0, 1.0) * (len(self.colors) - 1)
        low = np.minimum(at.astype(np.intp), len(self.colors) - 2)
        share = (at - low)[..., None]
        return np.asarray(self.colors[low] * (1 - share) + self.colors[low + 1] * share)


@dataclass(eq=False)
class LayerSnapshot:
    """A layer at the viewer's sliders. kind: Image, Labels, Mesh, or that of a layer that is not drawn. matrix
    [n + 1, n + 1]: napari's world from indices of the data. finest: sizes of the finest level. looks: of LOOKS.
    """

    kind: str
    name: str
    visible: bool
    opacity: float = 1.0
    blending: str = "translucent"
    data: Any = None
    ndim: int = 0
    matrix: np.ndarray = field(default_factory=lambda: np.eye(1))
    units: tuple[str, ...] | None = None
    contrast_limits: tuple[float, float] = (0.0, 1.0)
    colormap: ColorTable | None = None
    colors: dict[int, np.ndarray] = field(default_factory=dict)
    plane: Any = None
    experimental_clipping_planes: Sequence[Any] = ()
    extras: tuple[str, ...] = ()
    meshes: tuple[Mesh, ...] = ()
    notes: tuple[str, ...] = ()
    rgb: bool = False
    gamma: float = 1.0
    iso_threshold: float = 0.5
    attenuation: float = 0.05
    rendering: str = "mip"
    depiction: str = "volume"
    interpolation2d: str = "nearest"
    interpolation3d: str = "linear"
    projection_mode: str = "none"
    contour: int = 0
    multiscale: bool = False
    # of the samples, and of all that the layer's scene depends on; b"": not known
    samples_key: bytes = b""
    key: bytes = b""

    def sign(self) -> None:
        """Sets the keys."""
        samples = np.zeros(0) if self.data is None else np.ascontiguousarray(self.data)
        self.samples_key = blake2b(samples.data, digest_size=16).digest()
        rest = replace(self, data=None, opacity=0.0, key=b"")
        self.key = blake2b(pickle.dumps(rest), digest_size=16).digest()

    @property
    def dtype(self) -> Any:
        """Type of the samples."""
        return self.data.dtype

    def data_to_world(self, at: Any) -> np.ndarray:
        """World place of an index."""
        return np.asarray(self.matrix[:-1, :-1] @ np.asarray(at, float) + self.matrix[:-1, -1])

    def world_to_data(self, at: Any) -> np.ndarray:
        """Index of a world place."""
        return np.asarray(np.linalg.solve(self.matrix[:-1, :-1], np.asarray(at, float) - self.matrix[:-1, -1]))

    def get_color(self, number: int) -> np.ndarray:
        """sRGB and alpha of a label."""
        return self.colors.get(int(number), np.zeros(4))


@dataclass(eq=False)
class Snapshot:
    """A viewer. ground: sRGB [3] of the canvas. extras: visible overlays that are not drawn. is_grid: whether layers
    stand beside each other.
    """

    layers: list[LayerSnapshot]
    camera: SimpleNamespace
    dims: SimpleNamespace
    canvas: SimpleNamespace
    ground: np.ndarray
    extras: tuple[str, ...] = ()
    is_grid: bool = False
    look: Look = field(default_factory=Look)
    # scenes of earlier pictures by what they depend on
    scenes: dict[Any, Scene] = field(default_factory=dict)

    def scene(self, layers: Sequence[LayerSnapshot], make: Callable[[], Scene]) -> Scene:
        """The scene of layers: that of an earlier picture if nothing has changed but the camera, else a new one."""
        key = (*(layer.key for layer in layers), self.look.blend, self.look.preset, self.look.stride)
        if not all(layer.key for layer in layers):
            return make()
        # the newest is the last
        scene = self.scenes[key] = self.scenes.pop(key) if key in self.scenes else make()
        while len(self.scenes) > MOST_SCENES:
            del self.scenes[next(iter(self.scenes))]
        return scene

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture in pixels."""
        width, height = self.look.size or (round(self.canvas.size[1]), round(self.canvas.size[0]))
        return max(1, round(width * self.look.scale)), max(1, round(height * self.look.scale))


def take(viewer: Any) -> Snapshot:
    """Snapshot of a viewer; only samples at the sliders are read."""
    canvas, camera = view_of(viewer)
    dims = viewer.dims
    count, order = int(dims.ndim), [int(axis) for axis in dims.order]
    # axes before the last three are at their sliders, if they are not displayed
    lead = count - 3 if count > 3 and min(order[-int(dims.ndisplay) :]) >= count - 3 else 0
    layers = [_layer(layer, viewer, lead, camera) for layer in viewer.layers]
    shown = SimpleNamespace(
        ndisplay=int(dims.ndisplay),
        ndim=count - lead,
        order=tuple(axis - lead for axis in order if axis >= lead),
        point=tuple(float(place) for place in dims.point)[lead:],
        margins=(*getattr(dims, "margin_left", ()), *getattr(dims, "margin_right", ())),
    )
    extras, is_grid = _canvas_extras(viewer)
    return Snapshot(layers, camera, shown, canvas, _ground(viewer), extras, is_grid)


def view_of(viewer: Any) -> tuple[SimpleNamespace, SimpleNamespace]:
    """Size (height, width) of a viewer's canvas, and its camera."""
    canvas = getattr(viewer, "canvas", None)
    high, wide = canvas.size if canvas is not None else viewer._canvas_size
    scene = getattr(viewer, "scene", None)
    camera = scene.camera if scene is not None else viewer.camera
    directions = getattr(camera, "orientation", ("towards", "down", "right"))
    names = ("center", "view_direction", "up_direction")
    plain = {name: tuple(float(number) for number in getattr(camera, name)) for name in names}
    numbers = {name: float(getattr(camera, name)) for name in ("zoom", "perspective")}
    orientation = tuple(str(getattr(direction, "value", direction)) for direction in directions)
    size = SimpleNamespace(size=(float(high), float(wide)))
    return size, SimpleNamespace(**plain, **numbers, orientation=orientation)


def _canvas_extras(viewer: Any) -> tuple[tuple[str, ...], bool]:
    """Visible overlays, and whether there is a grid."""
    canvas = getattr(viewer, "canvas", None)
    overlays = getattr(canvas, "overlays", None)
    if canvas is None or overlays is None:
        shown = [name for key, name in OLD_EXTRAS.items() if _is_visible(viewer, key)]
        return tuple(shown), bool(getattr(getattr(viewer, "grid", None), "enabled", False))
    scene = getattr(getattr(viewer, "scene", None), "overlays", {})
    shown = [name for key, name in CANVAS_EXTRAS.items() if _is_visible(overlays, key) or _is_visible(scene, key)]
    return tuple(shown), bool(canvas.grid.enabled)


def _is_visible(holder: Any, key: str) -> bool:
    overlay = holder.get(key) if hasattr(holder, "get") else getattr(holder, key, None)
    return bool(getattr(overlay, "visible", False))


def _ground(viewer: Any) -> np.ndarray:
    theme = getattr(viewer, "theme", None)
    if theme is None:
        return np.zeros(3)
    from napari.utils.theme import get_theme

    return np.array(get_theme(theme).canvas.as_rgb_tuple()[:3], float) / 255


def _layer(layer: Any, viewer: Any, lead: int, camera: Any) -> LayerSnapshot:
    kind, shown = type(layer).__name__, bool(layer.visible)
    taken = LayerSnapshot(kind, str(layer.name), shown, rgb=bool(getattr(layer, "rgb", False)))
    if not shown:
        return taken
    taken.extras = tuple(name for key, name in LAYER_EXTRAS.items() if _is_visible(layer, key))
    if kind in SHAPES and hasattr(layer, "data"):
        taken.kind = "Mesh"
        taken.blending = str(layer.blending)
        taken.meshes, taken.notes = meshes_of(layer, np.asarray(viewer.dims.point, float), camera)
        taken.ndim = 3
    elif kind in FIELDS:
        _take_field(taken, layer, viewer, max(lead - (int(viewer.dims.ndim) - layer.ndim), 0))
    return taken


def _take_field(taken: LayerSnapshot, layer: Any, viewer: Any, lead: int) -> None:
    """Fills in a layer of voxels. lead: number of its first axes that are at their sliders."""
    finest = (layer.data[0] if layer.multiscale else layer.data).shape[: layer.ndim]
    data = _level(layer, int(viewer.dims.ndisplay))
    matrix = world_matrix(layer)
    point = np.asarray(viewer.dims.point, float)[-layer.ndim :]
    index = np.rint(np.asarray(layer.world_to_data(point), float))
    # levels fill the same box
    factor = np.array(finest) / np.array(data.shape[: layer.ndim])
    matrix[:-1, -1] += matrix[:-1, :-1] @ (factor / 2 - 0.5)
    matrix[:-1, :-1] *= factor
    picked = [round(float(np.clip((index[k] + 0.5) / factor[k] - 0.5, 0, data.shape[k] - 1))) for k in range(lead)]
    taken.data = np.asarray(data[tuple(picked)]) if picked or not isinstance(data, np.ndarray) else data
    taken.ndim = layer.ndim - lead
    keep = [*range(lead, layer.ndim), layer.ndim]
    matrix[:, -1] += matrix[:, :lead] @ np.array(picked)
    taken.matrix = matrix[np.ix_(keep, keep)]
    taken.opacity, taken.blending = float(layer.opacity), str(layer.blending)
    for name in LOOKS:
        usual = getattr(LayerSnapshot, name)
        value = getattr(layer, name, usual)
        setattr(taken, name, type(usual)(getattr(value, "value", value)))
    if taken.kind == "Labels" and not hasattr(layer, "rendering"):
        taken.rendering = "iso_categorical"
    units = getattr(layer, "units", None)
    taken.units = None if units is None else tuple(str(unit) for unit in units)[lead:]
    planes = getattr(layer, "experimental_clipping_planes", ())
    taken.experimental_clipping_planes = [_plane(plane) for plane in planes]
    taken.plane = _plane(layer.plane) if hasattr(layer, "plane") else None
    if taken.kind == "Labels":
        colors = {number: layer.get_color(number) for number in np.unique(taken.data).tolist()}
        taken.colors = {n: np.ravel(np.asarray(color, float)) for n, color in colors.items() if color is not None}
    elif not taken.rgb:
        low, high = layer.contrast_limits
        taken.contrast_limits = float(low), float(high)
        table = np.asarray(layer.colormap.map(np.linspace(0.0, 1.0, ENTRIES)), float)
        taken.colormap = ColorTable(str(layer.colormap.name), table)


def _level(layer: Any, shown_axes: int) -> Any:
    """Data of the level that is drawn: of a slice the viewer's, of a volume the finest of up to MOST_VOXELS voxels."""
    if not layer.multiscale:
        return layer.data
    if shown_axes == 2:
        return layer.data[int(getattr(layer, "data_level", 0))]
    fits = (data for data in layer.data if np.prod(data.shape[-3:], dtype=float) <= MOST_VOXELS)
    return next(fits, layer.data[-1])


def _plane(plane: Any) -> SimpleNamespace:
    place, normal = (tuple(float(number) for number in getattr(plane, name)) for name in ("position", "normal"))
    enabled, thickness = bool(getattr(plane, "enabled", True)), float(getattr(plane, "thickness", 1.0))
    return SimpleNamespace(position=place, normal=normal, enabled=enabled, thickness=thickness)
