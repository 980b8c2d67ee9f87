"""Annotations: lengths, colours and letters by closed forms; places apart; bad input in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.annotate import annotated, parsed
from splatgl.annotations.axes import letters
from splatgl.annotations.canvas import Subject
from splatgl.annotations.color_bar import of_values
from splatgl.annotations.scale_bar import length_text, log_ticks, scale_of, ticks
from splatgl.cli.main import main

ALL = ("scale", "colorbar", "axes", "directions", "title=Head", "time=3 h")
VOLUME = sg.Volume(np.zeros((9, 9, 9), np.float32), unit="mm", frame="LPS", name="ct")
TRANSFER = sg.Transfer([(0, 0), (100, 0.5)], colormap="viridis")


@pytest.mark.parametrize("perspective", [True, False])
def test_scale_bar_length(perspective: bool) -> None:
    """Orthographic: 100 mm fill 400 rows. Perspective: 2·50·tan(45°) = 100 mm at the centre's depth, 50."""
    eye, target = (4, -46, 4), (4, 4, 4)
    if perspective:
        camera = sg.Camera.look_at(eye, target, (0, 0, 1), 90.0, (400, 400))
    else:
        camera = sg.Camera.orthographic(eye, target, (0, 0, 1), 100.0, (400, 400))
    scale = scale_of(Subject.of(VOLUME), camera)
    assert scale is not None and scale.pixels == pytest.approx(80) and scale.label == "20 mm"


def test_units_and_ticks() -> None:
    """Units change so that few digits are left; ticks are nice."""
    told = [length_text(0.5, "mm"), length_text(2000, "m"), length_text(5, ""), length_text(20, "Å")]
    assert told == ["500 um", "2 km", "5", "20 Å"]
    assert ticks(-3, 101, 6) == [0, 20, 40, 60, 80, 100]


@pytest.mark.parametrize(
    ("low", "high", "right"),
    [
        (0.9, 60, [1, 2, 5, 10, 20, 50]),
        (0.01, 1000, [0.01, 0.1, 1, 10, 100, 1000]),
        (1e-9, 1e3, [1e-8, 1e-6, 1e-4, 0.01, 1, 100]),
        (3, 4, []),
    ],
)
def test_logarithmic_ticks(low: float, high: float, right: list[float]) -> None:
    """Decades, with 2 and 5 where there is room; of many, every few."""
    assert log_ticks(low, high, 6) == right


def test_a_logarithmic_bar_is_even_in_decades() -> None:
    """Its rows have the transfer function's colours, and a decade is as long as another."""
    transfer = sg.Transfer([(1, 0.0), (1000, 0.8)], colormap="viridis", scale="log")
    bar = of_values(transfer, "density", "composite", 300)
    assert bar is not None
    assert [bar.down(value) for value in (1000, 100, 10, 1)] == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert np.allclose(bar.colors[99:101, :3].mean(axis=0), transfer.color(100.0), atol=5e-3)
    assert bar.opacity is not None and bar.opacity[149:151].mean() == pytest.approx(0.4, abs=1e-3)
    assert bar.marks() == [1, 10, 100, 1000]


def test_letters() -> None:
    """A patient seen from the front has L at the right; in RAS the same side is −x."""
    front = {"LPS": (4, -90, 4), "RAS": (4, 90, 4)}
    for frame, eye in front.items():
        camera = sg.Camera.look_at(eye, (4, 4, 4), (0, 0, 1))
        assert [letters(frame, camera.eye_from_world[n]) for n in (0, 1, 2)] == ["L", "I", "P"]
    assert letters("LPS", np.array([0.8, 0.6, 0.0])) == "LP"


@pytest.mark.parametrize("size", [(256, 256), (512, 512), (1024, 600), (300, 700)])
@pytest.mark.parametrize("light", [0.0, 1.0])
def test_bar_colors_and_untouched_pixels(size: tuple[int, int], light: float) -> None:
    """The bar has the transfer function's colours; far from annotations nothing changes."""
    camera = sg.Camera.orbit(VOLUME, size=size)
    pixels = np.full((size[1], size[0], 4), light, np.float32)
    image = annotated(sg.Image(pixels, {"blend": "composite"}), VOLUME, TRANSFER, camera, ALL)
    assert image.info["not_annotated"] == []
    bar = of_values(TRANSFER, "ct", "composite", round(0.45 * size[1]))
    assert bar is not None
    middle = image.pixels[size[1] // 2 - 20 : size[1] // 2 + 20]
    row = TRANSFER.color(
        bar.high
        - (np.argmin(np.abs(bar.colors[:, 0] - bar.colors[len(bar.colors) // 2, 0])) + 0.5) / len(bar.colors) * 100
    )
    assert np.abs(middle[..., :3] - row.astype(np.float32)).max(axis=-1).min() < 1e-6
    center = (slice(size[1] // 3, size[1] // 3 + 20), slice(size[0] // 3, size[0] // 2))
    np.testing.assert_array_equal(image.pixels[center], pixels[center])


@pytest.mark.parametrize("text", ["sharp", "title", "title=", "scale,scale", "scale=3"])
def test_bad_names(text: str) -> None:
    """One line that lists what is known."""
    with pytest.raises(sg.InputError, match="annotate: expected"):
        parsed(text)


@pytest.mark.long
def test_render(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command draws them; a small picture is told before."""
    out = tmp_path / "a.png"
    base = ["render", "nerve", "-o", str(out), "--annotate", "scale,axes,title=A, b"]
    assert main([*base, "--size", "128", "--quiet"]) == 0
    assert sg.Image.load(out).info["annotated"] == ["scale", "axes", "title=A, b"]
    assert main([*base, "--size", "32"]) == 2 and "at least 64×64" in capsys.readouterr().err
