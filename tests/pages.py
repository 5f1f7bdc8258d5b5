"""Parts of pages that are written from code, each between two marks that name it."""

import re
from pathlib import Path


def placed(page: str, name: str, text: str) -> str:
    """Return a page with a text between the marks ``<!-- name -->`` and ``<!-- end of name -->``.

    Raises
    ------
    ValueError
        If the page does not have the marks, once each.
    """
    between = re.compile(rf"(?<=<!-- {name} -->\n).*(?=<!-- end of {name} -->)", re.DOTALL)
    changed, count = between.subn(lambda _: f"\n{text.strip()}\n\n", page)
    if count != 1:
        raise ValueError(f"the page has {count} places for {name!r}; must have one")
    return changed


def write(page: Path | None, name: str, text: str) -> None:
    """Write a text between its marks in a file, or print it where none is given."""
    if page is None:
        print(text)
    else:
        page.write_text(placed(page.read_text(encoding="utf-8"), name, text), encoding="utf-8")
