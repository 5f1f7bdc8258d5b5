"""Hooks of the documentation site: figures beside the sources, links out of ``docs``, equations, generated pages.

The pages are written so that they read on a repository's own web page too: links go by relative paths, equations stand
between dollars. Here figures and a few pages of the repository become files of the site, links to its other files lead
to its address or, without one, are shown as code, and equations become MathML, which browsers draw without a script or
a connection.
"""

import csv
import posixpath
import re
import tomllib
from collections.abc import Iterable
from functools import cache
from html import unescape
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any
from unicodedata import lookup

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
# The repository's own; without one, links to its files become code
ADDRESS = PROJECT["tool"]["hatch"]["metadata"]["hooks"]["custom"]["repository"].rstrip("/")
# Pages of the repository → their place among the sources of the site
PAGES = {
    "CONTRIBUTING.md": "contributing.md",
    "RELEASING.md": "releasing.md",
    "CHANGELOG.md": "changelog.md",
    "benchmarks/RESULTS.md": "benchmarks.md",
    "README.md": "index.md",
    **{
        readme.relative_to(ROOT).as_posix(): f"studies/{readme.parent.name}.md"
        for readme in sorted((ROOT / "analysis" / "cases").glob("*/README.md"))
    },
}
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_DISPLAY = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
_STYLED = re.compile(r'<mi mathvariant="(script|bold)">([A-Za-z])</mi>')
_NAMES = "<mi>(?:sin|cos|tan|cot|arccos|ln|tanh)</mi>"
_FUNCTION = rf"(?:<msup>{_NAMES}<mn>\d</mn></msup>|(?<!<msup>){_NAMES})"
_BEFORE_FUNCTION = re.compile(rf"(</m(?:i|n|sub|sup|frac|row|style)>)({_FUNCTION})")
_AFTER_FUNCTION = re.compile(rf"({_FUNCTION})(?=<m(?!o))")
_THIN = '<mspace width="0.167em"/>'
_CELL = re.compile(r"<td[^>]*>.*?</td>", re.DOTALL)
_TEXT = re.compile(r"<(td|p|li)\b[^>]*>.*?</\1>", re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.])\d[\d.]*e[-+]\d+(?![^<]*>)")
_NAME = re.compile(r"<code>[\w.\[\]]{25,}</code>")
_TABLE = re.compile(r"<!-- csv: ([\w.]+) -->")
_LINK = re.compile(r"(!?)\[([^\]]+)\]\((?![a-z]+:|#)([^)#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the figures and some pages of the repository."""
    for path in sorted((ROOT / "figures").rglob("*")):
        if path.suffix in (".png", ".gif", ".svg"):
            inside = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, inside, abs_src_path=str(path)))
    for source, place in PAGES.items():
        if files.get_file_from_path(place) is None:
            files.append(File.generated(config, place, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(text: str, page: Any, **rest: Any) -> str:
    """Fill in the generated tables, and turn links that leave ``docs`` into what the site holds."""
    page.meta["tags"] = sought().get(page.file.src_uri)  # which the search of the site takes before all else
    if page.parent is None:  # the only page of its tab: no list of pages beside it
        page.meta["hide"] = ["navigation"]
    if "<!-- scene keys -->" in text:
        text = text.replace("<!-- scene keys -->", keys_of((ROOT / "docs" / "scene.csv").read_text("utf-8")))
    if "<!-- commands -->" in text:
        text = text.replace("<!-- commands -->", _commands())
    text = _TABLE.sub(lambda match: table_of((ROOT / "docs" / match[1]).read_text("utf-8")), text)
    source = {place: source for source, place in PAGES.items() if place != "index.md"}
    return moved_links(text, source.get(page.file.src_uri, f"docs/{page.file.src_uri}"), page.file.src_uri)


@cache
def sought() -> dict[str, list[str]]:
    """Return what readers look for, by the page that answers it, from the last table of the glossary."""
    glossary = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    found: dict[str, list[str]] = {}
    for line in glossary.partition("| you look for | it is |\n|---|---|\n")[2].splitlines():
        words, answer = line.strip("| ").split(" | ")
        for link in _LINK.finditer(answer):
            found.setdefault(link[3], []).extend(words.split(", "))
    return found


def table_of(text: str) -> str:
    """Return a CSV file as a table of Markdown, which a search of the site leaves out."""
    rows = _table(csv.reader(text.splitlines()))
    return "\n".join(['<div class="csv" data-search-exclude markdown="1">\n', *rows, "\n</div>"])


def keys_of(text: str) -> str:
    """Return the keys of a scene, a CSV file, as a table of Markdown for each section."""
    head, *rows = csv.reader(text.splitlines())
    parts: list[str] = []
    for section, group in groupby(rows, itemgetter(0)):
        parts += ["", f"## `{section}`", "", *_table([head[1:], *([f"`{key}`", *cells] for _, key, *cells in group)])]
    return "\n".join(parts)


def _table(rows: Iterable[list[str]]) -> list[str]:
    """Return the lines of a table of Markdown; the first row is its head."""
    head, *others = ([cell.replace("|", "\\|") for cell in row] for row in rows)
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *others)]


def moved_links(text: str, source: str, place: str) -> str:
    """Return a page with its relative links turned from the repository to the site.

    Parameters
    ----------
    text : str
        The page, in Markdown.
    source, place : str
        Its path in the repository, and among the sources of the site.
    """

    def moved(match: re.Match[str]) -> str:
        image, label, link, part = match.groups("")
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), link))
        if target in PAGES:
            target = PAGES[target]
        elif target.startswith("docs/"):
            target = target.removeprefix("docs/")
        elif not target.startswith("figures/"):
            words = label if label.startswith("`") else f"`{target}`"
            return f"[{label}]({ADDRESS}/blob/main/{target}{part})" if ADDRESS else words
        return f"{image}[{label}]({posixpath.relpath(target, posixpath.dirname(place))}{part})"

    return _LINK.sub(moved, text)


def on_page_content(html: str, **rest: Any) -> str:
    """Turn equations into MathML; keep numbers in one piece; in tables, let long names break between words."""
    html = _TEXT.sub(lambda text: _NUMBER.sub(r'<span class="number">\g<0></span>', text[0]), html)
    html = _CELL.sub(lambda cell: _NAME.sub(lambda name: name[0].replace("_", "_<wbr>"), cell[0]), html)
    html = _DISPLAY.sub(lambda match: f'<div class="equation">{_mathml(match[1], "block")}</div>', html)
    return _INLINE.sub(lambda match: _mathml(match[1], "inline"), html)


def _mathml(equation: str, display: str) -> str:
    """Return an equation as MathML, with what latex2mathml leaves out.

    It knows ``align*`` and not ``aligned``, takes ± for a letter and the bars of a modulus for relations, sets no space
    around the names of functions, and asks for script and bold letters by an attribute that browsers no longer read.
    """
    mathml = str(convert(unescape(equation).replace("{aligned}", "{align*}"), display=display))
    mathml = re.sub(r"<mi>(&#x000B1;|&#x02213;)</mi>", r"<mo>\1</mo>", mathml)
    mathml = mathml.replace("<mo>&#x0007C;</mo>", '<mo lspace="0" rspace="0">&#x0007C;</mo>')
    mathml = _STYLED.sub(_styled, mathml)
    mathml = _BEFORE_FUNCTION.sub(rf"\1{_THIN}\2", mathml)
    return _AFTER_FUNCTION.sub(rf"\1{_THIN}", mathml)


def _styled(letter: re.Match[str]) -> str:
    style, character = letter.groups()
    case = "CAPITAL" if character.isupper() else "SMALL"
    return f"<mi>{lookup(f'MATHEMATICAL {style} {case} {character}'.upper())}</mi>"


def _commands() -> str:
    """Return ``--help`` of every command, as Markdown."""
    from granular_analysis import cli
    from granular_lmp.cli.parser import help_texts

    texts = help_texts() | cli.help_texts()
    return "\n\n".join(f"## `{name}`\n\n```text\n{text}\n```" for name, text in texts.items())
