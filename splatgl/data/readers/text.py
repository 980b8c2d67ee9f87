"""Parses numbers from text block by block, with bounded memory for long lines and words."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from splatgl.data.readers.files import library
from splatgl.errors import expected

_BLOCK_BYTES = 2**16
"""Bytes split into words at a time: small beside a volume, large beside a call's cost."""

_WORD_LIMIT = 64
"""Longest number in bytes: float64 needs 24; numpy would give every word of a block the room of the longest."""


def read_numbers(file: BinaryIO, count: int, dtype: np.dtype, there: int) -> np.ndarray:
    """The next `count` numbers of `file` [count], in native byte order; leaves it at the end of their last line.

    there: bytes up to the file's end, which bound what is allocated. Raises InputError if there are fewer numbers,
    or more in the last line.
    """
    # 1. every number takes two bytes at least, the last one needs no blank behind it
    numbers = np.empty(min(count, there // 2 + 1), dtype.newbyteorder("="))
    filled, cut = 0, b""
    while filled < count:
        # 2. the words of a line or of a block of it; its last word may go on in the next block
        block = file.readline(_BLOCK_BYTES)
        words = (cut + block).split()
        cut = words.pop() if words and block and not block[-1:].isspace() else b""
        if max(map(len, (*words, cut)), default=0) > _WORD_LIMIT:
            raise expected("data", "numbers", f"a word of more than {_WORD_LIMIT} letters", "the file is damaged")
        # 3. as numbers
        if filled + len(words) > count or (not block and filled + len(words) < count):
            fix = "the file is cut short or damaged"
            raise expected("data", f"{count} numbers", filled + len(words), fix)
        with library("numbers"):
            numbers[filled : filled + len(words)] = np.array(words or np.empty(0, "S1")).astype(numbers.dtype)
        filled += len(words)
    if cut:
        raise expected("data", f"{count} numbers", "more", "the header states a wrong size")
    return numbers


def require_end(file: BinaryIO, count: int) -> None:
    """Raises InputError if more than blanks follow `count` numbers."""
    while block := file.read(_BLOCK_BYTES):
        if block.strip():
            raise expected("data", f"{count} numbers", "more", "the header states a wrong size")
