"""Names that users rely on are those of the list."""

from __future__ import annotations

import public_names


def test_public_names_are_those_of_the_list() -> None:
    """Of Python, the command line, scene files and the metadata of pictures."""
    listed, there = public_names.TARGET.read_text(encoding="utf-8").splitlines(), public_names.compose().splitlines()
    assert not (gone := set(listed) - set(there)), f"the changelog says what is removed or renamed: {sorted(gone)}"
    assert listed == there, "python scripts/public_names.py lists what is new"
