"""Workers of Dask, in processes of their own: frames and parts of a picture; workers that die; what isn't there."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import fileio
from splatgl.cli.main import main
from splatgl.distributed import connected, workers
from splatgl.distributed.render import PicturePart, join_parts, join_samples, render_slabs
from splatgl.planning.bricks import Bricks, bricks_of
from splatgl.splat.settings import Settings
from tests.helpers.bricks import ALL, PICTURES, RAMP, VIEWS, cameras, noise
from tests.helpers.memory import allow_any_memory

pytestmark = pytest.mark.usefixtures("shared_programs")

# --- parts, without Dask ----------------------------------------------------------------------------------------------


def test_over_is_what_compositing_both_gives() -> None:
    near, far = (sg.Image(np.random.default_rng(n).random((3, 4, 4), np.float32)) for n in (1, 2))
    found = sg.over(near, far)
    right = near.pixels + (1 - near.pixels[..., 3:]) * far.pixels
    assert np.array_equal(found.pixels, right) and found.pixels.dtype == np.float32
    with pytest.raises(sg.InputError, match=r"^far: expected an image of 4×3, got \(2, 3\)"):
        sg.over(near, sg.Image(np.zeros((3, 2, 4), np.float32)))


@pytest.mark.parametrize("how", ["over", "sum", "max", "min", "mean"])
def test_joining_does_not_depend_on_the_tree(how: str, rng: np.random.Generator) -> None:
    """Five parts, cropped to what is seen of them, one of which is empty."""
    samples = [np.zeros((9, 11, 4), np.float32) for _ in range(5)]
    for each, (x, y) in zip(samples, ((0, 0), (3, 2), (6, 4), (2, 5)), strict=False):
        each[y : y + 4, x : x + 5] = rng.random((4, 5, 4)) * (1 if how in ("over", "sum") else [1, 1, 0, 0])
    parts = [PicturePart.of(each, n) for n, each in enumerate(samples)]
    assert parts[2].pixels.shape == (4, 5, 4) and (parts[2].x, parts[2].y) == (6, 4) and parts[4].pixels.size == 0
    right = samples[0]
    for each in samples[1:]:
        right = join_samples(how, right, each)
    left = parts[0]
    for part in parts[1:]:
        left = join_parts(how, left, part)
    tree = join_parts(
        how, join_parts(how, join_parts(how, parts[0], parts[1]), join_parts(how, parts[2], parts[3])), parts[4]
    )
    for found in (left, tree):
        assert np.abs(found.whole - right).max() < 1e-6 and found.splats == 10 and right.max() > 0.5


@pytest.mark.long
@pytest.mark.parametrize(
    ("blend", "name"), [*zip(PICTURES, (*VIEWS, "inside", "outside"), strict=True), ("composite", "beside")]
)
def test_parts_add_up_to_the_picture(blend: str, name: str, renderer: sg.Renderer, rng: np.random.Generator) -> None:
    volume = sg.Volume(noise(rng, (30, 27, 32)), spacing=(1, 1.3, 0.8))
    camera, settings = cameras(volume)[name], ALL.replace(blend=blend, background=(0.2, 0.5, 1.0))
    found = bricks_of(volume, RAMP, settings)
    assert found is not None
    bricks = Bricks.of(volume, found.post, 8)
    right = renderer.render_bricks(bricks, camera, settings)
    chosen = renderer.plan_bricks(bricks, camera, settings)
    sheets = chosen.resolved.sheets
    assert sheets is not None
    shells = bricks.shells(sheets, chosen.view, 4)
    assert len(shells) == 4
    parts, read = [], 0
    for shell in shells:
        some = bricks.within(sheets, chosen.view, shell)
        read += len(some.low)
        pixels = renderer.render_part(some, camera, settings)
        parts.append(PicturePart.of(pixels, sum(some.found.values())))
    # what joins three sheets reaches one sheet further to both sides of a part than their splats do
    assert read < 3.05 * len(bricks.low)
    how = chosen.program.appearance.join
    whole = join_parts(how, join_parts(how, parts[0], parts[1]), join_parts(how, parts[2], parts[3]))
    image = renderer.render_joined(bricks, camera, settings, whole.whole, whole.splats)
    assert right.pixels.max() > 0.3 and image.info["splats"] == right.info["splats"]
    # a mean is a quotient of float32 sums, of some hundred terms, that parts add up in another order
    most = (5e-6 if blend == "mean" else 1e-6) * max(right.pixels.max(), 1.0)
    assert np.abs(image.pixels - right.pixels).max() < most
    # each part is needed
    less = renderer.render_joined(bricks, camera, settings, join_parts(how, parts[0], parts[1]).whole, 0)
    assert np.abs(less.pixels - right.pixels).max() > 0.01


# --- workers ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    pytest.importorskip("distributed")
    with connected(2, None, None) as found:
        yield found


@pytest.mark.long
def test_workers_have_the_budget_that_is_set(client: Any) -> None:
    """Of frames of movies, too."""
    for memory in (3 << 30, None):
        with fileio.within(memory):
            (found,) = workers.spread(client, fileio.stated_budget, [("one", ())])
        assert found == ("one", memory)


@pytest.fixture
def saved(tmp_path: Path, rng: np.random.Generator) -> Path:
    np.save(tmp_path / "v.npy", noise(rng, (20, 24, 22)))
    return tmp_path / "v.npy"


@pytest.mark.long
def test_frames_are_the_same_bit_for_bit(client: Any, renderer: sg.Renderer, saved: Path) -> None:
    volume = sg.load(saved)
    views = [sg.Camera.orbit(volume, 30 * n, 20, size=(40, 30)) for n in range(6)]
    found = dict(sg.distributed.render_frames(saved, RAMP, views, client))
    splats = sg.extract(volume, RAMP)
    assert sorted(found) == list(range(6))
    for n, camera in enumerate(views):
        assert np.array_equal(found[n].pixels, renderer.render(splats, camera).pixels) and found[n].pixels.max() > 0.3


@pytest.mark.long
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
@pytest.mark.parametrize("sent", [False, True])
def test_a_picture_in_parts(client: Any, renderer: sg.Renderer, saved: Path, blend: str, sent: bool) -> None:
    volume = sg.load(saved)
    camera, settings = sg.Camera.orbit(volume, 30, 20, size=(40, 30)), Settings(blend=blend, occlusion="off")
    right = renderer.render(sg.extract(volume, RAMP), camera, settings).pixels
    done: list[tuple[int, int]] = []
    told = render_slabs(
        volume if sent else saved, RAMP, camera, settings, None, lambda *each: done.append(each), client
    )
    assert np.abs(told.pixels - right).max() < 1e-5 * max(right.max(), 1.0) and right.max() > 0.3
    assert done[-1][0] == done[-1][1] == told.info["parts"] and told.info["level"] == 0


@pytest.mark.long
def test_regions_in_parts(client: Any, renderer: sg.Renderer, saved: Path) -> None:
    """Workers take the regions over gradients, as the whole picture does."""
    volume, settings = sg.load(saved), Settings(occlusion="off")
    transfer = sg.Transfer(regions=["box:0.3,0.7,0.12,0.5:#ff8800:0.7", "triangle:0.3,0.8,0,0.4:#2266ff:0.3"])
    camera = sg.Camera.orbit(volume, 30, 20, size=(20, 15))
    right = renderer.render(sg.extract(volume, transfer, classification="post"), camera, settings).pixels
    image = render_slabs(saved, transfer, camera, settings, None, None, client)
    assert right[..., 3].max() > 0.3 and np.abs(image.pixels - right).max() < 1e-6


@pytest.mark.long
def test_memory_is_said_in_words(saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    allow_any_memory(monkeypatch)
    camera = sg.Camera.orbit(sg.load(saved), size=(8, 8))
    found = [sg.render_slabs(saved, RAMP, camera, memory=memory).info["bricks"] for memory in ("1MB", "64GiB", None)]
    assert found == [1, 0, 0]
    with pytest.raises(sg.InputError, match=r"^memory: expected a number of bytes, such as 4GiB or 500MB, got 'much'"):
        sg.render_slabs(saved, RAMP, camera, memory="much")


@pytest.mark.long
def test_what_workers_refuse_is_told(client: Any, saved: Path, tmp_path: Path) -> None:
    camera = sg.Camera.orbit(sg.load(saved), size=(8, 8))
    with pytest.raises(
        sg.InputError, match=r"^a picture in parts: expected values .*, got classification pre;.*tcp://"
    ):
        render_slabs(saved, RAMP, camera, Settings(classification="pre"), client=client)
    with pytest.raises(sg.InputError, match=r"gone\.npy: path: expected a file, got no such file.* \(on worker tcp://"):
        render_slabs(tmp_path / "gone.npy", RAMP, camera, client=client)
    store = sg.Volume(Store(np.zeros((4, 4, 4))))
    with pytest.raises(sg.InputError, match=r"^source: expected a path that workers open, .* got a store; give its"):
        render_slabs(store, RAMP, camera, client=client)
    with pytest.raises(sg.InputError, match=r"gone\.npy"):
        list(sg.distributed.render_frames(tmp_path / "gone.npy", RAMP, [camera], client))


class Store:
    """What is read in parts."""

    def __init__(self, array: np.ndarray) -> None:
        self.array, self.shape, self.dtype = array, array.shape, array.dtype

    def __getitem__(self, key: Any) -> np.ndarray:
        return np.asarray(self.array[key])


def killing(marker: str, times: int, value: int) -> int:
    """On a worker: ends its process, so many times."""
    path = Path(marker)
    done = len(path.read_text()) if path.exists() else 0
    if done < times:
        path.write_text("x" * (done + 1))
        os.kill(os.getpid(), signal.SIGKILL)
    return value


@pytest.mark.long
def test_work_of_a_worker_that_dies_is_done_again(client: Any, tmp_path: Path) -> None:
    items = [(f"frame {n}", (str(tmp_path / "once"), 1 if n == 3 else 0, n)) for n in range(8)]
    assert sorted(found for _, found in workers.spread(client, killing, items)) == list(range(8))
    assert (tmp_path / "once").read_text() == "x"


@pytest.mark.long
def test_work_that_kills_its_workers_is_given_up(client: Any, tmp_path: Path) -> None:
    items = [(f"frame {n}", (str(tmp_path / f"m{n}"), 99 if n == 2 else 0, n)) for n in range(6)]
    done = list[int]()
    with pytest.raises(sg.InputError, match=r"^frame 2: its worker died 3 times, most likely out of memory; try --mem"):
        done.extend(found for _, found in workers.spread(client, killing, items))
    assert len((tmp_path / "m2").read_text()) == 3
    client.wait_for_workers(2, timeout=60)


@pytest.mark.long
def test_what_was_started_otherwise_is_told(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    workers.check_workers(client)
    monkeypatch.setattr("splatgl.__version__", "9.9")
    with pytest.raises(sg.InputError, match=r"^worker tcp://.*: expected splatgl 9\.9 and Python .*, got splatgl 0"):
        workers.check_workers(client)


def test_devices_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    few = workers.Drawing(devices=(0, 2))
    assert [workers.device_of(few, n) for n in range(4)] == [0, 2, 0, 2]
    monkeypatch.setattr(workers, "graphics_cards", lambda: (1, 3))
    assert [workers.device_of(workers.Drawing(), n) for n in range(3)] == [1, 3, 1]
    assert workers.device_of(workers.Drawing("osmesa"), 0) is None
    assert workers.device_of(workers.Drawing(device=2), 1) == 2
    monkeypatch.setattr(workers, "graphics_cards", lambda: (1,))
    assert workers.device_of(workers.Drawing(), 5) is None


# --- the command line -------------------------------------------------------------------------------------------------


def frames(folder: Path) -> list[np.ndarray]:
    return [np.load(path) for path in sorted(folder.glob("*.npy"))]


@pytest.mark.long
@pytest.mark.parametrize("options", [[], ["--blend", "xray"], ["--moments", "2"]], ids=str)
def test_animations_with_a_scheduler(client: Any, saved: Path, tmp_path: Path, options: list[str]) -> None:
    """Another process's workers draw the same frames; those that are there are kept."""
    asked = ["animate", str(saved), "--frames", "4", "--size", "32", "--quiet", *options]
    address = client.scheduler.address
    assert main([*asked, "-o", str(tmp_path / "a" / "{frame}.npy")]) == 0
    assert main([*asked, "-o", str(tmp_path / "b" / "{frame}.npy"), "--only", "0-1"]) == 0
    before = (tmp_path / "b" / "1.npy").stat().st_mtime_ns
    resumed = ["--resume", "--scheduler", address]
    assert main([*asked, "-o", str(tmp_path / "b" / "{frame}.npy"), *resumed]) == 0
    if not options:
        sg.animate(saved, tmp_path / "c" / "{frame}.npy", frames=4, size=32, only=(2, 2), scheduler=address)
    first, second = frames(tmp_path / "a"), frames(tmp_path / "b")
    assert len(second) == 4 and all(np.array_equal(*both) for both in zip(first, second, strict=True))
    assert (tmp_path / "b" / "1.npy").stat().st_mtime_ns == before
    assert options or np.array_equal(frames(tmp_path / "c")[0], first[2])


@pytest.mark.long
def test_a_series_with_a_scheduler(
    client: Any, saved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Workers draw the look of the whole series, and options without effect are told once."""
    monkeypatch.chdir(tmp_path)
    for n in range(3):
        np.save(f"s{n}.npy", n * np.load(saved).astype(np.float32))
    asked = ["animate", "s0.npy", "s1.npy", "s2.npy", "--size", "32", "--samples", "2", "--background", "transparent"]
    for folder, by in (("a", []), ("b", ["--scheduler", client.scheduler.address])):
        assert main([*asked, "-o", f"{folder}/{{frame}}.npy", *by]) == 0
        said = capsys.readouterr().err
        assert said.count("samples: no effect") == said.count("all use the transfer function of s2.npy") == 1
    first, second = frames(tmp_path / "a"), frames(tmp_path / "b")
    assert len(second) == 3 and all(np.array_equal(*both) for both in zip(first, second, strict=True))
    assert not first[0].any() and first[2].any()


@pytest.mark.long
def test_a_picture_with_a_scheduler(
    client: Any, saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["render", str(saved), "--size", "12", "--blend", "mip"]
    assert main([*asked, "-o", str(tmp_path / "a.npy"), "--scheduler", client.scheduler.address]) == 0
    assert "checked pixels" in capsys.readouterr().out
    assert main([*asked, "-o", str(tmp_path / "b.npy")]) == 0
    assert np.abs(np.load(tmp_path / "a.npy") - np.load(tmp_path / "b.npy")).max() < 1e-5


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--workers", "0"], "--workers: expected a whole number from 1 to 1024, got 0"),
        (["--workers", "2", "--scheduler", "tcp://x:1"], "--workers: expected either it or --scheduler, got both"),
        (["--devices", "0,1"], "--devices: expected --workers or --scheduler with it, got neither"),
        (["--devices", "0", "--device", "1", "--workers", "1"], "--devices: expected either it or --device, got both"),
        (["--scheduler", "tcp://127.0.0.1:9"], "tcp://127.0.0.1:9: no Dask scheduler of this version answers: "),
        (["--scheduler", "nonsense"], "nonsense: no Dask scheduler of this version answers: "),
        (
            ["--workers", "1", "--threshold", "0.1"],
            "--threshold: expected none, with --workers or --scheduler, got 0.1",
        ),
        (["--workers", "1", "--explain"], "--explain: expected a picture rendered by this process, got --workers"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_options(
    options: list[str],
    said: str,
    saved: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "TIMEOUT", 0.5)
    assert main(["render", str(saved), "-o", str(tmp_path / "a.png"), "--size", "8", *options]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"splatgl: {said}") and error.count("\n") == 1 and not (tmp_path / "a.png").exists()


@pytest.mark.parametrize("address", ["nonsense", "tcp://127.0.0.1:9"])
def test_dask_computes_as_before_where_no_scheduler_answers(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    dask = pytest.importorskip("dask")
    monkeypatch.setattr(workers, "TIMEOUT", 0.5)
    with dask.config.set(scheduler="sync"):
        with pytest.raises(sg.InputError, match="no Dask scheduler"), connected(None, address, None):
            pass
        assert dask.config.get("scheduler") == "sync" and dask.delayed(abs)(-1).compute() == 1


@pytest.mark.parametrize("address", ["nonsense", "tcp://127.0.0.1:9"])
def test_clients_that_find_no_scheduler_are_closed(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """At once, not when they are freed, which may be while the next one starts: each would wait for the other."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "TIMEOUT", 0.5)
    made = []
    start = distributed.Client.start
    monkeypatch.setattr(distributed.Client, "start", lambda self, **how: (made.append(self), start(self, **how))[1])
    with pytest.raises(sg.InputError, match="no Dask scheduler"), connected(None, address, None):
        pass
    assert [each.status for each in made] == ["closed"]


@pytest.mark.long
def test_dask_computes_as_before_beside_workers(client: Any) -> None:
    """Nor does what finds no scheduler meanwhile become what Dask computes with, once it is freed."""
    dask = pytest.importorskip("dask")
    assert dask.config.get("scheduler", None) is None and dask.delayed(os.getpid)().compute() == os.getpid()
    with pytest.raises(sg.InputError, match="no Dask scheduler"), connected(None, "nonsense", None):
        pass
    gc.collect()
    assert dask.config.get("scheduler", None) is None


@pytest.mark.long
def test_a_scheduler_without_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "TIMEOUT", 1.0)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as empty,
        pytest.raises(sg.InputError, match=r"^tcp://.*: expected at least one worker, got none; start some with: dask"),
        connected(None, empty.scheduler_address, None),
    ):
        pass


@pytest.mark.long
def test_interrupted_frames_are_whole(saved: Path, tmp_path: Path) -> None:
    """Ctrl-C ends workers and leaves whole frames."""
    pytest.importorskip("distributed")
    # a shell's background jobs, and what they start, ignore Ctrl-C
    code = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code += "from splatgl.cli.main import main; sys.exit(main())"
    asked = [sys.executable, "-c", code, "animate", str(saved), "--size", "300", "--frames", "400"]
    asked += ["-o", str(tmp_path / "f" / "{frame}.npy"), "--workers", "2"]
    process = subprocess.Popen(asked, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    while not list(tmp_path.glob("f/[0-9]*.npy")) and process.poll() is None:
        time.sleep(0.1)
    # as a terminal does, to all of its processes
    os.killpg(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=120)
    # after the note on the camera
    *notes, last = error.decode().splitlines()
    assert process.returncode == 130 and "of 400 frames stay in" in last and "--resume" in last
    assert notes[0].startswith("splatgl: the camera fits the whole turn") and notes[1:] == ["splatgl: interrupted"]
    found = frames(tmp_path / "f")
    assert 0 < len(found) < 400 and all(each.shape == (300, 300, 4) for each in found)
    assert not list((tmp_path / "f").glob(".*"))


@pytest.mark.long
def test_workers_listen_to_this_machine(client: Any) -> None:
    """The scheduler, its dashboard, and all workers."""
    psutil = pytest.importorskip("psutil")
    ours = psutil.Process()
    processes = [ours, *ours.children(recursive=True)]
    sockets = [socket for process in processes for socket in process.net_connections("inet")]
    listening = {socket.laddr.ip for socket in sockets if socket.status == psutil.CONN_LISTEN}
    assert listening == {"127.0.0.1"}


@pytest.mark.long
@pytest.mark.parametrize(("asked", "address"), [(None, "127.0.0.1:0"), ("0.0.0.0:8787", "0.0.0.0:8787")])
def test_the_dashboard_listens_to_this_machine(
    monkeypatch: pytest.MonkeyPatch, asked: str | None, address: str
) -> None:
    """Unless Dask's configuration says otherwise."""
    pytest.importorskip("distributed")
    import dask

    found = []

    def started(**given: Any) -> None:
        found.append(given["dashboard_address"])
        raise sg.InputError("enough")

    monkeypatch.setattr("distributed.LocalCluster", started)
    given = {} if asked is None else {"splatgl.dashboard": asked}
    with dask.config.set(given), pytest.raises(sg.InputError, match="enough"), connected(1, None):
        raise AssertionError("no cluster was started")
    assert found == [address]
