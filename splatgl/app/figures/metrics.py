"""Metrics of the rendered figures: aliasing, error against the reference, flicker and popping."""

from __future__ import annotations

import numpy as np

from splatgl.app.figures.render import Shown
from splatgl.splat.motion import Moments, streaks
from splatgl.truth.aliasing import (
    Reach,
    aliasing_energy,
    differing_before,
    finer,
    mean_square,
    noise_ratio,
    share_beyond,
)
from splatgl.truth.figures.tables import Table
from splatgl.truth.flicker import flicker, popping

# configurations for aliasing: blend mode, kernel, and attenuations beyond z_k, of which X-rays have one
KINDS = (
    ("xray", "crawfis-max", ("auto",)),
    ("xray", "gaussian", ("auto",)),
    ("composite", "crawfis-max", ("opacity", "optical-depth", "fill")),
)
# rotations per frame for flicker, degrees; and the number of frames for figures that are not strips
PACES, FRAMES = (1.0, 5.0), 24
# shutter angle of the figures in degrees, and moments of the reference
SHUTTER, TIMES = 180.0, 16

Rows = list[tuple[str, str, str]]


def numbers(shown: Shown) -> Table:
    """The figure's metrics."""
    rows = [("beyond z_k", f"{100 * share_beyond(shown.splats, shown.camera):.1f} % of {len(shown.splats)} splats", "")]
    if shown.figure.number != 14:
        rows += _still(shown)
    if shown.figure.spin:
        rows += _moving(shown)
    return Table(("what", "value", "against standard"), tuple(rows))


def _still(shown: Shown) -> Rows:
    """Aliasing beyond z_k, error against the supersampled image, and pixels that are unchanged."""
    draw, splats, camera = shown.draw, shown.splats, shown.camera
    reach = Reach.of(draw, splats, camera)
    window = reach.window()
    rows: Rows = []
    for blend, kernel, ways in KINDS:
        off = shown.settings(0, blend).but(background=None, kernel=kernel)
        right = draw(splats, camera, off.but(antialias="supersample"))
        energy = aliasing_energy(finer(draw, splats, camera, off), window)
        error = mean_square(draw(splats, camera, off), right, reach.beyond)
        what = f"{blend}, {kernel}"
        rows.append((f"{what}: aliasing energy, standard", f"{energy:.3e}", ""))
        rows.append((f"{what}: mean squared error, standard", f"{error:.3e}", ""))
        for way in ways:
            on = off.but(antialias="paper", attenuation=way)
            name = f"antialiased ({way})" if len(ways) > 1 else "antialiased"
            left = aliasing_energy(finer(draw, splats, camera, on), window)
            off_by = mean_square(draw(splats, camera, on), right, reach.beyond)
            rows.append((f"{what}: aliasing energy, {name}", f"{left:.3e}", _ratio(energy, left)))
            rows.append((f"{what}: mean squared error, {name}", f"{off_by:.3e}", _ratio(error, off_by)))
        if blend == "xray":
            noise = f"÷ {noise_ratio(splats, camera, kernel):.2f}"
            rows.append((f"{what}: aliasing energy, noise at these depths", "by the kernel's spectrum", noise))
    # quads: tiles end behind opaque splats, which rounds the same sums otherwise
    before = shown.settings(1).but(background=None, technique="quads")
    changed, count = differing_before(draw, splats, camera, before)
    rows.append(("before z_k: pixels that antialiasing changes", f"{changed} of {count}", ""))
    return rows


def _moving(shown: Shown) -> Rows:
    """Figs. 12 to 14: energy and errors of motion blur, flicker over the rotation, popping."""
    rows = _blurred(shown) if shown.blur is not None else []
    for spin in dict.fromkeys((*PACES, shown.figure.spin)):
        found = [flicker(s) for s in shown.strips(spin, shown.figure.frames if shown.figure.number == 14 else FRAMES)]
        for v, value in enumerate(found):
            rows.append(
                (f"variance of frame differences at {spin:g}°: ({'abcd'[v]})", f"{value:.3e}", _ratio(found[0], value))
            )
    track = shown.turned(1.0)
    for pop in popping(shown.draw, shown.splats, track.camera, shown.settings(1)):
        what = f"popping: largest change in 0.01° at {pop.angle:.2f}°, where the order changes"
        rows.append((what, f"{pop.change:.3f}", f"{pop.usual:.3f} beside it"))
    return rows


def _blurred(shown: Shown) -> Rows:
    """Against the mean of many moments: energy of X-rays, and errors of the four variants, at 4×4 samples a pixel."""
    splats, camera, turn = shown.splats, shown.track.camera(1), shown.track.turn
    paths = streaks(splats, camera, turn, SHUTTER)
    longest = float(paths.pixels(splats.grid.mean_spacing).max(initial=0.0))
    rows = [(f"longest path in half a frame of {shown.figure.spin:g}°", f"{longest:.1f} pixels", "")]
    many = Moments(shown.draw, turn, SHUTTER, TIMES)
    sums = shown.settings(1, "xray").but(background=None)
    energy, right = (
        float(draw(splats, camera, sums).pixels[..., 3].sum(dtype=np.float64))
        for draw in (shown.drawer(3, shown.track), many)
    )
    rows.append((f"energy of blurred splats, X-ray, by that of {TIMES} moments", f"{energy / right:.6f}", ""))
    truth = many(splats, camera, shown.settings(1).but(antialias="supersample"))
    everywhere = np.ones(camera.size[::-1], dtype=bool)
    found = [
        mean_square(shown.drawer(v, shown.track)(splats, camera, shown.settings(v)), truth, everywhere)
        for v in shown.variants
    ]
    what = f"mean squared error against 4×4 samples, {TIMES} moments"
    return rows + [(f"{what}: ({'abcd'[v]})", f"{e:.3e}", _ratio(found[0], e)) for v, e in enumerate(found)]


def _ratio(standard: float, found: float) -> str:
    return f"÷ {standard / found:.2f}" if found > 0 else ""
