"""Names that users rely on stay."""

from __future__ import annotations

import public_names


def test_no_public_name_is_gone() -> None:
    """Of Python, the command line, scene files and the metadata of pictures; scripts/release lists new ones."""
    listed, there = public_names.TARGET.read_text(encoding="utf-8").splitlines(), public_names.compose().splitlines()
    gone = sorted(set(listed) - set(there))
    assert not gone, f"the changelog must say so, then python scripts/public_names.py lists what is left: {gone}"
