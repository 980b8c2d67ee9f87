"""The long description of the package on an index: README.md, whose links to files are made absolute.

The environment variable SPLATGL_ADDRESS holds the address under which the repository's files lie. Without it links to
files become text, and pictures of the repository are left out.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

# a picture or a link of Markdown to a file of the repository
_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:|#)([^)]*)\)")


def describe(readme: str, address: str) -> str:
    """The text of the README with absolute links under an address; without one, with text in their place."""

    def absolute(match: re.Match[str]) -> str:
        mark, text, path = match.groups()
        if address:
            return f"{mark}[{text}]({address.rstrip('/')}/{path})"
        return "" if mark else text

    return _LINK.sub(absolute, readme)


class CustomMetadataHook(MetadataHookInterface):
    """hatchling's name for the class that it looks for."""

    def update(self, metadata: dict[str, object]) -> None:
        readme = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = describe(readme, os.environ.get("SPLATGL_ADDRESS", ""))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
