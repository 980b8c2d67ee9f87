"""Draws pictures of every kind by the present OpenGL driver, and compares the pictures of several drivers.

    python scripts/driver_table.py draw FOLDER [--size 128] [--voxels 20] [NAME…]   # FOLDER/NAME.npy and times.json
    python scripts/driver_table.py compare FOLDER…     # Markdown table: each folder's pictures against the first's

Names: PICTURES below; without names all of them are drawn. For older or other drivers, set Mesa's variables, such as
MESA_GL_VERSION_OVERRIDE=3.3 MESA_GLSL_VERSION_OVERRIDE=330, GALLIUM_DRIVER=softpipe, or, for Zink,
MESA_LOADER_DRIVER_OVERRIDE=zink LIBGL_ALWAYS_SOFTWARE=1.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import splatgl as sg
from splatgl.data.mask import apply_mask, make_mask
from splatgl.data.volume import Label
from splatgl.distributed.render import join_samples
from splatgl.fileio import write_file
from splatgl.gl.renderer import shared_renderer
from splatgl.gl.shader import ShaderError
from splatgl.planning.bricks import Bricks, required_bricks
from splatgl.scene.api import scene_of
from splatgl.scene.scene_file import SceneFile

# settings of pictures of the volume; `like` and `motion` are handled in `of_settings`
SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    **{blend: {"blend": blend} for blend in ("xray", "mip", "minip", "mean")},
    "lit": {"light": "glossy", "light_from": (40.0, 30.0)},
    "cues": {"ambient_occlusion": 0.6, "shadows": 0.7},
    "clip": {"clip": ((1.0, 0.3, 0.0, 0.4), (-1.0, 0.0, 0.2, -0.9))},
    "fine": {"tolerance": 1e-4, "sheets": 4, "steps": 8},
    "voxels": {"classification": "pre"},
    "0.1": {"like": "0.1"},
    "table": {"like": "0.1", "align": "hybrid", "footprint": "table", "table_bits": 8, "attenuation": "opacity"},
    "half": {"like": "0.1", "target": "rgba16f"},
    "filled": {"attenuation": "fill", "antialias": "paper"},
    "moments": {"moments": 3, "spin": 20.0},
    "streaks": {"like": "0.1", "motion": "exact", "spin": 20.0},
    "white": {"background": (1.0, 1.0, 1.0)},
}


@dataclass(frozen=True)
class Subject:
    """What is drawn. size: of the pictures. voxels: along the volume's sides."""

    size: tuple[int, int] = (128, 128)
    voxels: int = 20

    @cached_property
    def volume(self) -> sg.Volume:
        """A noisy ball."""
        n = self.voxels
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, n)] * 3, indexing="ij"))
        noise = 0.1 * np.random.default_rng(1).random((n, n, n))
        return sg.Volume(np.float32(np.clip(1.3 - np.sqrt((grid**2).sum(axis=0)), 0, 1) + noise), name="ball")

    @cached_property
    def segments(self) -> sg.Volume:
        """Two labelled blocks."""
        labels, low, middle, high = np.zeros((self.voxels,) * 3, np.uint8), *(self.voxels * np.array([2, 5, 8]) // 10)
        labels[low:middle, low:high, low : high - 1], labels[middle + 1 : high + 1, low:high, low : high - 1] = 1, 2
        return sg.Volume(labels, name="segments", labels=(Label(1, "a", "#ff0000"), Label(2, "b", "#00ff00")))

    @cached_property
    def other(self) -> sg.Volume:
        """A volume of long voxels across the ball, off its grid."""
        ramp = np.linspace(0, 1, self.voxels // 2, dtype=np.float32)
        samples = np.float32(1.0) - np.abs(ramp[:, None, None] - ramp[None, :, None]) + 0.0 * ramp
        return sg.Volume(samples, spacing=(1.1, 1.7, 2.3), origin=(1.3, -0.4, 0.9), name="slope")

    transfer = sg.Transfer([(0.35, 0.0), (0.7, 0.4), (1.0, 0.9)], colormap="bone", shading=True)
    dark = sg.Transfer([(0.0, 0.9), (0.2, 0.0)], colormap="bone")
    hot = sg.Transfer([(0.5, 0.0), (1.0, 0.5)], colormap="hot")

    @cached_property
    def camera(self) -> sg.Camera:
        """The common view."""
        return sg.Camera.orbit(self.volume, azimuth=30, elevation=20, size=self.size)

    @cached_property
    def inside(self) -> sg.Camera:
        """A view from inside the volume."""
        n = self.voxels
        return sg.Camera.look_at((0.5 * n, 0.5 * n, 0.5 * n), (0.7 * n, 0.6 * n, 0.55 * n), (0, 0, 1), 60, self.size)

    @cached_property
    def splats(self) -> sg.Splats:
        """The ball's splats."""
        return sg.extract(self.volume, self.transfer)

    def values(self, name: str) -> sg.Splats:
        """The splats of one of SETTINGS; the least values are those around the ball."""
        return sg.extract(self.volume, self.dark) if name == "minip" else self.splats

    @cached_property
    def layers(self) -> list[sg.Layer]:
        """The ball, the labelled blocks, and the volume of long voxels."""
        labels = sg.default_transfer(self.segments)
        return [sg.Layer(self.volume, self.transfer), sg.Layer(self.segments, labels), sg.Layer(self.other, self.hot)]

    @cached_property
    def meshes(self) -> list[sg.Mesh]:
        """Two clear triangles and an opaque one through the volume."""
        corners = self.voxels / 10 * np.array([[1, 1, 4], [9, 2, 5], [5, 9, 6.0]])
        faces, shift = np.array([[0, 1, 2]]), self.voxels / 10 * np.array([0.0, 0.0, 1.5])
        colors = ("#ff4020", "#40ff20")
        clear = [sg.Mesh(corners + n * shift, faces, color=color, opacity=0.5) for n, color in enumerate(colors)]
        return [*clear, sg.Mesh(corners - 2 * shift, faces, color="#4060ff")]

    def settings(self, name: str) -> tuple[sg.Settings, sg.Motion | None]:
        """Settings and motion of one of SETTINGS."""
        changes = dict(SETTINGS[name])
        settings = sg.Settings.like("0.1") if changes.pop("like", None) else sg.Settings()
        spin = changes.pop("spin", None)
        if "clip" in changes:
            changes["clip"] = tuple((*plane[:3], plane[3] * self.voxels) for plane in changes["clip"])
        return settings.replace(**changes), sg.Motion(spin=(0, 0, spin)) if spin else None

    def scene(self, name: str) -> tuple[sg.Splats | sg.Scene, sg.Camera, sg.Settings]:
        """Subject, camera and settings of one of SCENES, which `reference.render` draws too."""
        plain, ball = sg.Settings(), self.layers[:1]
        masked = apply_mask(self.volume, make_mask(self.segments.samples > 0, self.volume))
        labels = sg.extract(self.segments, sg.default_transfer(self.segments))
        return {
            "mask": (sg.extract(masked, self.transfer), self.camera, plain.replace(shadows=0.5)),
            "labels": (labels, self.camera, plain),
            "inside": (self.splats, self.inside, plain),
            "parallel": (self.splats, self.camera.parallel(self.volume), plain),
            "layers": (sg.Scene(self.layers), self.camera, plain),
            "layers inside": (sg.Scene(self.layers), self.inside, plain),
            "layers parallel": (sg.Scene(self.layers), self.camera.parallel(self.volume), plain),
            "layers of voxels": (sg.Scene(self.layers), self.camera, plain.replace(classification="pre")),
            "layers' sums": (sg.Scene(self.layers), self.camera, plain.replace(blend="xray")),
            "meshes": (sg.Scene(ball, meshes=self.meshes), self.camera, plain),
            "meshes, labels": (sg.Scene(self.layers[1:2], meshes=self.meshes), self.camera, plain),
            "meshes, voxels": (sg.Scene(ball, meshes=self.meshes), self.camera, plain.replace(classification="pre")),
            "meshes, layers": (sg.Scene(self.layers, meshes=self.meshes), self.camera, plain),
        }[name]


SCENES = ("mask", "labels", "inside", "parallel", "layers", "layers inside", "layers parallel", "layers of voxels")
SCENES += ("layers' sums", "meshes", "meshes, labels", "meshes, voxels", "meshes, layers")


def draw_settings(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    settings, motion = subject.settings(name)
    return renderer.render(subject.values(name), subject.camera, settings, motion).pixels


def draw_scene(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    return renderer.render(*subject.scene(name)).pixels


def bricks_of(subject: Subject, settings: sg.Settings) -> Bricks:
    bricks = required_bricks(subject.volume, subject.transfer, settings)
    return Bricks.of(bricks.volume, bricks.post, side=-(-subject.voxels // 3))


def draw_bricks(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    settings = sg.Settings(blend="mip" if "mip" in name else "composite")
    camera = subject.inside if "inside" in name else subject.camera
    return renderer.render_bricks(bricks_of(subject, settings), camera, settings, bands=2).pixels


def draw_parts(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    """Two shells of sheets, drawn apart and joined, as a cluster's workers draw them."""
    settings = sg.Settings(blend="mip" if "mip" in name else "composite")
    bricks = bricks_of(subject, settings)
    plan = renderer.plan_bricks(bricks, subject.camera, settings)
    assert plan.resolved.sheets is not None
    shells = bricks.shells(plan.resolved.sheets, plan.view, 2)
    parts = [bricks.within(plan.resolved.sheets, plan.view, shell) for shell in shells]
    near, far = (renderer.render_part(part, subject.camera, settings) for part in parts)
    joined = join_samples(plan.program.appearance.join, near, far)
    return renderer.render_joined(bricks, subject.camera, settings, joined, 0).pixels


def draw_depth(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    camera = sg.Camera.orbit(subject.volume, azimuth=30, elevation=20, size=(24, 24))
    return sg.depth_map(subject.volume, subject.transfer, camera)


def draw_pick(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    width, height = subject.size
    picked = sg.pick(sg.Scene(subject.layers), subject.camera, (width // 2, height // 2))
    return np.array(picked.place if picked else ())


def draw_notebook(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    """The full picture of a notebook's view, sRGB."""
    from splatgl.viewer.notebook import Session

    session = Session(scene_of(subject.volume, subject.transfer, None, None, {"size": subject.size}))
    return finished(
        lambda: session.frame() is None and session.seconds_until_due() is None, lambda: session.image.pixels
    )


def draw_window(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    """The viewer's window, sRGB; it may be drawn by another driver than pictures."""
    from splatgl.viewer.document import Document
    from splatgl.viewer.viewer import Options, Viewer

    with TemporaryDirectory() as folder, sg.Renderer("window") as opened:
        np.save(f"{folder}/ball.npy", subject.volume.samples)
        viewer = Viewer(Document.open(SceneFile(f"{folder}/ball.npy")), opened, Options(size=subject.size))
        try:
            return finished(
                lambda: viewer.painter.frame is not None and viewer.painter.frame.full and not viewer.busy,
                lambda: viewer.shot().astype(np.float32) / 255,
                viewer.step,
            )
        finally:
            viewer.close()


def finished(is_done: Callable[[], bool], result: Callable[[], np.ndarray], step: Any = lambda: None) -> np.ndarray:
    """The result once a view of frames is done."""
    step()
    while not is_done():
        step()
        time.sleep(0.01)
    return result()


def draw_plotter(subject: Subject, renderer: sg.Renderer, name: str) -> np.ndarray:
    """The volume and a mesh of a PyVista plotter."""
    plotter = sg.Scene(subject.layers[:1], meshes=subject.meshes[2:]).to_pyvista(subject.camera, off_screen=True)
    try:
        return sg.render(plotter, size=subject.size).pixels
    finally:
        plotter.close()


PICTURES: dict[str, Callable[[Subject, sg.Renderer, str], np.ndarray]] = {
    **dict.fromkeys(SETTINGS, draw_settings),
    **dict.fromkeys(SCENES, draw_scene),
    **dict.fromkeys(("bricks", "bricks, mip", "bricks inside"), draw_bricks),
    **dict.fromkeys(("parts", "parts, mip"), draw_parts),
    "depth": draw_depth,
    "pick": draw_pick,
    "notebook": draw_notebook,
    "window": draw_window,
    "PyVista": draw_plotter,
}
# largest difference of linear colours that no 8-bit picture shows as more than two levels
ALLOWED = 2 / 255


def draw(folder: Path, subject: Subject, names: Sequence[str]) -> None:
    """Draws each picture twice into a folder, with seconds of the second time, or the reason why it is refused."""
    folder.mkdir(parents=True, exist_ok=True)
    with shared_renderer() as renderer:
        times = folder / "times.json"
        results: dict[str, Any] = json.loads(times.read_text()) if times.exists() else {}
        results["driver"] = str(renderer.info)
        print(renderer.info)
        for name in names or PICTURES:
            try:
                PICTURES[name](subject, renderer, name)
                started = time.perf_counter()
                pixels = PICTURES[name](subject, renderer, name)
                results[name] = time.perf_counter() - started
                np.save(folder / f"{name}.npy", pixels)
            except (sg.InputError, ShaderError, ImportError) as error:
                results[name] = str(error).splitlines()[0]
                print(f"{name}: {results[name]}")
            # after each: a driver may end the process
            write_file(times, json.dumps(results, indent=1).encode())


def compare(folders: Sequence[Path]) -> str:
    """A Markdown table of each folder's largest differences from the first folder, and of times."""
    results = [json.loads((folder / "times.json").read_text()) for folder in folders]
    lines = [f"* {folder.name}: {result['driver']}" for folder, result in zip(folders, results, strict=True)]
    names = [name for name in PICTURES if isinstance(results[0].get(name), float)]
    lines += ["", "| picture | " + " | ".join(folder.name for folder in folders) + " |"]
    lines += ["|---" * (len(folders) + 1) + "|"]
    for name in names:
        right = np.nan_to_num(np.load(folders[0] / f"{name}.npy"))
        cells = [f"{results[0][name]:.3f} s"]
        for folder, result in zip(folders[1:], results[1:], strict=True):
            if not isinstance(result.get(name), float):
                cells.append(result.get(name, "not drawn"))
                continue
            # sums are relative to their largest
            scale = max(float(np.abs(right).max()), 1.0) if "sums" in name or name == "xray" else 1.0
            apart = float(np.abs(np.nan_to_num(np.load(folder / f"{name}.npy")) - right).max()) / scale
            cells.append(f"{'**' * (apart > ALLOWED)}{apart:.1e}{'**' * (apart > ALLOWED)}, {result[name]:.3f} s")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    drawing, comparing = (commands.add_parser(name, allow_abbrev=False) for name in ("draw", "compare"))
    drawing.add_argument("folder", type=Path)
    drawing.add_argument("names", nargs="*", metavar="NAME")
    drawing.add_argument("--size", type=int, default=128)
    drawing.add_argument("--voxels", type=int, default=20)
    comparing.add_argument("folders", type=Path, nargs="+")
    args = parser.parse_args()
    if args.command == "draw":
        draw(args.folder, Subject((args.size, args.size), args.voxels), args.names)
    else:
        print(compare(args.folders))


if __name__ == "__main__":
    main()
