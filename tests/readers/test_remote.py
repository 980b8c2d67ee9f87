"""Volumes behind addresses, from a server of the test's own: what is fetched, kept and asked again, and what fails."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.readers import remote
from splatgl.readers.remote import address_name, is_address
from splatgl.scene.scene_file import SceneFile
from tests.helpers.bricks import noise
from tests.helpers.levels import SOFT, with_levels, write

pytestmark = pytest.mark.usefixtures("shared_programs")

pytest.importorskip("fsspec", reason="needs the extra remote")
pytest.importorskip("aiohttp", reason="needs the extra remote")


class Server:
    """Serves a folder. asked: how often each path was; faults: what happens to a path instead, so many times."""

    def __init__(self, folder: Path) -> None:
        self.asked: Counter[str] = Counter()
        self.faults: dict[str, list[str]] = {}
        server = self

        class Handler(SimpleHTTPRequestHandler):
            def do_GET(self) -> None:
                server.asked[self.path] += 1
                waiting = server.faults.get(self.path, server.faults.get("*", []))
                fault = waiting.pop(0) if waiting else ""
                if fault == "stall":
                    time.sleep(1.0)
                elif fault:
                    self.send_error(int(fault))
                else:
                    super().do_GET()

            def log_message(self, *_: Any) -> None:
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder)))
        threading.Thread(target=self.http.serve_forever, daemon=True).start()

    def __call__(self, name: str) -> str:
        return f"http://127.0.0.1:{self.http.server_port}/{name}"

    def close(self) -> None:
        self.http.shutdown()
        self.http.server_close()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SPLATGL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(remote, "WAIT", 0.01)
    (tmp_path / "served").mkdir()
    return tmp_path / "served"


@pytest.fixture
def server(folder: Path) -> Iterator[Server]:
    found = Server(folder)
    yield found
    found.close()


@pytest.fixture
def volume() -> sg.Volume:
    return with_levels(sg.Volume(noise(np.random.default_rng(1), (40, 40, 40)), spacing=(1, 1, 2)), 2)


@pytest.fixture
def store(folder: Path, volume: sg.Volume) -> None:
    write(folder / "v.ome.zarr", volume)


def chunks(server: Server) -> set[str]:
    return {path for path in server.asked if path.rsplit("/", 1)[-1][0].isdigit()}


def test_addresses() -> None:
    assert is_address("https://a.b/c.nrrd") and is_address("s3://bucket/x") and is_address("memory://x")
    assert not is_address("a.nrrd") and not is_address("C:/x.nrrd") and not is_address(Path("https://a"))
    assert address_name("https://a.b/c/d.ome.zarr/?x=1#2") == "d.ome.zarr"


def test_a_store_is_read_in_the_chunks_that_are_needed(server: Server, store: None, volume: sg.Volume) -> None:
    found = sg.load(server("v.ome.zarr"))
    assert found.name == "v" and found.shape == volume.shape and found.spacing == volume.spacing
    assert len(found.coarser) == 2 and not chunks(server)
    assert np.array_equal(found.samples[:16, :16, 20:30], volume.samples[:16, :16, 20:30])
    assert chunks(server) == {"/v.ome.zarr/0/0.0.1"}
    assert np.array_equal(found.samples[:], volume.samples) and len(chunks(server)) == 27
    # another process asks for the metadata again, and for no chunk
    before = Counter({path: server.asked[path] for path in chunks(server)})
    again = sg.load(server("v.ome.zarr"))
    assert np.array_equal(again.samples[:], volume.samples)
    assert before == Counter({path: server.asked[path] for path in chunks(server)})
    # the coarsest level of a small picture: nothing of the finest but the boxes that were compared
    level = sg.load(server("v.ome.zarr"), level=2)
    assert np.array_equal(level.samples[:], volume.coarser[1].samples)


def test_chunks_that_are_not_stored(server: Server, folder: Path) -> None:
    zarr = pytest.importorskip("zarr")
    array = zarr.create_array(folder / "a", shape=(40, 40, 40), chunks=(20,) * 3, dtype="i2", fill_value=-3)
    array[:20, :20, :20] = 5
    volume = sg.load(server("a"))
    for _ in range(2):
        found = volume.samples[:]
        assert (found[:20, :20, :20] == 5).all() and (found[20:] == -3).all()
    assert max(server.asked[path] for path in server.asked if "/c/" in path) == 1


def test_a_single_file_is_fetched_once(server: Server, folder: Path, volume: sg.Volume) -> None:
    np.save(folder / "v.npy", volume.samples)
    for _ in range(2):
        found = sg.load(server("v.npy"))
        assert np.array_equal(found.samples, volume.samples) and found.name == "v"
    assert server.asked["/v.npy"] == 1
    # another file of that name
    np.save(folder / "v.npy", volume.samples[:20])
    assert sg.load(server("v.npy")).shape == (20, 40, 40)


def test_another_image_behind_the_same_address(server: Server, folder: Path, store: None, volume: sg.Volume) -> None:
    sg.load(server("v.ome.zarr")).samples[:]
    other = sg.Volume(1 - volume.samples, spacing=(1, 1, 3))
    write(folder / "v.ome.zarr", other)
    found = sg.load(server("v.ome.zarr"))
    assert found.spacing == (1, 1, 3) and np.array_equal(found.samples[:], other.samples)


def test_arrays_of_another_size_behind_the_same_address(
    server: Server, folder: Path, store: None, volume: sg.Volume
) -> None:
    sg.load(server("v.ome.zarr")).samples[:]
    write(folder / "v.ome.zarr", with_levels(sg.Volume(1 - volume.samples[:24], spacing=volume.spacing), 2))
    found = sg.load(server("v.ome.zarr"))
    assert np.array_equal(found.samples[:], 1 - volume.samples[:24])


def test_failures_are_tried_again(server: Server, store: None, volume: sg.Volume, monkeypatch: Any) -> None:
    monkeypatch.setattr(remote, "ANSWER", 0.2)
    server.faults = {"/v.ome.zarr/.zattrs": ["500", "503"], "/v.ome.zarr/0/0.0.0": ["stall", "500", "429"]}
    found = sg.load(server("v.ome.zarr"))
    assert np.array_equal(found.samples[:16, :16, :16], volume.samples[:16, :16, :16])
    assert server.asked["/v.ome.zarr/0/0.0.0"] == 4


@pytest.mark.parametrize(
    ("name", "fault", "said"),
    [
        ("nothing.zarr", "", "expected a file, or a Zarr store, got none; check it"),
        ("nothing.npy", "", "expected a file, or a Zarr store, got nothing there; check it"),
        ("v.ome.zarr", "500", "no answer in 4 attempts: 500"),
        ("v.ome.zarr", "stall", "no answer in 4 attempts: "),
    ],
)
def test_what_is_not_there_is_told_in_one_line(
    name: str, fault: str, said: str, server: Server, store: None, monkeypatch: Any, capsys: Any, tmp_path: Path
) -> None:
    monkeypatch.setattr(remote, "ANSWER", 0.2)
    server.faults = {"*": [fault] * 50} if fault else {}
    monkeypatch.chdir(tmp_path)
    assert main(["render", server(name), "-o", "x.png"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"splatgl: {server(name)}: ") and said in error and error.count("\n") == 1
    assert not Path("x.png").exists()


def test_no_server_and_no_package(folder: Path, capsys: Any, monkeypatch: Any) -> None:
    assert main(["info", "http://127.0.0.1:9/v.zarr"]) == 2
    assert "no answer in 4 attempts: " in capsys.readouterr().err
    assert main(["info", "nonsense://a/v.zarr"]) == 2
    assert "address: expected a protocol that fsspec knows, got nonsense" in capsys.readouterr().err
    monkeypatch.setitem(__import__("sys").modules, "fsspec", None)
    assert main(["info", "https://a.b/v.zarr"]) == 2
    assert "pip install 'splatgl[remote]'" in capsys.readouterr().err


def test_a_damaged_chunk(server: Server, folder: Path, store: None) -> None:
    chunk = folder / "v.ome.zarr" / "0" / "1.1.1"
    chunk.write_bytes(chunk.read_bytes()[:12])
    found = sg.load(server("v.ome.zarr"))
    with pytest.raises(sg.InputError, match=r"chunk 1.1.1: expected 12 bytes stored"):
        found.samples[:]


@pytest.mark.long
def test_pictures_and_scenes(server: Server, store: None, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    asked = ["--points", "0.2:0,0.8:0.05", "--size", "8", "--level", "0", "--check", "0", "--quiet", "-o"]
    assert main(["render", server("v.ome.zarr"), *asked, "a.npy"]) == 0
    assert main(["render", str(tmp_path / "served" / "v.ome.zarr"), *asked, "b.npy"]) == 0
    assert np.array_equal(np.load("a.npy"), np.load("b.npy")) and np.load("a.npy").max() > 0.1
    scene = SceneFile(server("v.ome.zarr"), transfer={"points": SOFT.points})
    (tmp_path / "s.toml").write_text(scene.to_toml(tmp_path))
    assert SceneFile.from_toml(tmp_path / "s.toml").volume == server("v.ome.zarr")


def test_names_stay_inside_the_copy(server: Server, store: None) -> None:
    found = remote.Remote(server("v.ome.zarr"))
    for name in ("../x", "a/../../x", "/etc/passwd"):
        with pytest.raises(sg.InputError, match="inside the store"):
            found.path(name)
