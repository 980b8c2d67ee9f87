"""Small pictures of volumes, transfer functions and scenes, which notebooks show for objects at the end of a cell."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np

from splatgl.data.image import Image
from splatgl.data.volume import Volume, halve_volume
from splatgl.errors import InputError
from splatgl.geometry.camera import Camera
from splatgl.gl.renderer import Renderer, shared_renderer
from splatgl.planning.scene import Scene
from splatgl.splat.settings import LENIENT, Settings
from splatgl.transfer.statistics import without_outlier_values
from splatgl.transfer.transfer import Transfer

# side of a picture, pixels; size of that of a transfer function
SIDE, BAR = 192, (240, 48)
# most voxels of a layer that is drawn, and of a volume that is read for it
MOST_VOXELS, MOST_READ = 2**18, 2**26
# degrees to the right of the front, and above
AZIMUTH, ELEVATION = 30.0, 20.0
# light of the checks behind a transfer function, and their side in pixels
LIGHT, DARK, CHECK = 0.6, 0.35, 6


def volume_html(volume: Volume) -> str:
    """A picture of a volume in its default transfer function, unless it takes long to read, next to a table of
    facts.
    """
    facts = list(volume.facts)
    try:
        small = None if volume.points is not None else reduce_volume(volume)
        png = None if small is None else _draw(Scene([small]))
    except InputError as error:
        png, facts = None, [*facts, ("no picture", str(error))]
    source = f"data:image/png;base64,{b64encode(png).decode()}" if png else ""
    name = escape(volume.name or "Volume")
    picture = f'<img src="{source}" width="{SIDE}" height="{SIDE}" alt="picture of {name}">' if png else ""
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in facts)
    table = f"<table><caption>{name}</caption>{rows}</table>"
    return f'<div style="display: flex; gap: 1em; align-items: center">{picture}{table}</div>'


def scene_png(scene: Scene) -> bytes | None:
    """PNG of a scene from the front, right and above; None of one that takes long to read."""
    layers = []
    for layer in scene.shown:
        small = reduce_volume(layer.volume)
        if small is None:
            return None
        # surfaces are among the meshes
        is_clear = layer.only_slices or layer.surfaces is not None
        layers.append(replace(layer, volume=small, surfaces=None, only_slices=is_clear, held=None))
    return _draw(Scene(layers, scene.clip, scene.meshes))


def transfer_png(transfer: Transfer) -> bytes:
    """PNG of the colours of a transfer function over a checkerboard, which shows through where it is less opaque."""
    width, height = BAR
    if transfer.labels:
        numbers = np.array([number for number, _, _ in transfer.labels], float)
        values = numbers[np.arange(width) * len(numbers) // width]
    else:
        low, high = transfer.color_range
        ends = [low, high, transfer.points[0][0], transfer.points[-1][0]]
        space = np.geomspace if transfer.logarithmic else np.linspace
        values = space(min(ends), max(ends), width)
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    checks = np.where((column // CHECK + row // CHECK) % 2, LIGHT, DARK)[..., None]
    opacity = np.asarray(transfer.opacity(values))
    # the lower half is opaque; above, the height of the curve is the opacity
    share = np.where(row >= height // 2, 1.0, np.where(height // 2 - row <= opacity * height / 2, 1.0, opacity * 0.5))
    rgb = transfer.color(values) * share[..., None] + checks * (1 - share[..., None])
    return Image(np.concatenate([rgb, np.ones((height, width, 1))], axis=2).astype(np.float32))._repr_png_()


def reduce_volume(volume: Volume) -> Volume | None:
    """The volume with at most MOST_VOXELS voxels; None if more than MOST_READ would be read."""
    small = min((volume, *volume.coarser), key=lambda level: (level.count > MOST_READ, -level.count))
    if small.count > MOST_READ:
        return None
    small = without_outlier_values(replace(small, coarser=(), samples=np.asarray(small.samples[:])))
    while small.count > MOST_VOXELS:
        small = halve_volume(small)
    return small


def _draw(scene: Scene) -> bytes:
    """PNG of a scene on black."""
    with shared_renderer() as renderer:
        image = draw_small(renderer, scene, Camera.orbit(scene, AZIMUTH, ELEVATION, size=(SIDE, SIDE)))
    return image.encoded(Path("image.png"), 8)


def draw_small(renderer: Renderer, scene: Scene, camera: Camera, is_quick: bool = False) -> Image:
    """Picture of a scene on black. is_quick: with one sample a pixel."""
    settings = Settings(background="black", tolerance=LENIENT, antialias="off" if is_quick else "auto")
    return renderer.render(scene, camera, settings, verify_bound=False)
