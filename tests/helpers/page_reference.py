"""Reads a page of `splatgl export` and draws its splats in float64, by the equations alone; runs it in Chromium."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import zlib
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np


def part(html: str, name: str) -> str:
    """The text of a script element of a page."""
    found = re.search(rf'<script type="[a-z/]+" id="{name}">(.*?)</script>', html, re.DOTALL)
    assert found is not None
    return found[1].strip()


class PageSplats:
    """The splats of a page: position [N, 3] (x, y, z) in cells, color [N, 3] linear, depth [N] per mean spacing, size
    [N] in cells, normal [N, 3], layer [N]: its number, world [N, 3].
    """

    def __init__(self, html: str) -> None:
        self.scene: dict[str, Any] = json.loads(part(html, "scene"))
        count = self.scene["count"]
        planes = np.frombuffer(zlib.decompress(base64.b64decode(part(html, "splats"))), np.uint8).reshape(-1, count)
        byte = planes.T.astype(np.int64)
        byte[:, 6] ^= byte[:, 7]
        halves = byte[:, 0:6:2] + 256 * byte[:, 1:6:2]
        self.steps = np.cumsum(halves, axis=0) % 65536
        self.position = self.steps * self.scene["step"]
        grid = self.scene["grid"]
        self.world = self.position @ np.array(grid["matrix"]).T + grid["origin"]
        self.size = 2.0 ** (byte[:, 11] & 7)
        layer = byte[:, 11] >> 3
        tables = np.stack(
            [
                np.frombuffer(base64.b64decode(each["table"]), "<f4").reshape(-1, 4).astype(np.float64)
                for each in self.scene["layers"]
            ]
        )
        place = (byte[:, 6] + 256 * byte[:, 7]) / 65535 * 255
        low = np.minimum(place.astype(int), 254)
        matter = tables[layer, low] + (place - low)[:, None] * (tables[layer, low + 1] - tables[layer, low])
        own = byte[:, 12:15] / 255
        own = np.where(own <= 0.04045, own / 12.92, ((own + 0.055) / 1.055) ** 2.4)
        self.color = np.where(byte[:, 15:] > 0, own, matter[:, :3])
        self.depth = matter[:, 3] * 2.0 ** ((64 - byte[:, 10]) / 16)
        self.layer, self.normal = layer, octahedral_normal(byte[:, 8:10])


def octahedral_normal(code: np.ndarray) -> np.ndarray:
    """Unit vectors [N, 3] of two bytes [N, 2]; zeros of zeros."""
    f = (code.astype(np.float64) - 128) / 127
    n = np.concatenate([f, 1 - np.abs(f).sum(axis=1, keepdims=True)], axis=1)
    over = np.maximum(-n[:, 2:], 0)
    n[:, :2] -= np.where(n[:, :2] >= 0, over, -over)
    return np.where(code.any(axis=1, keepdims=True), n / np.linalg.norm(n, axis=1, keepdims=True), 0.0)


def draw(page: PageSplats, camera: dict[str, Any], kernel: Any, antialias: bool = True) -> np.ndarray:
    """Linear premultiplied float64 [H, W, 4] of a camera as page.js has it: every splat 'over' those behind it, or the
    maximum of all.
    """
    grid, (width, height) = page.scene["grid"], camera["size"]
    turn, spacing = np.array(camera["axes"]), grid["spacing"]
    a = turn @ np.array(grid["matrix"]) / spacing
    eye = np.linalg.solve(np.array(grid["matrix"]), np.array(camera["eye"]) - grid["origin"])
    pitch = camera["extent"] / height / (1 if camera["perspective"] else spacing)
    v = (page.position - eye) @ a.T
    x, y = ((np.arange(n) + 0.5 - n / 2) * pitch for n in (width, height))
    picture = np.zeros((height, width, 4))
    for n in order_of(page, camera, eye):
        toward = v[n] / np.linalg.norm(v[n]) if camera["perspective"] else np.array([0.0, 0.0, 1.0])
        e = np.linalg.svd(toward[None])[2][1:]
        projected = e @ a * page.size[n]
        vectors, widths, _ = np.linalg.svd(projected)
        axes = vectors.T @ e
        pixel = pitch * (max(v[n, 2], 0) if camera["perspective"] else 1)
        sizes = np.maximum(widths[:2], pixel if antialias else 0)
        # a box of pixels around the splat
        z = v[n, 2] if camera["perspective"] else 1.0
        reach = 1.5 * sizes.max() * kernel.radius / z + 2 * pitch
        columns = np.flatnonzero(np.abs(x - v[n, 0] / z) < reach)
        rows = np.flatnonzero(np.abs(y - v[n, 1] / z) < reach)
        if not len(columns) or not len(rows) or (camera["perspective"] and z <= 0):
            continue
        box = np.ix_(rows, columns)
        ray = np.stack(np.broadcast_arrays(x[None, columns], y[rows, None], 1.0), axis=-1)
        if camera["perspective"]:
            offset = ray * ((v[n] @ toward) / (ray @ toward))[..., None] - v[n]
        else:
            offset = ray - [v[n, 0], v[n, 1], 1.0]
        r = np.hypot(*((offset @ axes[k]) / sizes[k] for k in range(2)))
        tau = page.depth[n] * page.size[n] ** 3 / sizes.prod() * kernel.footprint(r)
        share = widths[:2].prod() / sizes.prod()
        opacity = share * -np.expm1(-tau / share)
        if page.scene["maximum"]:
            weight = np.clip(2.5 * kernel.footprint(r) / kernel.footprint(np.zeros(())) - 0.3, 0, 1)
            opacity = -np.expm1(-page.depth[n]) * weight
        normal = turn @ page.normal[n]
        light = 0.3 + 0.7 * abs(normal @ toward) if normal.any() and not page.scene["maximum"] else 1.0
        light_of = opacity[..., None] * np.append(page.color[n] * light, 1.0)
        behind = picture[box]
        picture[box] = (
            np.maximum(behind, light_of) if page.scene["maximum"] else (1 - opacity[..., None]) * behind + light_of
        )
    return picture


def order_of(page: PageSplats, camera: dict[str, Any], eye: np.ndarray) -> list[int]:
    """Numbers of the splats from back to front: planes across the main axis, rows, cells; each from both ends."""
    back = np.linalg.inv(page.scene["grid"]["matrix"])
    view = back @ np.array(camera["axes"])[2]
    across = np.abs(view) / np.linalg.norm(back, axis=1)
    outer = max((2, 1, 0), key=lambda axis: (across[axis], axis))
    keys = [outer, *(axis for axis in (2, 1, 0) if axis != outer)]
    at = eye / page.scene["step"] if camera["perspective"] else np.where(view >= 0, -np.inf, np.inf)

    def key(n: int) -> tuple[float, ...]:
        place = [float(s) if s <= limit else 1e6 - s for s, limit in zip(page.steps[n], at, strict=True)]
        first = n if page.steps[n][keys[2]] <= at[keys[2]] else -n
        return (*(place[axis] for axis in keys), first)

    return sorted(range(len(page.steps)), key=key)


BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = [
    *("--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--dump-dom", "--virtual-time-budget=100000"),
]


def in_browser(html: str, script: str, folder: Path) -> Any:
    """What a script returns, an async function body with `view` and `scene`, in a page in Chromium: JSON."""
    assert BROWSER is not None
    code = f"""<pre id="result"></pre><script type="module">
    const view = await globalThis.splatgl, scene = view.scene;
    const run = async () => {{ {script} }};
    const encode = (value) => btoa(encodeURIComponent(JSON.stringify(value)));
    document.getElementById("result").textContent =
      "result:" + encode(await run().catch((error) => ({{ error: String(error.stack) }})));
    </script></html>"""
    (folder / "page.html").write_text(html.replace("</html>", code), encoding="utf-8")
    command = [BROWSER, *FLAGS, f"--user-data-dir={folder / 'user'}", (folder / "page.html").as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=600).stdout
    found = re.search(r"result:([\w+/=]+)<", shown)
    assert found is not None, shown[-2000:]
    value = json.loads(unquote(base64.b64decode(found[1]).decode()))
    assert not (isinstance(value, dict) and "error" in value), value
    return value
