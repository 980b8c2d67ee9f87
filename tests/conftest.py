"""One context a session, fenced by a GL error check; the pinned vectors."""

from __future__ import annotations

import gc
import json
import os
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import program
from splatgl.gl import renderer as renderers
from splatgl.gl.context import REQUIRE_GPU, current
from splatgl.gl.renderer import is_usable, shared_renderer
from splatgl.opengl import OpenGL
from splatgl.readers import hdf5_files
from splatgl.scene.draw import DrawOptions
from tests.helpers.levels import with_levels
from tests.helpers.marks import mark_later, mark_long
from tests.helpers.twins import twin as twin

# tests draw with many more combinations of settings than a user, one after the other
program.MOST_PROGRAMS = 400

# of all tests of the files that are collected, chosen or not, whether they are long
LONG = pytest.StashKey[dict[str, bool]]()


@cache
def has_compute_shaders() -> bool:
    """Whether the OpenGL that tests draw with has them."""
    with sg.Renderer() as renderer:
        return renderer.tiles is True


def skip_without_compute_shaders() -> None:
    if not has_compute_shaders():
        pytest.skip("needs compute shaders, OpenGL 4.3")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Marks cases by tiles `compute`, and others `long` and `later`."""
    for item in items:
        if getattr(getattr(item, "callspec", None), "params", {}).get("technique") == "tiles":
            item.add_marker("compute")
    mark_long(items)
    mark_later(items)
    config.stash[LONG] = {item.nodeid: item.get_closest_marker("long") is not None for item in items}


@pytest.fixture
def processor(renderer: sg.Renderer) -> Iterator[sg.Renderer]:
    """Renderer whose compute shaders have a processor's shape, also on a graphics card."""
    if renderer.passes.device.programs.shape.name == "processor":
        yield renderer
    else:
        with sg.Renderer(shape="processor") as own:
            yield own


@pytest.fixture(scope="session")
def cards() -> Iterator[list[sg.Renderer]]:
    """The renderers of `card`; the last one is in use."""
    opened = list[sg.Renderer]()
    yield opened
    for own in opened:
        own.close()


@pytest.fixture
def card(cards: list[sg.Renderer]) -> sg.Renderer:
    """Renderer whose compute shaders have a graphics card's shape, opened again where VTK ended its display."""
    if not cards or not is_usable(cards[-1]):
        cards.append(sg.Renderer(shape="card"))
    return cards[-1]


@pytest.fixture
def are_long(pytestconfig: pytest.Config) -> dict[str, bool]:
    """Of all tests of the files that are collected, whether they are long."""
    if any("::" in each for each in pytestconfig.args):
        pytest.skip("needs whole files")
    return pytestconfig.stash[LONG]


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Looking through thousands of tests for what may be freed takes long, and finds nothing."""
    gc.disable()


def pytest_collection_finish(session: pytest.Session) -> None:
    gc.freeze()
    # the default, 700, has a third of the time of parsing go into looking for rings of references
    gc.set_threshold(20_000)
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("compute"):
        skip_without_compute_shaders()


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests leave the user's cache and list of files alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPLATGL_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setenv("SPLATGL_RECENT", "off")
        yield


@pytest.fixture(scope="module")
def sound_files() -> Iterator[None]:
    """Files that a test has just written by h5py are not first tried in another process, unless a test replaces what is
    tried there.
    """
    probe, usual = hdf5_files.probe, hdf5_files._LOOK
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hdf5_files, "probe", lambda path: None if usual == hdf5_files._LOOK else probe(path))
        yield


@pytest.fixture(scope="module")
def shared_programs() -> Iterator[None]:
    """Commands that are called in a test's process draw with the renderer of `sg.render`, whose programs are there."""
    drawing, early, opening = DrawOptions.renderer, DrawOptions.open_early, vars(renderers)["open_context"]

    def shared(self: DrawOptions) -> DrawOptions:
        is_plain = self == replace(self, opengl=OpenGL()) and REQUIRE_GPU not in os.environ
        # not where a test stands in for OpenGL
        return replace(self, is_shared=self.is_shared or (is_plain and vars(renderers)["open_context"] is opening))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DrawOptions, "renderer", lambda self: drawing(shared(self)))
        patch.setattr(DrawOptions, "open_early", lambda self: early(shared(self)))
        yield


@pytest.fixture
def renderer() -> Iterator[sg.Renderer]:
    """The renderer of `sg.render`, whose programs are compiled once; a test that leaves a GL error behind fails."""
    # opened again where VTK ended its display
    with shared_renderer() as kept:
        pass
    with current(kept.ctx):
        # transform feedback wants a complete framebuffer, whatever ran before
        kept.passes.targets.get("resolve", (1, 1), "rgba32f").framebuffer.use()
        yield kept
        assert kept.ctx.error == "GL_NO_ERROR"


@pytest.fixture(scope="session")
def pinned() -> list[dict]:
    """48 single voxels seen by one pixel each: rows 1–5 of Table 1 and the forms beyond, to 15 digits."""
    return json.loads((Path(__file__).parent / "pinned_vectors.json").read_text())["vectors"]


@pytest.fixture(scope="session")
def pinned_camera() -> sg.Camera:
    """The frame of the pinned vectors."""
    return sg.Camera.look_at((0, 0, 0), (0, 0, 1), up=(0, -1, 0), fov=60, size=(512, 512))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(1998)


@pytest.fixture(scope="module")
def threads() -> sg.Volume:
    """Threads one voxel wide, which means of values lose."""
    rng = np.random.default_rng(3)
    samples = np.zeros((64, 64, 64), np.float32)
    for _ in range(60):
        x, y = rng.integers(0, 64, 2)
        samples[:, y, x] = 1.0
    return with_levels(sg.Volume(samples), 3)
