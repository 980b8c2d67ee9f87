"""Random input for the window: keys, drags, wheel, drops and resizes by real events; tracebacks and memory are watched.

    .venv/bin/python -m tests.fuzz.window [FILE …] [--seconds S] [--seed N] [--log FILE]

Needs Xvfb and xdotool. FILE: what is opened first, and dropped now and then; two small files of its own by default.
Memory is compared where the same picture is at rest: now and then the first file is shown as it was at first. Ends with
1 after a traceback, a window that ends or hangs, or memory that grows.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

import numpy as np
from PIL import ImageGrab

ROOT = Path(__file__).resolve().parents[2]
DRAG_SOURCE = ROOT / "tests" / "helpers" / "drag_source.py"
SCREEN = 900, 700
# X's names of the keys that are pressed; those that quit are left out
LETTERS = "abcdefghijklmnoprstuvwxyz0123456789"
NAMED = (
    "space Tab Escape F1 F6 Home End Left Right Up Down Prior Next Return bracketleft bracketright comma period less"
)
HELD = "ctrl+z ctrl+shift+z ctrl+o ctrl+s ctrl+p ctrl+d ctrl+x ctrl+1 shift+s shift+y"
KEYS = (*LETTERS, *NAMED.split(), "greater", "question", "plus", "minus", *HELD.split())
# inputs after which memory is expected to be flat, beside a third of the rests: the renderer holds all the programs by
# then that it holds at most, some 100 MB with llvmpipe, and libraries of movies and dialogs are loaded; by how much it
# may grow from there, from so many rests to as many later ones; time from one rest to the next, as a share of all
WARM, GROWTH, LEAST_RESTS, REST_EVERY = 600, 1.05, 8, 1 / 60
# presses of Escape that end all that may be open or go on, and seconds between them: each ends one thing of a frame
ESCAPES, APART = 8, 0.5
# seconds after which a key answers the question whether edits are saved before another file is opened, and after which
# the file is dropped again
ANSWERED, AGAIN = 3.0, 20.0
# seconds without an answer to a key after which the window hangs, on a busy machine, too, and for which a picture at
# rest has been refined
HANGS, STILL = 300.0, 3.0
PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass
class Session:
    """A window on a display of its own, with a generator that decides what is done to it."""

    files: Sequence[Path]
    seed: int
    folder: Path
    environment: dict[str, str] = field(default_factory=dict)
    done: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        read, write = os.pipe()
        screen = f"{SCREEN[0]}x{SCREEN[1]}x24"
        command = ["Xvfb", "-displayfd", str(write), "-screen", "0", screen, "-nolisten", "tcp", "-noreset"]
        self.server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with os.fdopen(read) as pipe:
            number = pipe.readline().strip()
        self.environment = {**os.environ, "DISPLAY": f":{number}", "SPLATGL_RECENT": "off"}
        self.errors = (self.folder / f"errors-{self.seed}.txt").open("w+")
        # a window that hangs is aborted, and says where
        python = [sys.executable, "-X", "faulthandler"]
        view = [*python, "-m", "splatgl", "view", str(self.files[0]), "--folder", str(self.folder)]
        self.window = subprocess.Popen([*view, "--size", "640x480"], env=self.environment, stderr=self.errors)
        self.chance = random.Random(self.seed)
        search = ["search", "--sync", "--onlyvisible", "--all", "--pid", str(self.window.pid), "--name", ""]
        self.identity = self.hands(*search).split()[-1]

    def hands(self, *arguments: object) -> str:
        """Runs xdotool; returns what it prints."""
        command = ["xdotool", *map(str, arguments)]
        found = subprocess.run(command, env=self.environment, capture_output=True, text=True, timeout=HANGS)
        return found.stdout

    def place(self) -> tuple[int, int]:
        """A place in the window, one of three times where the panel is."""
        left = 640 - 330 if self.chance.random() < 1 / 3 else 0
        return self.chance.randrange(left, 640), self.chance.randrange(480)

    def once(self) -> None:
        """Does one thing."""
        kinds = [self.key, self.drag, self.wheel, self.click, self.resize, self.drop, self.word]
        act = self.chance.choices(kinds, (30, 25, 15, 20, 2, 3, 5))[0]
        self.done.append(act())

    def key(self) -> str:
        """One to three keys."""
        keys = self.chance.choices(KEYS, k=self.chance.randint(1, 3))
        self.hands("key", *keys)
        return f"key {' '.join(keys)}"

    def word(self) -> str:
        """Something typed into whatever takes it: a number in a field of the panel."""
        x, y = self.place()
        text = self.chance.choice(("0.5", "1e9", "-3", "abc", ""))
        self.hands("mousemove", x, y, "keydown", "ctrl", "click", 1, "keyup", "ctrl", "type", text)
        self.hands("key", "Return")
        return f"word {x} {y} {text}"

    def drag(self) -> str:
        """A drag of any button, with or without a modifier."""
        button, held = self.chance.choice((1, 1, 1, 2, 3)), self.chance.choice(("", "", "shift", "ctrl"))
        places = [self.place() for _ in range(4)]
        moves = [part for place in places[1:] for part in ("mousemove", *place)]
        down, up = (("keydown", held), ("keyup", held)) if held else ((), ())
        self.hands("mousemove", *places[0], *down, "mousedown", button, *moves, "mouseup", button, *up)
        return f"drag {button} {held} {places}"

    def wheel(self) -> str:
        """Some notches of the wheel."""
        (x, y), button, count = self.place(), self.chance.choice((4, 5)), self.chance.randint(1, 6)
        self.hands("mousemove", x, y, "click", "--repeat", count, "--delay", 5, button)
        return f"wheel {x} {y} {button} {count}"

    def click(self) -> str:
        """One or two clicks."""
        (x, y), button, count = self.place(), self.chance.choice((1, 1, 1, 3)), self.chance.randint(1, 2)
        self.hands("mousemove", x, y, "click", "--repeat", count, "--delay", 30, button)
        return f"click {x} {y} {button} {count}"

    def resize(self) -> str:
        """Another size, back to the first one half of the time."""
        size = (640, 480) if self.chance.random() < 0.5 else (self.chance.randint(1, 900), self.chance.randint(1, 700))
        self.hands("windowsize", self.identity, *size)
        return f"resize {size}"

    def drop(self) -> str:
        """One file or several, now and then one that is not there."""
        some = self.chance.sample(self.files, self.chance.randint(1, len(self.files)))
        paths = [self.folder / "nothing.npy"] if self.chance.random() < 0.2 else some
        command = [sys.executable, str(DRAG_SOURCE), self.identity, *map(str, paths)]
        subprocess.run(command, env=self.environment, timeout=HANGS, check=False)
        return f"drop {[path.name for path in paths]}"

    def rested(self) -> float:
        """Megabytes held while the first file, by a name of its own, is shown at rest as a scene without settings."""
        name = f"rest-{self.seed}-{len(self.done)}"
        volume = self.folder / f"{name}{''.join(self.files[0].suffixes)}"
        volume.symlink_to(self.files[0].resolve())
        scene = self.folder / f"{name}.toml"
        scene.write_text(f"volume = {json.dumps(str(volume))}\n")
        end, since, dropped = time.monotonic() + HANGS, time.monotonic(), -AGAIN
        # what is given up is freed at rest
        while time.monotonic() - since < STILL and self.window.poll() is None:
            title, now = self.hands("getwindowname", self.identity), time.monotonic()
            if not (title.startswith(f"{name} ") and "refined" in title):
                since = now
            if now > end:
                raise subprocess.TimeoutExpired(f"a refined picture; the title is {title.strip()!r}", HANGS)
            if name in title:
                time.sleep(0.2)
            elif now - dropped < AGAIN:
                # answers the question whether edits are saved before
                time.sleep(ANSWERED)
                self.hands("key", "Return")
            else:
                # a busy window may have answered that by an Escape from before
                self._show(scene)
                dropped = time.monotonic()
        self.done.append("rest")
        return self.megabytes

    def _show(self, scene: Path) -> None:
        """Drops a scene file once what turns, plays, is open or is being read has ended."""
        for _ in range(ESCAPES):
            self.hands("key", "Escape")
            time.sleep(APART)
        self.hands("windowsize", self.identity, 640, 480)
        command = [sys.executable, str(DRAG_SOURCE), self.identity, str(scene)]
        subprocess.run(command, env=self.environment, timeout=HANGS, check=False)

    @property
    def megabytes(self) -> float:
        """Memory that the window's process holds."""
        return int(Path(f"/proc/{self.window.pid}/statm").read_text().split()[1]) * PAGE / 2**20

    def look(self, picture: Path) -> None:
        """Writes what the screen shows."""
        ImageGrab.grab(xdisplay=self.environment["DISPLAY"]).save(picture)

    def end(self) -> str:
        """Ends the window and its display; returns what it wrote to the standard error."""
        if self.window.poll() is None:
            self.window.terminate()
        self.window.wait(HANGS)
        self.server.terminate()
        self.server.wait(HANGS)
        self.errors.seek(0)
        return self.errors.read()


def run(files: Sequence[Path], seed: int, seconds: float, folder: Path, log: TextIO | None = None) -> list[str]:
    """What went wrong in so many seconds of random input; a window that a menu closed is followed by another one. log:
    gets seconds, megabytes and input.
    """
    end, wrong = time.monotonic() + seconds, list[str]()
    for number in itertools.count():
        left = end - time.monotonic()
        if left <= 0 or wrong:
            return wrong
        wrong = _run_window(files, seed + number, left, REST_EVERY * seconds, folder, log)
    return wrong


def _run_window(
    files: Sequence[Path], seed: int, seconds: float, apart: float, folder: Path, log: TextIO | None
) -> list[str]:
    """What went wrong in one window. apart: seconds from one rest to the next."""
    session = Session(files, seed, folder)
    begun, memory, wrong = time.monotonic(), [], []
    rests: list[tuple[int, float]] = []
    while (gone := time.monotonic() - begun) < seconds and session.window.poll() is None:
        try:
            session.once()
            if gone > len(rests) * apart:
                rests.append((len(session.done), session.rested()))
        except subprocess.TimeoutExpired as error:
            if session.window.poll() is not None:
                # a drop into nothing waits for an answer
                break
            wrong.append(f"hangs after {session.done[-5:]}: {error}")
            session.look(Path(f"hangs-{seed}.png"))
            session.window.send_signal(signal.SIGABRT)
            session.window.wait(HANGS)
            break
        if session.window.poll() is None:
            memory.append((gone, session.megabytes))
            if log is not None:
                print(f"{gone:.1f} {memory[-1][1]:.0f} {session.done[-1]}", file=log, flush=True)
    ended = "closed by a menu, " if session.window.poll() == 0 else ""
    if session.window.poll() and not wrong:
        wrong.append(f"ended with {session.window.returncode} after {session.done[-5:]}")
    said = session.end()
    if wrong or "Traceback" in said:
        wrong.append(said)
    warm = [size for inputs, size in rests[len(rests) // 3 :] if inputs > WARM]
    half = len(warm) // 2
    told = "too short for memory"
    if half >= LEAST_RESTS:
        earlier, later = statistics.median(warm[:half]), statistics.median(warm[half:])
        most = max(size for _, size in memory)
        told = f"at rest {earlier:.0f} then {later:.0f} MB, {most:.0f} at most"
        if later > GROWTH * earlier:
            wrong.append(f"memory grows: {told}")
    print(" ".join(f"{size:.0f}" for _, size in rests))
    print(f"seed {seed}: {len(session.done)} inputs in {gone:.0f} s, {ended}{told}, {len(wrong)} faults", flush=True)
    return wrong


def own_files(folder: Path) -> list[Path]:
    """Two balls of other sizes."""
    paths = []
    for side in (24, 40):
        z, y, x = np.indices((side, side, side)) - (side - 1) / 2
        paths.append(folder / f"ball{side}.npy")
        np.save(paths[-1], np.clip(side * 0.45 - np.sqrt(x * x + y * y + z * z), 0, None).astype(np.float32))
    return paths


def main() -> int:
    """Runs one seed; returns 1 if anything went wrong."""
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, help="write seconds, megabytes and what was done after each input")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as place, args.log.open("w") if args.log else nullcontext() as log:
        wrong = run(args.files or own_files(Path(place)), args.seed, args.seconds, Path(place), log)
    print("\n".join(wrong))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
