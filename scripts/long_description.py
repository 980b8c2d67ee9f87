"""The long description of the package on an index, README.md with absolute links to files; and the project's addresses.

The environment variable SPLATGL_ADDRESS holds the address of the repository's files, such as
https://HOST/NAME/blob/main. Without it links to files become text, and pictures and addresses of the repository are
left out.
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


def addresses(address: str) -> dict[str, str]:
    """The project's addresses by name, from that of its files; without one, none."""
    if not address:
        return {}
    base = address.rstrip("/")
    pages = {"Documentation": "splatgl/docs/index.md", "Changelog": "splatgl/docs/changelog.md"}
    pages["Citation"] = ".github/CITATION.cff"
    return {
        "Repository": re.sub(r"/(blob|tree|raw)/[^/]+$", "", base),
        **{name: f"{base}/{pages[name]}" for name in pages},
    }


class CustomMetadataHook(MetadataHookInterface):
    """hatchling's name for the class that it looks for."""

    def update(self, metadata: dict[str, object]) -> None:
        readme = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = describe(readme, os.environ.get("SPLATGL_ADDRESS", ""))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        metadata["urls"] = addresses(os.environ.get("SPLATGL_ADDRESS", ""))
