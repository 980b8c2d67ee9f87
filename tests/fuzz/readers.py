"""Fuzzes each reader with thousands of mutated files: each must load or raise one clear error, within limits.

    .venv/bin/python -m tests.fuzz.readers [--count 10000] [--reader NAME] [--seed N] [--keep FOLDER]

Two processes read the files, each limited to LIMIT bytes beyond its memory after imports, and SECONDS of processor
time per file (WALL seconds of wall time). Loaded files are summed and described. Prints a table; exit code 1 if a
reader raised anything but an InputError naming the file, printed, crashed, hung, exceeded a limit, or left anything
behind: handles, maps, processes, temporary files, memory.
"""

from __future__ import annotations

import argparse
import ast
import multiprocessing
import multiprocessing.connection
import os
import random
import re
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from splatgl.errors import InputError, InputWarning
from tests.fuzz.seed_files import Seed
from tests.fuzz.seeds import SEEDS
from tests.fuzz.watch import Watch, read, start_elsewhere

LIMIT = 2**30
"""Bytes of address space, and of resident memory, that reading one file may add: twice the readers' MAX_BYTES."""

SECONDS, WALL = 2.0, 15.0
"""Longest time for one file: of the processor, and on a clock that other work on the machine slows down."""

PROCESSES = 2
WIDTH = 10
FAULTS = ("other", "printed", "crash", "hang", "over", "leak")
NUMBERS: tuple[str, ...] = ("0", "-1", "1", "3", "255", "65535", "99999", "2147483647", "4294967296")
NUMBERS += ("9223372036854775807", "1e308", "99999999999999999999999", "-9999999", "nan", "inf", "1.5")
NUMBERS += ("1e-320", "9" * 5000)
WHOLES = (0, 1, 2, -1, -2, 7, 255, 32767, 65535, 10**6, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1)

Mutation = Callable[[bytes, random.Random, bytes], bytes]


# --- mutations: data, chance, data of another seed → data -------------------------------------------------------------


def truncate(data: bytes, chance: random.Random, _other: bytes) -> bytes:
    return data[: chance.randrange(len(data) + 1)]


def flip_bits(data: bytes, chance: random.Random, _other: bytes) -> bytes:
    out = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 4, 16))):
        place = _early(chance, len(out))
        out[place] ^= 1 << chance.randrange(8)
    return bytes(out)


def overwrite(data: bytes, chance: random.Random, _other: bytes) -> bytes:
    start, length = _early(chance, len(data)), chance.randint(1, 64)
    run = chance.choice((b"\0" * length, b"\xff" * length, chance.randbytes(length), b"9" * length))
    return data[:start] + run + data[start + length :]


def insert(data: bytes, chance: random.Random, _other: bytes) -> bytes:
    start = _early(chance, len(data))
    return data[:start] + chance.choice((chance.randbytes(9), b"\n", b" ", b"((((", data[:200])) + data[start:]


def remove(data: bytes, chance: random.Random, _other: bytes) -> bytes:
    start = _early(chance, len(data))
    return data[:start] + data[start + chance.choice((1, 4, 60)) :]


def splice(data: bytes, chance: random.Random, other: bytes) -> bytes:
    return data[: chance.randrange(len(data) + 1)] + other[chance.randrange(len(other) + 1) :]


def number(data: bytes, chance: random.Random, _other: bytes) -> bytes:
    """Replaces a number written in digits."""
    places = [found.span() for found in re.finditer(rb"-?\d+(?:\.\d+)?", data[:6000])]
    if not places:
        return whole(data, chance, _other)
    start, stop = chance.choice(places)
    return data[:start] + chance.choice(NUMBERS).encode() + data[stop:]


def whole(data: bytes, chance: random.Random, _other: bytes) -> bytes:
    """Replaces 2, 4 or 8 bytes with another integer."""
    size = chance.choice((2, 4, 8))
    value = (chance.choice(WHOLES) & ((1 << 8 * size) - 1)).to_bytes(size, chance.choice(("little", "big")))
    start = _early(chance, len(data))
    start -= start % 2
    return data[:start] + value + data[start + size :]


def lines(data: bytes, chance: random.Random, _other: bytes) -> bytes:
    """Removes, duplicates or moves a line."""
    parts = data.splitlines(keepends=True)
    if len(parts) < 2:
        return truncate(data, chance, _other)
    place = chance.randrange(min(len(parts), 40))
    line = parts.pop(place) if chance.random() < 0.6 else parts[place]
    if chance.random() < 0.5:
        parts.insert(chance.randrange(min(len(parts), 40) + 1), line)
    return b"".join(parts)


MUTATIONS: tuple[Mutation, ...] = (
    truncate, flip_bits, overwrite, insert, remove, splice, number, number, whole, lines,
)  # fmt: skip


def _early(chance: random.Random, length: int) -> int:
    """A position in the data; half of them in the first 400 bytes, where headers are."""
    return chance.randrange(max(1, min(length, 400) if chance.random() < 0.5 else length))


def mutated(data: bytes, chance: random.Random, other: bytes) -> bytes:
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        data = chance.choice(MUTATIONS)(data or b"\0", chance, other or b"\0")
    return data


# --- one file ---------------------------------------------------------------------------------------------------------


def write(seed: Seed, other: Seed, chance: random.Random, folder: Path) -> Path:
    """Writes a seed into a new folder with one of its files mutated; returns the path to load."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    # 1. which file: mostly the first, the header; and whether to mutate its uncompressed content
    names = list(seed.files)
    victim = names[0] if chance.random() < 0.7 else chance.choice(names)
    data, packed = seed.files[victim], other.files.get(victim) or next(iter(other.files.values()))
    if seed.unpack and seed.pack and chance.random() < 0.6:
        data = seed.pack(mutated(seed.unpack(data), chance, other.unpack(packed) if other.unpack else packed))
    else:
        data = mutated(data, chance, packed)
    # 2. the files; a name that states sizes is mutated too
    main = seed.main
    if seed.name_matters and chance.random() < 0.7:
        main = number(main.encode(), chance, b"").decode()[:200]
    files = {**seed.files, victim: data}
    _place({main if name == seed.main else name: content for name, content in files.items()}, folder)
    return folder / main


def _place(files: Mapping[str, bytes], folder: Path) -> Path:
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder


def outcome(path: Path, kind: str) -> tuple[str, str]:
    """("loaded" | "refused" | a fault, message)."""
    started = time.process_time()
    try:
        with np.errstate(all="ignore"):
            read(path, kind)
        result, said = "loaded", ""
    except InputError as error:
        said = str(error)
        fine = said.isprintable() and str(path.parent) in said and len(said) < len(str(path)) + 500
        result = "refused" if fine else "other"
        if _memory(error):
            result = "over"
    except MemoryError as error:
        result, said = "over", repr(error)
    except Exception as error:
        result, said = "other", repr(error)
    if time.process_time() - started > SECONDS:
        return "hang", f"{time.process_time() - started:.1f} s: {said}"
    return result, said


def _memory(error: BaseException | None) -> bool:
    """Whether a MemoryError is among the causes."""
    while error is not None:
        places = list(traceback.walk_tb(error.__traceback__))
        # Python's parser also raises MemoryError for too deeply nested parentheses
        parsing = bool(places) and places[-1][0].f_code.co_filename == ast.__file__
        if (isinstance(error, MemoryError) and not parsing) or "allocate" in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False


# --- processes --------------------------------------------------------------------------------------------------------


def case(reader: str, index: int, seed: int, folder: Path) -> Path:
    """File number `index` of a reader, reproducible for a seed."""
    chance = random.Random(f"{seed} {reader} {index}")
    seeds = SEEDS[reader]()
    return write(chance.choice(seeds), chance.choice(seeds), chance, folder)


def work(reader: str, indices: range, seed: int, folder: Path, pipe: Connection) -> None:
    """Reads files one by one and sends (number, outcome, message)."""
    # 1. sound files, so that imports, and threads and processes that libraries keep, do not count; then the limits
    warnings.simplefilter("ignore", InputWarning)
    start_elsewhere()
    for number, sound in enumerate(SEEDS[reader]()):
        outcome(_place(sound.files, folder.with_name(f"{folder.name}-{number}")) / sound.main, sound.kind)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + LIMIT, used + LIMIT))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # 2. redirect printed output to a file
    printed = os.open(folder.with_suffix(".out"), os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    os.dup2(printed, 1)
    os.dup2(printed, 2)
    watch = Watch(folder)
    for index in indices:
        path = case(reader, index, seed, folder)
        before = _peak(reset=True)
        result, said = outcome(path, SEEDS[reader]()[0].kind)
        if _peak() - before > LIMIT:
            result = "over"
        if os.fstat(printed).st_size and result in ("loaded", "refused"):
            result, said = "printed", os.pread(printed, 200, 0).decode(errors="replace")
        os.ftruncate(printed, 0)
        left = watch.after()
        if left and result in ("loaded", "refused"):
            result, said = "leak", left
        pipe.send((index, result, said))
    pipe.send((-1, "memory", f"{watch.grown() / 2**20:.1f}"))
    pipe.close()


def _peak(reset: bool = False) -> int:
    """Peak resident bytes since the last reset."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    found = re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())
    return int(found[1]) * 1024 if found else 0


def run(reader: str, count: int, seed: int, folder: Path, processes: int = PROCESSES) -> Iterator[tuple[int, str, str]]:
    """(number, outcome, message) of each file, from processes that are replaced when they end; of a process
    (-1, "memory", MiB that it grew by).
    """
    spawn = multiprocessing.get_context("spawn")
    tasks: dict[Connection, tuple[int, int, multiprocessing.process.BaseProcess, float]] = {}

    def start(slot: int, first: int) -> None:
        mine, theirs = spawn.Pipe(duplex=False)
        process = spawn.Process(
            target=work, args=(reader, range(first, count, processes), seed, folder / f"{slot}", theirs)
        )
        process.start()
        theirs.close()
        tasks[mine] = (slot, first, process, time.monotonic() + WALL)

    for slot in range(min(processes, count)):
        start(slot, slot)
    while tasks:
        ready = multiprocessing.connection.wait(list(tasks), timeout=0.5)
        for pipe, (slot, index, process, last) in list(tasks.items()):
            fault = "hang" if pipe not in ready and time.monotonic() - last > WALL else ""
            if pipe in ready:
                try:
                    found = pipe.recv()
                    yield found
                    following = found[0] + processes if found[0] >= 0 else count
                    tasks[pipe] = (slot, following, process, time.monotonic())
                except EOFError:
                    fault = "crash" if index < count else "done"
            if fault:
                del tasks[pipe]
                if fault == "hang":
                    process.kill()
                process.join(WALL)
                if fault != "done":
                    yield index, fault, f"exit code {process.exitcode}"
                    if index + processes < count:
                        start(slot, index + processes)


def main() -> int:
    parser = argparse.ArgumentParser(allow_abbrev=False, description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--count", type=int, default=10_000, help="files per reader")
    parser.add_argument("--reader", choices=sorted(SEEDS), help="one reader only")
    parser.add_argument("--seed", type=int, default=1998)
    parser.add_argument("--processes", type=int, default=PROCESSES)
    parser.add_argument("--keep", type=Path, help="folder for the files that show a fault")
    args = parser.parse_args()
    columns = ("files", "refused", "loaded", *FAULTS, "grown MiB")
    print(f"{'reader':16}" + "".join(f"{name:>{WIDTH}}" for name in columns), flush=True)
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="splatgl-fuzz-") as scratch:
        for reader in [args.reader] if args.reader else SEEDS:
            counts: Counter[str] = Counter()
            faults = []
            grown = 0.0
            for index, result, said in run(reader, args.count, args.seed, Path(scratch), args.processes):
                if result == "memory":
                    grown = max(grown, float(said))
                    continue
                counts[result] += 1
                if result in FAULTS:
                    faults.append(f"  {reader} {index}: {result}: {said[:300]}")
                    if args.keep:
                        case(reader, index, args.seed, args.keep / f"{reader}-{index}")
            counts["files"], counts["grown MiB"] = counts.total(), round(grown)
            print(f"{reader:16}" + "".join(f"{counts[name]:{WIDTH}}" for name in columns), flush=True)
            print("\n".join(faults[:8]) + "\n" if faults else "", end="", flush=True)
            wrong += len(faults)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
