"""Files that take the place of others: modes, links, long names; and nothing half-written."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.animation.animation import FrameFiles
from splatgl.animation.movie import write_movie
from splatgl.errors import InputError
from splatgl.fileio import atomic_write, shorten_name, write_file


def picture(path: Path) -> None:
    sg.Image(np.full((4, 4, 4), 0.5, np.float32)).save(path)


def gif(path: Path) -> None:
    picture(path.parent / "frame.png")
    write_movie(path, [path.parent / "frame.png"], 1, 10.0, (0, 0, 0))
    (path.parent / "frame.png").unlink()


def transfer(path: Path) -> None:
    sg.Transfer([(0, 0), (1, 1)]).save(path)


WRITERS: dict[str, Callable[[Path], None]] = {
    "text.txt": lambda path: write_file(path, b"text"),
    "picture.png": picture,
    "picture.npy": picture,
    "movie.gif": gif,
    "transfer.toml": transfer,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_keeps_its_mode(tmp_path: Path, name: str) -> None:
    """One that nobody else may read stays so; new ones have the mode that the umask leaves."""
    target, mask = tmp_path / name, os.umask(0o027)
    try:
        WRITERS[name](target)
        assert stat.S_IMODE(target.stat().st_mode) == 0o640
        for mode in (0o600, 0o664):
            target.write_bytes(b"old")
            target.chmod(mode)
            WRITERS[name](target)
            assert stat.S_IMODE(target.stat().st_mode) == mode and target.read_bytes() != b"old"
    finally:
        os.umask(mask)
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize("there", [True, False], ids=["there", "dangling"])
@pytest.mark.parametrize("name", WRITERS)
def test_links_are_followed(tmp_path: Path, name: str, there: bool) -> None:
    """The file that a link leads to is replaced, through further links and into other folders; the links stay."""
    (tmp_path / "far").mkdir()
    real, link, first = tmp_path / "far" / f"real-{name}", tmp_path / f"link-{name}", tmp_path / name
    if there:
        real.write_bytes(b"old")
        real.chmod(0o600)
    link.symlink_to(Path("far") / real.name)
    first.symlink_to(link)
    WRITERS[name](first)
    assert first.is_symlink() and link.is_symlink() and not real.is_symlink()
    assert real.read_bytes() not in (b"", b"old")
    assert os.listdir(real.parent) == [real.name] and set(os.listdir(tmp_path)) == {"far", link.name, name}
    assert not there or stat.S_IMODE(real.stat().st_mode) == 0o600


@pytest.mark.parametrize("letter", ["a", "é", "面"])
@pytest.mark.parametrize("name", WRITERS)
def test_names_as_long_as_file_systems_have(tmp_path: Path, name: str, letter: str) -> None:
    suffix = Path(name).suffix
    long = letter * ((250 - len(suffix)) // len(letter.encode())) + suffix
    WRITERS[name](tmp_path / long)
    WRITERS[name](tmp_path / long)
    assert os.listdir(tmp_path) == [long]
    short = shorten_name(long)
    assert long.startswith(short) and len(short.encode()) <= 200 and shorten_name(name) == name


def test_long_names_of_movies_and_frames(tmp_path: Path) -> None:
    """Frames lie in a folder beside a movie, and what a killed run left of them is found again."""
    frames = FrameFiles.at(str(tmp_path / ("m" * 246 + ".gif")), "mark")
    write_file(frames.path(3), b"data")
    left = frames.path(3).with_name(f".{shorten_name(frames.path(3).name)}.abcdefgh")
    left.write_bytes(b"half")
    frames.sweep([3])
    assert not left.exists() and frames.path(3).read_bytes() == b"data"
    template = FrameFiles.at(str(tmp_path / ("n" * 240 + "{frame:03d}.png")), "mark")
    with atomic_write(template.path(0)) as temporary:
        kept = temporary.with_name(temporary.name + "x")
        temporary.replace(kept)
        temporary.write_bytes(b"")
    assert kept.exists()
    template.sweep([0])
    assert not kept.exists()


def test_what_cannot_be_replaced_is_told(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    for name in ("folder", "loop", "pipe"):
        with pytest.raises(InputError, match=f"{name}: cannot be written: "):
            write_file(tmp_path / name, b"data")
    assert set(os.listdir(tmp_path)) == {"folder", "loop", "pipe"}


def test_work_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    def work() -> None:
        with atomic_write(tmp_path / "file") as temporary:
            temporary.write_bytes(b"half")
            raise ValueError("no")

    (tmp_path / "file").write_bytes(b"old")
    with pytest.raises(ValueError, match="no"):
        work()
    assert os.listdir(tmp_path) == ["file"] and (tmp_path / "file").read_bytes() == b"old"
