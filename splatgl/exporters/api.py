"""`sg.export`: a page that turns in a browser, splats as 3-D Gaussians, or surfaces as glTF."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, overload

import numpy as np

from splatgl.coercion import public
from splatgl.errors import expected
from splatgl.fileio import check_output, check_source, format_bytes, within, write_file
from splatgl.options import HelpGroup, OptionGroup, ValueKind, check_options, keywords_of, names_of, option
from splatgl.scene.api import opened, scene_of, with_groups
from splatgl.scene.draw import DrawOptions, SubjectView, bytes_kind
from splatgl.scene.open_scene import OpenScene

if TYPE_CHECKING:
    from splatgl.exporters.page import WebPage
    from splatgl.geometry.camera import Camera
    from splatgl.keywords import ExportKeywords
    from splatgl.splat.settings import Settings
    from splatgl.transfer.transfer import Transfer

# endings of files, by format
FORMATS = {"html": (".html", ".htm"), "ply": (".ply",), "spz": (".spz",), "glb": (".glb",)}
# default and largest numbers of splats, and default size of a page
SPLATS, MOST_SPLATS, MOST_BYTES = 400_000, 2**24, 10 * 10**6


@dataclass(frozen=True)
class ExportOptions:
    """Options of `splatgl export` beside those of pictures."""

    format: str | None = option(
        None,
        ValueKind.choice(tuple(FORMATS)),
        "format (default: by the ending): html, a page; ply, spz: 3-D Gaussians; glb: surfaces",
        group=HelpGroup.EXPORT,
        metavar="NAME",
    )
    splats: int = option(
        SPLATS,
        ValueKind.whole(1, MOST_SPLATS),
        "maximum number of splats, to which voxels are joined",
        group=HelpGroup.EXPORT,
    )
    bits: int = option(8, ValueKind.one_of(8, 16), "bits of values in a page (default 8)", group=HelpGroup.EXPORT)
    max_size: int = option(
        MOST_BYTES,
        bytes_kind(1, "10MB"),
        "maximum size of a page, such as 3MB (default 10MB)",
        group=HelpGroup.EXPORT,
    )

    def __post_init__(self) -> None:
        check_options(self)

    def check(self, path: Path, *sources: str | None) -> str:
        """The format of a file. Raises InputError, before any work, for a file that cannot be written."""
        suffix = path.suffix.lower()
        known = {ending: name for name, endings in FORMATS.items() for ending in endings}
        check_output(path, (suffix,) if self.format else tuple(known))
        check_source(path, *sources)
        return self.format or known[suffix]


@overload
def export(
    x: Any,
    path: str | Path,
    transfer: Any = None,
    camera: Any = None,
    settings: Any = None,
    **options: Unpack[ExportKeywords],
) -> Path: ...


@overload
def export(
    x: Any,
    path: None = None,
    transfer: Any = None,
    camera: Any = None,
    settings: Any = None,
    **options: Unpack[ExportKeywords],
) -> WebPage: ...


@with_groups(keywords_of(ExportOptions))
@public
def export(
    x: Any,
    path: str | Path | None = None,
    transfer: Transfer | OptionGroup | str | Mapping[str, Any] | None = None,
    camera: Camera | OptionGroup | Any | None = None,
    settings: Settings | OptionGroup | Any | None = None,
    **options: Unpack[ExportKeywords],
) -> Path | WebPage:
    """Writes `x` as a page that turns in any browser (.html), as 3-D Gaussians (.ply, .spz), or its iso-surfaces,
    meshes and streamlines as glTF (.glb); returns the path. Without a path it returns the page, which a notebook shows
    and keeps.

    x, transfer, camera, settings: as of `render`. options: those of `render`, and format (html, ply, spz or glb; by
    default by the ending), splats (at most, 400,000 by default: more voxels are joined to larger splats), bits (8 or
    16, of values in a page), max_size (bytes of a page, 10 MB by default). The page states its error against the
    default picture. Raises InputError as `render`, for a file that cannot be written, for more splats than asked for
    that cannot be joined, such as points, for a larger page, and for nothing to write.

    ```python
    sg.export("head.nii.gz", "head.html", azimuth=60)
    sg.export("head.nii.gz", splats=100_000)  # in a notebook
    ```
    """
    given: dict[str, Any] = {**options}
    own = ExportOptions(**{name: given.pop(name) for name in names_of(ExportOptions) if name in given})
    target, source = None if path is None else Path(path), str(x) if isinstance(x, str | Path) else None
    if target is not None:
        own.check(target, source)
    elif own.format not in (None, "html"):
        raise expected("path", "a file to write", "none", "without one there are pages alone")
    shown = [f"{name}={value!r}" for name, value in options.items() if isinstance(value, str | int | float)]
    words = [repr(Path(source).name) if source else "…", *([repr(target.name)] if target else []), *shown]
    how = DrawOptions(is_shared=True, memory=given.get("memory"))
    with within(how.memory):
        scene = opened(scene_of(x, transfer, camera, settings, given))
        exporter = Exporter(scene, own, how, f"sg.export({', '.join(words)})")
        if target is None:
            return exporter.page()
        exporter.write(target)
    return target


@dataclass(frozen=True)
class Exporter:
    """Writes a scene. command: that a page names. tell: is called with lines on a file, before it is written."""

    scene: OpenScene | SubjectView
    options: ExportOptions
    how: DrawOptions
    command: str
    tell: Callable[[str], None] = lambda line: None

    def write(self, path: Path) -> None:
        """Writes a file, or nothing. Raises InputError as `export`."""
        kind = self.options.check(path)
        if kind == "glb":
            self._write_surfaces(path)
        else:
            write_file(path, self.page().html.encode() if kind == "html" else self._gaussians(kind))

    def page(self) -> WebPage:
        """The page of the scene. Raises InputError for a larger one than options allow."""
        from splatgl.exporters.page import WebPage

        options = self.options
        page = WebPage.of(self.scene, self.how, options.splats, options.bits, self.command)
        for line in (page.summary, *page.notes):
            self.tell(line)
        if (size := len(page.html.encode())) > options.max_size:
            this = f"a page of at most {format_bytes(options.max_size)}"
            raise expected("max_size", this, format_bytes(size), "lower --splats, or raise --max-size")
        return page

    def _gaussians(self, kind: str) -> bytes:
        """The splats as 3-D Gaussians, lit as in the view; kind: ply or spz."""
        from splatgl.exporters.layers import join_layers
        from splatgl.exporters.page import page_settings
        from splatgl.planning.plan import plan
        from splatgl.splat.lighting import surface_light
        from splatgl.writers.gaussians import Gaussians

        if not self.scene.settings.hides:
            raise expected("blend of Gaussians", "composite", self.scene.settings.blend)
        notes, settings, camera = list[str](), page_settings(self.scene.settings), self.scene.camera
        splats = join_layers(self.scene, settings, self.options.splats, notes)
        planned = plan(splats.outline, camera, settings)
        light, model = np.ones(len(splats)), planned.program.appearance.light
        if planned.program.appearance.shading:
            along = splats.world - camera.eye if camera.perspective else np.tile(camera.forward, (len(splats), 1))
            along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-30)
            light = surface_light(splats.column("normal"), along, model, model.within(camera))[0]
        found = Gaussians.of(splats, planned.kernel, light)
        shape = f"footprints within {found.rmse:.1%} of the peak (RMSE) of those of kernel {planned.kernel.name}"
        for line in (f"{splats.counted(' 3-D Gaussians')}, lit as in the first view; {shape}", *notes):
            self.tell(line)
        return found.ply() if kind == "ply" else found.spz()

    def _write_surfaces(self, path: Path) -> None:
        """Writes iso-surfaces, meshes and streamlines. Raises InputError if there are none."""
        from splatgl.exporters.layers import layers_of
        from splatgl.planning.scene import Scene
        from splatgl.writers.surface import iso_mesh, save_meshes

        subject = layers_of(self.scene)
        meshes = list(subject.surfaces(self.scene.settings)) if isinstance(subject, Scene) else []
        for layer in subject.shown if isinstance(subject, Scene) else ():
            for surface in layer.faded.iso:
                color = surface.color or layer.faded.color(surface.value).tolist()
                mesh, name = iso_mesh(layer.volume, surface.value), f"{layer.volume.name} {surface.value:g}".strip()
                meshes.append(replace(mesh, color=color, opacity=surface.opacity, name=name))
        if not meshes:
            fix = "--iso VALUE, --surfaces, --mesh or --streamlines adds some"
            raise expected(path, "iso-surfaces, meshes or streamlines", "none", fix)
        save_meshes(meshes, path)
        self.tell(f"{len(meshes)} surface{'s' * (len(meshes) != 1)}, {sum(map(len, meshes)):,} triangles")
