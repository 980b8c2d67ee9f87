"""Contexts: every backend opens, several live side by side, release frees, and refusals say what to do."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import moderngl
import numpy as np
import pytest

import splatgl as sg
from splatgl.cli import doctor
from splatgl.errors import InputError
from splatgl.gl import backends, program
from splatgl.gl import context as contexts
from splatgl.gl.backends import BackendError, ContextLost, current_loader, switch_to
from splatgl.gl.context import context_info, current, is_software, open_context
from splatgl.gl.selfcheck import SelfCheck, run_checks
from splatgl.gl.shader import ShaderError
from splatgl.opengl import OpenGL
from splatgl.platforms import BACKENDS
from tests.helpers.memory import resident_mebibytes

Open = Callable[..., moderngl.Context]
# The library whose absence excuses a backend; asked without the code under test, so that its faults do not skip
LIBRARIES = {"egl": backends.EGL_LIBRARIES[:1], "osmesa": backends.LIBRARIES[:2], "window": backends.LIBRARIES[:2]}


def need(backend: str) -> None:
    """Skip where the system lacks the library behind a backend."""
    if backend == "window" and os.environ.get("DISPLAY"):
        return
    for name in LIBRARIES[backend]:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return
    pytest.skip(f"{backend}: {LIBRARIES[backend][0]} is not installed")


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[Open]:
    """Opens contexts and frees them after the test; brings back what was current before it."""
    monkeypatch.delenv("SPLATGL_REQUIRE_GPU", raising=False)
    before, made = current_loader(), []

    def open_one(backend: str = "auto", **options: object) -> moderngl.Context:
        if backend != "auto":
            need(backend)
        made.append(open_context(OpenGL(backend, **options)))
        return made[-1]

    yield open_one
    for ctx in made:
        ctx.release()
    switch_to(before)


def fill(ctx: moderngl.Context, value: float, size: tuple[int, int] = (4, 4)) -> moderngl.Framebuffer:
    """A float target of one value, left alive."""
    target = ctx.framebuffer([ctx.texture(size, 4, dtype="f4")])
    target.clear(value, value, value, value)
    return target


def values(target: moderngl.Framebuffer) -> set[float]:
    return set(np.frombuffer(target.read(components=4, dtype="f4"), "f4").tolist())


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_backend_opens_and_draws(opened: Open, backend: str) -> None:
    ctx = opened(backend)
    info = context_info(ctx)
    assert info.backend == backend
    assert ctx.version_code >= 330 and info.renderer and info.glsl[0].isdigit()
    assert info.max_texture_size >= 1024 and info.max_uniform_block >= 16384  # what OpenGL 3.3 guarantees
    assert values(fill(ctx, 0.3)) == {float(np.float32(0.3))}
    assert ctx.error == "GL_NO_ERROR"


def test_contexts_draw_in_turn(opened: Open) -> None:
    # Each makes objects with the same GL names; drawn into the wrong context they would overwrite each other
    pair = [opened("egl"), opened("osmesa"), opened("egl")]
    targets = []
    for ctx in pair:
        with current(ctx):
            targets.append(fill(ctx, 0.0))
    assert len({target.glo for target in targets}) == 1, "same names, else this test proves nothing"

    for step in range(3):
        for number, (ctx, target) in enumerate(zip(pair, targets, strict=True)):
            with current(ctx):
                target.clear(*[step + number / 8] * 4)
        for number, (ctx, target) in enumerate(zip(pair, targets, strict=True)):
            with current(ctx):
                assert values(target) == {step + number / 8}
                assert ctx.error == "GL_NO_ERROR"


def test_current_is_brought_back(opened: Open) -> None:
    first, second = opened("egl"), opened("osmesa")
    assert current_loader() is second.extra
    with current(first):
        assert current_loader() is first.extra
        with current(second), current(first):
            assert current_loader() is first.extra
        assert current_loader() is first.extra
        with pytest.raises(RuntimeError), current(second):
            raise RuntimeError
        assert values(fill(first, 0.5)) == {0.5}
    assert values(fill(second, 0.25)) == {0.25}


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_another_library_may_take_the_context_away(opened: Open, backend: str) -> None:
    """As VTK does: it makes a context of its own current, and asks nobody."""
    ctx = opened(backend)
    with current(ctx):
        assert ctx.extra.system.holds()
        # behind the loader's back
        ctx.extra.system.unbind()
        assert not ctx.extra.system.holds()
        with current(ctx):
            assert ctx.extra.system.holds() and values(fill(ctx, 0.5)) == {0.5}


def test_each_thread_has_its_own_current_context(opened: Open) -> None:
    need("osmesa")
    ctx = opened("egl")
    seen: list[object] = []

    def work() -> None:
        seen.append(current_loader())
        other = open_context(OpenGL("osmesa"))
        seen.append(values(fill(other, 0.75)))
        other.release()

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [None, {0.75}]
    assert current_loader() is ctx.extra and values(fill(ctx, 0.5)) == {0.5}


def test_a_context_that_another_thread_uses_is_named(opened: Open) -> None:
    ctx, said = opened("egl"), []

    def work() -> None:
        with pytest.raises(BackendError) as caught, current(ctx):
            pass
        said.append(str(caught.value))

    with current(ctx):
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    assert said == ["EGL's context is current in another thread; give each thread a Renderer"]


@pytest.mark.parametrize("backend", BACKENDS)
def test_release_frees_the_context(opened: Open, backend: str) -> None:
    # 30 contexts with 4 MiB of texels each: kept, they would hold 120 MiB
    opened(backend).release()
    before = resident_mebibytes()
    for _ in range(30):
        ctx = opened(backend)
        fill(ctx, 0.5, (512, 512)).read()
        ctx.release()
    assert resident_mebibytes() - before < 60


def test_release_twice_and_out_of_order(opened: Open) -> None:
    first, second = opened("egl"), opened("osmesa")
    with current(first):
        second.release()
        second.extra.release()
    # What was current before has gone meanwhile: nothing is, and the other still draws
    assert current_loader() is None
    with current(first):
        assert values(fill(first, 0.5)) == {0.5}
    third = opened("egl")
    third.release()
    assert current_loader() is None, "a freed context must not pass for the current one"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"backend": "vulkan"}, "backend: expected auto | egl | osmesa | window, got vulkan"),
        ({"device": -1}, "device: expected an EGL device number from 0, got -1"),
        ({"backend": "osmesa", "device": 0}, "device: expected none"),
    ],
)
def test_bad_requests_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match="^" + message.replace("|", r"\|")):
        open_context(OpenGL(**options))


def test_a_device_that_is_not_there_is_not_replaced(opened: Open) -> None:
    need("egl")
    with pytest.raises(InputError, match=r"egl says: .*99.*leave the device out") as caught:
        open_context(OpenGL(device=99))
    assert "osmesa" not in str(caught.value)


def test_auto_tries_all_and_quotes_each(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str, device: int | None, require_gpu: bool) -> moderngl.Context:
        raise BackendError(f"no {name} today")

    monkeypatch.setattr(contexts, "_open", refuse)
    with pytest.raises(InputError) as caught:
        open_context(OpenGL())
    message = str(caught.value)
    assert "\n" not in message and "apt-get install libegl1" in message
    assert [message.index(f"{name} says: no {name} today") for name in BACKENDS] == sorted(
        message.index(f"{name} says") for name in BACKENDS
    )


def test_auto_prefers_egl(opened: Open) -> None:
    need("egl")
    assert context_info(opened("auto")).backend == "egl"


def test_a_graphics_card_can_be_required(opened: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    software = context_info(opened("egl")).software
    for by_argument in (True, False):
        monkeypatch.setenv("SPLATGL_REQUIRE_GPU", "0" if by_argument else "1")
        ask = {"gpu": True} if by_argument else {}
        if software:
            with pytest.raises(InputError, match=r"OpenGL on a graphics card: .*draws in software"):
                open_context(OpenGL("egl", **ask))
        else:
            assert not context_info(opened("egl", **ask)).software


@pytest.mark.parametrize(
    ("renderer", "software"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("softpipe", True),
        ("Google SwiftShader", True),
        ("Apple Software Renderer", True),
        ("NVIDIA H200/PCIe/SSE2", False),
        ("AMD Radeon RX 7900 XTX (radeonsi, navi31, LLVM 15.0.7)", False),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", False),
    ],
)
def test_software_renderers_are_known_by_name(renderer: str, software: bool) -> None:
    assert is_software(renderer) is software


@pytest.mark.parametrize("backend", BACKENDS)
def test_selfcheck_passes_and_leaves_no_error(opened: Open, backend: str) -> None:
    ctx = opened(backend)
    checks = {check.name: check for check in run_checks(ctx)}
    assert all(check.passed for check in checks.values() if check.required)
    assert checks["over rgba32f"].answer == pytest.approx(0.86480, abs=5e-6)
    assert ctx.error == "GL_NO_ERROR"
    # The checks can tell: half floats and bytes lose what float32 keeps
    assert not checks["over rgba16f"].passed and not checks["over rgba8"].passed


@pytest.mark.long
def test_doctor_reports(opened: Open) -> None:
    need("egl")
    text, ok = doctor.report(OpenGL("egl"))
    assert ok
    for word in ("Python", "moderngl", "pyrr", *BACKENDS, "over rgba32f", "linear filter", "textures up to"):
        assert word in text
    assert "draws by tiles, quads and streaks" in text
    for name in doctor._images(tiles=True):
        assert any(line.startswith(f"{name} ok") for line in lines_of(text)), name


@pytest.mark.long
def test_doctor_says_when_blending_is_wrong(opened: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    need("egl")
    wrong = SelfCheck("over rgba32f", got=0.512, answer=0.8648, tolerance=1e-4, required=True)
    monkeypatch.setattr(doctor, "run_checks", lambda ctx: (wrong,))
    only(monkeypatch, "default")
    text, ok = doctor.report(OpenGL("egl"))
    assert not ok and "WRONG" in text


def only(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Leaves the doctor these images."""
    images = doctor._images(tiles=True)
    monkeypatch.setattr(doctor, "_images", lambda tiles: {name: images[name] for name in names})


def lines_of(text: str) -> list[str]:
    return [" ".join(line.split()) for line in text.splitlines()]


def test_doctor_says_when_the_default_can_not_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shader of tiles that is refused, as by a driver: what other techniques draw is no excuse."""
    need("egl")
    kept = program.build_compute

    def build(ctx: moderngl.Context, name: str, switches: Any) -> moderngl.ComputeShader:
        if name.startswith("sheet_"):
            raise ShaderError(f"{name}: 0:1(10): error: unsupported\nand more")
        return kept(ctx, name, switches)

    monkeypatch.setattr(program, "build_compute", build)
    only(monkeypatch, "default", "sheets by quads", "sheets by tiles")
    text, ok = doctor.report(OpenGL("egl"))
    assert not ok and "pictures are WRONG" in text and "pictures are right" not in text
    lines = lines_of(text)
    for name in ("default", "sheets by tiles"):
        assert any(
            re.fullmatch(rf"{name} FAILED sheet_\w+.comp: 0:1\(10\): error: unsupported", line) for line in lines
        )
    assert any(line.startswith("sheets by quads ok") for line in lines)


def test_doctor_says_when_an_image_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    need("egl")
    kept = sg.Renderer.render

    def render(self: sg.Renderer, splats: sg.Splats, *more: Any, **how: Any) -> sg.Image:
        drawn = kept(self, splats, *more, **how)
        return sg.Image(drawn.pixels + 0.01 * (splats.labels is not None), drawn.info)

    monkeypatch.setattr(sg.Renderer, "render", render)
    only(monkeypatch, "default", "boxes by quads")
    text, ok = doctor.report(OpenGL("egl"))
    assert not ok and "pictures are WRONG" in text and "pictures are right" not in text
    lines = lines_of(text)
    assert any(line.startswith("default ok") for line in lines)
    assert any(line.startswith("boxes by quads WRONG 0.01") for line in lines)


def test_doctor_says_when_a_check_can_not_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    need("egl")

    def refuse(ctx: moderngl.Context) -> None:
        raise moderngl.Error("the framebuffer is not complete\nand more")

    monkeypatch.setattr(doctor, "run_checks", refuse)
    text, ok = doctor.report(OpenGL("egl"))
    assert not ok and text.endswith("pictures are WRONG on this driver: the framebuffer is not complete")


def test_doctor_without_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str, device: int | None, require_gpu: bool) -> moderngl.Context:
        raise BackendError("nothing here")

    monkeypatch.setattr(contexts, "_open", refuse)
    text, ok = doctor.report(OpenGL())
    assert not ok and "nothing can be rendered" in text and "apt-get install" in text


FORKED = """
import gc, os, signal, sys
import splatgl as sg
from splatgl.gl.context import context_info, open_context
from splatgl.opengl import OpenGL

volume = sg.scenes.ball(8)
splats, camera = sg.extract(volume, sg.default_transfer(volume)), sg.Camera.orbit(volume, size=(40, 30))

def said(work):
    try:
        work()
    except sg.InputError as error:
        return str(error)
    return ""

def child(work):
    # a child that hangs ends by itself, and its exit code says so
    if not (pid := os.fork()):
        signal.alarm(LIMIT)
        try:
            work()
            os._exit(0)
        except BaseException as error:
            print(type(error).__name__, error, flush=True)
            os._exit(1)
    assert os.waitpid(pid, 0)[1] == 0, work.__name__

def draws(backend):
    with sg.Renderer(backend) as renderer:
        return renderer.render(splats, camera).pixels

def fresh():
    assert draws(own).any()

def inherited():
    line = said(lambda: renderer.render(splats, camera))
    assert line.startswith("context: expected one opened in this process, got one from before it was forked;"), line
    assert "spawn" in line and "spawn" in said(lambda: context_info(renderer.ctx))
    with renderer:
        pass
    renderer.close()
    renderer.ctx.release()
    others()
    del globals()["renderer"]
    gc.collect()

def others():
    line = said(lambda: open_context(OpenGL(own)))
    assert line.startswith("OpenGL: expected a context") and "forked" in line and "spawn" in line, line
    # what the parent had not opened still draws, and goes for auto
    if other:
        assert (draws(other) == right).all() and (draws("auto") == right).all()

own, other = sys.argv[1:]
child(fresh)
renderer = sg.Renderer(own)
right = renderer.render(splats, camera).pixels
child(inherited)
# the parent is none the worse, and what it closed is as lost to a child
assert (renderer.render(splats, camera).pixels == right).all()
renderer.close()
child(others)
"""


@pytest.mark.long
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.parametrize(("backend", "other"), [("egl", "osmesa"), ("osmesa", "egl"), ("window", "")])
def test_a_forked_process_is_told_to_be_spawned(backend: str, other: str) -> None:
    """Its parent's threads are not in it: all that would hang there is refused, and nothing else."""
    need(backend)
    try:
        need(other or backend)
    except pytest.skip.Exception:
        other = ""
    script = FORKED.replace("LIMIT", "60")
    with subprocess.Popen(
        [sys.executable, "-c", script, backend, other],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
    ) as run:  # fmt: skip
        try:
            output, _ = run.communicate(timeout=400)
        finally:
            if run.poll() is None:
                os.killpg(run.pid, signal.SIGKILL)
    assert run.returncode == 0, output


# functions of EGL
NAMED = ("GetCurrentContext", "GetCurrentSurface")


class Pbuffer:
    """A context that another library of the process made by EGL, which draws to a surface of its own."""

    def __init__(self) -> None:
        need("egl")
        self.egl = ctypes.CDLL(backends.EGL_LIBRARIES[0])
        pointer, attributes = ctypes.c_void_p, ctypes.c_int * 3
        for name in ("GetPlatformDisplay", "CreateContext", "CreatePbufferSurface", *NAMED):
            getattr(self.egl, f"egl{name}").restype = pointer
        self.egl.eglGetPlatformDisplay.argtypes = [ctypes.c_uint, pointer, pointer]
        self.egl.eglInitialize.argtypes = [pointer] * 3
        self.egl.eglChooseConfig.argtypes = [pointer, pointer, pointer, ctypes.c_int, pointer]
        self.egl.eglCreateContext.argtypes = self.egl.eglMakeCurrent.argtypes = [pointer] * 4
        self.egl.eglCreatePbufferSurface.argtypes = [pointer] * 3
        self.egl.eglDestroyContext.argtypes = self.egl.eglDestroySurface.argtypes = [pointer] * 2
        # a display without windows
        self.display = self.egl.eglGetPlatformDisplay(0x31DD, None, None)
        if not (self.display and self.egl.eglInitialize(self.display, None, None)):
            pytest.skip("EGL has no display without windows here")
        self.egl.eglBindAPI(0x30A2)
        config, count = ctypes.c_void_p(), ctypes.c_int()
        # EGL_RENDERABLE_TYPE: OpenGL
        kind = attributes(0x3040, 0x0008, 0x3038)
        self.egl.eglChooseConfig(self.display, kind, ctypes.byref(config), 1, ctypes.byref(count))
        self.context = self.egl.eglCreateContext(self.display, config, None, None)
        sides = (ctypes.c_int * 5)(0x3057, 8, 0x3056, 4, 0x3038)
        self.surface = self.egl.eglCreatePbufferSurface(self.display, config, sides)
        self.bind()

    def bind(self) -> None:
        assert self.egl.eglMakeCurrent(self.display, self.surface, self.surface, self.context)

    def is_current(self) -> bool:
        found = self.egl.eglGetCurrentContext(), self.egl.eglGetCurrentSurface(0x3059)
        return bool(found == (self.context, self.surface))

    def close(self) -> None:
        self.egl.eglMakeCurrent(self.display, None, None, None)
        self.egl.eglDestroyContext(self.display, self.context)
        self.egl.eglDestroySurface(self.display, self.surface)


@pytest.fixture
def host(opened: Open) -> Iterator[Pbuffer]:
    switch_to(None)
    made = Pbuffer()
    yield made
    made.close()


def test_what_another_library_had_current_is_current_again(host: Pbuffer) -> None:
    assert host.is_current()
    cube = sg.Volume(np.ones((2, 2, 2)))
    sg.render(cube, size=(8, 8))
    assert host.is_current(), "one call"
    with sg.Renderer() as renderer:
        assert host.is_current(), "a renderer that was opened"
        with current(renderer.ctx):
            assert not host.is_current()
            # behind the renderer's back, as by a host's own events
            host.bind()
            with current(renderer.ctx):
                assert values(fill(renderer.ctx, 0.5)) == {0.5}
            assert host.is_current()
        assert host.is_current()
    assert host.is_current(), "a renderer that was closed"
    with pytest.raises(InputError):
        sg.Renderer(device=1000)
    assert host.is_current(), "none could be opened"


@pytest.mark.parametrize("backend", ["osmesa", "window"])
def test_it_is_of_any_window_system(host: Pbuffer, backend: str) -> None:
    need(backend)
    with sg.Renderer(backend) as renderer:
        assert host.is_current()
        with current(renderer.ctx):
            assert values(fill(renderer.ctx, 0.5)) == {0.5}
        assert host.is_current()
    assert host.is_current()


# a window's context by GLX, as those of Qt; then ours by EGL; and the host draws on
WINDOWED = """
import ctypes, glfw, moderngl, numpy as np
import splatgl as sg
glfw.init()
glfw.window_hint(glfw.VISIBLE, False)
glfw.make_context_current(glfw.create_window(8, 8, "host", None, None))
glx = ctypes.CDLL("libGL.so.1")
told = glx.glXGetCurrentContext, glx.glXGetCurrentDrawable
for function in told:
    function.restype = ctypes.c_void_p
before, ctx = [function() for function in told], moderngl.create_context(require=330)
assert all(before)
for _ in range(2):
    image = sg.render(np.ones((2, 2, 2)), size=(8, 8))
    assert image.pixels.max() > 0 and [function() for function in told] == before
    ctx.program(vertex_shader="#version 330\\nvoid main() { gl_Position = vec4(0.0); }")
    assert ctx.error == "GL_NO_ERROR"
"""


@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs xvfb-run")
def test_a_windows_context_is_current_again() -> None:
    code = ["xvfb-run", "-a", sys.executable, "-c", WINDOWED]
    told = subprocess.run(code, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr


def test_the_newest_version_is_asked_for_first(opened: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some drivers give exactly what is asked, and refuse what they do not have."""
    need("egl")
    from glcontext import egl as system

    asked: list[int] = []

    def create(**options: Any) -> object:
        asked.append(options["glversion"])
        if options["glversion"] > 330:
            raise RuntimeError("EGL_BAD_MATCH")
        return made(**options)

    made = system.create_context
    monkeypatch.setattr(system, "create_context", create)
    opened("egl", device=0)
    assert asked == [460, 450, 430, 330]


def test_a_renderer_is_closed_whose_display_another_library_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    need("egl")
    with sg.Renderer("egl") as renderer:
        monkeypatch.setattr(renderer.ctx.extra.system, "_current", lambda: 0)
        with pytest.raises(ContextLost, match="context is gone"), current(renderer.ctx):
            pass
