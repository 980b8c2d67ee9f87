"""Public functions take what `render` takes, or say in one line what they want: no other error leaves them."""

from __future__ import annotations

import inspect
import pydoc
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.coercion import public
from splatgl.options import Keyword
from splatgl.scene.api import GROUPS, KEYWORDS, PLAIN

BALL = sg.scenes.ball(3)
ARROWS = sg.Volume(np.ones((4, 4, 4), np.float32), vectors=np.ones((4, 4, 4, 3), np.float32))
SEGMENTS = sg.Volume(np.ones((4, 4, 4), np.uint8), labels=())
LOOK = sg.default_transfer(BALL)
CAMERA = sg.Camera.orbit(BALL, size=(8, 6))
IMAGE = sg.Image(np.zeros((6, 8, 4), np.float32))
CORNERS = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
# an argument of each name
RIGHT: dict[str, Any] = {
    **dict.fromkeys(("volume", "subject", "x", "source"), BALL),
    **dict.fromkeys(("image", "a", "b", "near", "far"), IMAGE),
    **{"transfer": LOOK, "camera": CAMERA, "splats": sg.extract(BALL, LOOK), "settings": sg.Settings()},
    **{"path": "ball.nii", "name": "ct-bone", "pixel": (3, 3), "annotate": ("scale",), "text": "ramp"},
    **{"eye": (0, -9, 0), "target": (0, 0, 0), "up": (0, 0, 1), "eye_from_world": np.eye(3), "extent": 1.0},
    **{"size": (8, 6), "samples": np.zeros((2, 2, 2)), "pixels": np.zeros((2, 2, 4), np.float32)},
    **{"vertices": CORNERS, "faces": [[0, 1, 2]], "layers": [sg.Layer(BALL)], "where": "z=1"},
    **{"outline": [(0, 0), (1, 0), (1, 1)], "values": (0, 1), "gradients": (0, 1), "points": np.zeros((1, 3))},
    **{"records": np.zeros(0), "knots": (0, 1, 2), "pieces": sg.PiecewiseCubic.of_family("k").pieces, "version": "0.1"},
    **{"colors": np.ones((1, 3)), "extinctions": np.ones(1), "lines": [np.array([[0, 0, 0], [1, 0, 0]])], "radius": 1},
}
OTHERS: dict[str, dict[str, Any]] = {
    **{name: {"volume": ARROWS} for name in ("arrows", "directions", "magnitudes", "streamlines")},
    **{"surfaces": {"volume": SEGMENTS}, "Region": {"shape": "box"}, "load_mesh": {"path": "mesh.stl"}},
    "register_kernel": {"shape": sg.PiecewiseCubic.of_family("taken")},
}
WRONG: dict[str, Any] = {
    **{"file": "ball.nii", "missing file": "nosuch.nii", "word": "zzz", "flat array": np.zeros((2, 2)), "None": None},
    **{"list": [1, "a"], "dict": {"a": 1}, "number": 7, "object": object(), "NaN": float("nan")},
    "array of objects": np.array([None, "a"], object),
}
# windows, files, workers, and scenes that take seconds to make
LEFT_OUT = {"show", "animate", "connected", "render_frames", "release", "nerve", "terrain", "tunnel"}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    BALL.save("ball.nii")


def functions() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Public functions and classes, those of public modules, and functions that make objects."""
    for name in sg.__all__:
        value = getattr(sg, name)
        if inspect.ismodule(value):
            names = getattr(value, "__all__", [key for key in vars(value) if not key.endswith(("_", "_at"))])
            found = {key: getattr(value, key) for key in names}
            yield from ((f"{name}.{key}", item) for key, item in found.items() if callable(item))
        elif callable(value) and not (inspect.isclass(value) and issubclass(value, Exception)):
            yield name, value
            makers = [key for key, item in vars(value).items() if isinstance(item, classmethod | staticmethod)]
            yield from ((f"{name}.{key}", getattr(value, key)) for key in makers if key[0] != "_")


def parameters(function: Callable[..., Any]) -> list[str]:
    items = inspect.signature(function).parameters.values()
    plain = [item for item in items if item.kind in (item.POSITIONAL_OR_KEYWORD, item.KEYWORD_ONLY)]
    return [item.name for item in plain if item.name not in KEYWORDS or item.kind == item.POSITIONAL_OR_KEYWORD]


def problems(calls: Iterator[tuple[str, Callable[[], Any]]]) -> list[str]:
    """Errors of calls that are no InputError of one line."""
    found = []
    for name, call in calls:
        try:
            call()
        except sg.InputError as error:
            found += [f"{name}: {error!r}"] * ("\n" in str(error))
        except Exception as error:
            found.append(f"{name}: {error!r}")
    return found


def wrong_calls(name: str, function: Callable[..., Any]) -> Iterator[tuple[str, Callable[[], Any]]]:
    needed = [item.name for item in inspect.signature(function).parameters.values() if item.default is item.empty]
    right = {key: RIGHT.get(key) for key in parameters(function) if key in needed} | OTHERS.get(name, {})
    right |= {"size": 4} if name in ("render", "depth_map") else {}
    for key in parameters(function):
        for kind, value in WRONG.items():
            given = {**right, key: value}
            yield f"{name}({key}={kind})", lambda given=given: function(**given)  # type: ignore[misc]


FUNCTIONS = {name: function for name, function in functions() if name.split(".")[-1] not in LEFT_OUT}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_wrong_arguments_are_refused_in_a_line(name: str) -> None:
    assert problems(wrong_calls(name, FUNCTIONS[name])) == []


def keyword_calls(names: list[str], kinds: list[str]) -> Iterator[tuple[str, Callable[[], Any]]]:
    for name in names:
        for kind in kinds:
            given = {"size": 4, name: WRONG[kind]}
            yield f"{name}={kind}", lambda given=given: sg.depth_map(BALL, **given)  # type: ignore[misc]


def test_arrays_in_keywords() -> None:
    names = [name for name in KEYWORDS if name not in ("layers", "layer")]
    assert problems(keyword_calls(names, ["flat array"])) == []


@pytest.mark.long
def test_wrong_keywords_are_refused_in_a_line() -> None:
    assert problems(keyword_calls(list(KEYWORDS), list(WRONG))) == []


def test_functions_take_what_render_takes() -> None:
    array = np.asarray(BALL.samples)
    ball = sg.load("ball.nii")
    right = sg.Camera.orbit(ball, 30, size=(8, 8))
    for x in ("ball.nii", Path("ball.nii"), ball):
        assert np.array_equal(sg.Camera.orbit(x, 30, size="8").eye, right.eye)
        assert sg.default_transfer(x) == sg.default_transfer(ball)
        assert len(sg.extract(x, "ct-bone")) == len(sg.extract(ball, sg.preset("ct-bone", ball)))
    assert sg.Camera.orbit(array, size=8).size == (8, 8)
    assert len(sg.extract(array, {"points": [(0, 0), (1, 0.5)]})) == len(
        sg.extract(sg.Volume.of(array), sg.Transfer([(0, 0), (1, 0.5)]))
    )
    exact = sg.reference.render(sg.extract(ball, sg.default_transfer(ball)), right, sg.Settings(antialias="off")).pixels
    assert np.array_equal(sg.reference.render("ball.nii", right, {"antialias": "off"}).pixels, exact)
    assert sg.pick("ball.nii", right, (4, 4)) is not None
    assert sg.compare(np.zeros((2, 2, 4), np.float32), sg.Image(np.zeros((2, 2, 4), np.float32))).maximum == 0


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: sg.default_transfer("f"), "^f: path: expected a file, got no such file"),
        (lambda: sg.Camera.orbit(BALL, azim=3), r"got azim; did you mean azimuth\?"),  # type: ignore[call-arg]
        (lambda: sg.Settings(tolerence=1), r"got tolerence; did you mean tolerance\?"),  # type: ignore[call-arg]
        (lambda: sg.render(BALL, width=200), r"width: .* got 200; did you mean size 200, in pixels\?"),
        (lambda: sg.render(BALL, bg="red"), r"got bg; did you mean background\?"),  # type: ignore[call-arg]
        (lambda: sg.View(cmap="hot"), "View: .* got cmap"),  # type: ignore[call-arg]
        (lambda: sg.Look(cmap="hot"), r"got cmap; did you mean colormap\?"),  # type: ignore[call-arg]
        (lambda: sg.View(azimuth="left"), "azimuth: expected one finite number, got 'left'"),
        (lambda: sg.render(BALL, look=sg.View()), "look: expected a Look, got a View"),
        (lambda: sg.render(BALL, cuts="x>0"), "cuts: expected a Cuts, got a str"),
        (lambda: sg.render(BALL, camera=BALL), "camera: expected a Camera, .* got a Volume"),
    ],
)
def test_lines_that_advise(call: Callable[[], Any], line: str) -> None:
    with pytest.raises(sg.InputError, match=line):
        call()


def test_groups_are_their_keywords() -> None:
    groups = {"view": sg.View(azimuth=50, size=8), "light": sg.Light(light="glossy"), "look": sg.Look(log=False)}
    plain = sg.depth_map(BALL, azimuth=50, size=8, light="glossy")
    for depths in (
        sg.depth_map(BALL, **groups),
        sg.depth_map(BALL, groups["look"], groups["view"], groups["light"]),
        # a keyword replaces that of a group
        sg.depth_map(BALL, view=sg.View(azimuth=10, size=9), azimuth=50, size=8),
    ):
        assert np.array_equal(depths, plain, equal_nan=True)


def test_groups_are_disjoint_and_listed_in_help() -> None:
    names = [name for kind in GROUPS.values() for name in kind.known]
    assert len(names) == len(set(names))
    assert set(names) < set(PLAIN)
    assert list(inspect.signature(sg.View).parameters) == list(sg.View.known)


@pytest.mark.parametrize("function", [sg.render, sg.show, sg.depth_map, sg.animate, sg.export, sg.load, sg.Settings])
def test_help_has_a_line_of_each_option(function: Any) -> None:
    text = pydoc.plain(pydoc.render_doc(function))
    lines = dict(re.findall(r"(?m)^[ |]+([a-z_]+)=\S.*?: (.+)$", text))
    names = {name for name, item in inspect.signature(function).parameters.items() if isinstance(item, Keyword)}
    assert names - (GROUPS.keys() - PLAIN.keys()) <= lines.keys()
    assert max(map(len, text.splitlines())) < 160
    if function is sg.render:
        assert lines["azimuth"] == "degrees around the up axis (default 30)"
        assert lines["look_at"] == "point that eye looks at (default: the centre)"


def test_colors_as_numbers() -> None:
    rgb = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 1)])
    right = sg.Transfer([(0, 0), (1, 0.5)], "0:#000000,0.5:#ff0000,1:#ffffff")
    values = np.linspace(0, 1, 9)
    for colors in (rgb / 1.0, (rgb * 255).astype(np.uint8), (rgb / 1.0).tolist()):
        assert np.array_equal(sg.Transfer([(0, 0), (1, 0.5)], colors).color(values), right.color(values))
    for wrong in (rgb[:1] / 1.0, rgb * 2.0, np.zeros((3, 4))):
        with pytest.raises(sg.InputError, match=r"colormap: expected a name, or sRGB colours \[N, 3\]"):
            sg.Transfer([(0, 0), (1, 0.5)], wrong)


def test_public_checks_arguments() -> None:
    @public
    def twice(number: float, times: int = 2) -> float:
        return number * times

    assert twice(3.5) == 7
    with pytest.raises(sg.InputError, match=r"^times: expected a whole number, got 'a'$"):
        twice(1, "a")  # type: ignore[arg-type]
