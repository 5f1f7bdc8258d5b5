"""Metadata that hang on the address of the repository, which stands in pyproject.toml alone.

The README of a package is read where no files of the repository are beside it. With an address its links and pictures
lead there; without one a link keeps its words only, and a picture the sentence below it.
"""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_RELATIVE = re.compile(r"(!?)\[([^\]]*)\]\((?![a-z]+:|#)([^)\s]+)\)")
PLACES = {  # of [project.urls], behind the address
    "Repository": "",
    "Issues": "/issues",
    "Changelog": "/blob/main/CHANGELOG.md",
    "Documentation": "/blob/main/docs/index.md",
}


def readable(text: str, address: str) -> str:
    """Return a page of the repository's root with links that lead somewhere outside of it."""

    def there(match: re.Match[str]) -> str:
        image, words, target = match.groups()
        if not address:
            return "" if image else words
        return f"{image}[{words}]({address}/{'raw' if image else 'blob'}/main/{target})"

    return _RELATIVE.sub(there, text)


class Links(MetadataHookInterface):
    """Readme and URLs of the package."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set both."""
        address = str(self.config.get("repository", "")).rstrip("/")
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": readable(text, address)}
        metadata["urls"] = {name: address + rest for name, rest in PLACES.items()} if address else {}
