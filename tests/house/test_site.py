"""The documentation site: it builds without a warning, every link and picture is there, and the drawing is current."""

import importlib.util
import os
import re
import subprocess
import sys
from html import unescape
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote

import pytest

from tests.house import test_independence

ROOT = Path(__file__).parents[2]


def loaded(name: str) -> ModuleType:
    """Return a script of ``docs``, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# ---------------------------------------------------------------- the drawing of the rooms


def test_the_drawing_of_the_rooms_is_that_of_the_sources() -> None:
    rooms = loaded("rooms")
    assert rooms.DRAWING.read_text("utf-8") == rooms.drawing(), "make rooms draws it again"


def test_the_arrows_are_those_of_the_table_of_imports() -> None:
    rooms = loaded("rooms")
    expected = {(used, room) for room, used in test_independence.arrows(test_independence.GRAPH)}
    lazy = {(used, room) for room, used in test_independence.LAZY}
    assert rooms.arrows() == {pair for pair in expected - lazy if "errors" not in pair}


def test_an_arrow_that_a_chain_implies_is_left_out_and_no_other() -> None:
    rooms = loaded("rooms")
    assert rooms.reduced({("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")}) == {("a", "b"), ("b", "c"), ("a", "d")}


# ---------------------------------------------------------------- the site


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built once; skipped where the extra `docs` is not installed."""
    pytest.importorskip("mkdocs", reason="pip install --editable '.[docs]', or make docs")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return folder


def broken(folder: Path) -> set[tuple[str, str]]:
    """Return the pairs of a page and a target in it, a link, picture or script, that is no file or no anchor."""
    pages = {path: path.read_text("utf-8") for path in folder.rglob("*.html")}
    names = {path: set(re.findall(r'\s(?:id|name)="([^"]+)"', html)) for path, html in pages.items()}
    found = set()
    for path, html in pages.items():
        for target in re.findall(r'\s(?:href|src)="([^"]+)"', html):
            link, _, part = unescape(unquote(target)).partition("#")
            if re.match(r"[a-z]+:|//|/", link):
                continue
            place = (path.parent / link).resolve() if link else path
            place = place / "index.html" if place.is_dir() else place
            if not place.is_file() or (part and part not in names.get(place, {part})):
                found.add((path.relative_to(folder).as_posix(), target))
    return found


def test_every_link_and_picture_of_the_site_is_there(site: Path) -> None:
    assert {(page, target) for page, target in broken(site) if page != "404.html"} == set()


def test_no_page_loads_anything_from_another_host(site: Path) -> None:
    for path in site.rglob("*.html"):
        html = path.read_text("utf-8")
        parts = re.findall(r'<(?:script|img|link rel="stylesheet")[^>]*?(?:src|href)="([^"]+)"', html)
        assert [part for part in parts if re.match(r"https?:|//", part)] == [], path


def test_no_equation_is_left_as_its_source(site: Path) -> None:
    for path in site.rglob("*.html"):
        html = path.read_text("utf-8")
        assert "arithmatex" not in html, path
        # What the converter does not know it writes as a letter: an ampersand of a table, or a command
        assert re.findall(r"<m[io]>(?:&|&amp;|\\\\[^<]*)</m[io]>", html) == [], path


def test_a_broken_link_of_the_site_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<a href="b.html#x"></a><img src="c.png"><h1 id="y"></h1><a href="#y"></a>')
    (tmp_path / "b.html").write_text('<a href="a.html#y"></a><a href="https://example.org/"></a><a href="#z"></a>')
    assert broken(tmp_path) == {("a.html", "b.html#x"), ("a.html", "c.png"), ("b.html", "#z")}


@pytest.mark.parametrize(
    ("link", "moved"),
    [
        ("[a](other.md#part)", "[a](other.md#part)"),
        ("![a](../figures/map.png)", "![a](figures/map.png)"),
        ("[a](../CONTRIBUTING.md)", "[a](contributing.md)"),
        ("[decks](../lammps_inputs)", "`lammps_inputs`"),
        ("[`lammps_inputs/`](../lammps_inputs)", "`lammps_inputs/`"),
        ("[a](https://example.org/b.md)", "[a](https://example.org/b.md)"),
        ("[a](#here)", "[a](#here)"),
    ],
)
def test_links_of_the_repository_become_links_of_the_site(link: str, moved: str) -> None:
    pytest.importorskip("mkdocs")
    assert loaded("site_hooks").moved_links(link, "docs/page.md", "page.md") == moved


@pytest.mark.parametrize(
    ("equation", "part"),
    [
        (r"\begin{aligned}a&=b\\\\c&=d\end{aligned}", "<mtable"),
        (r"a\pm b", "<mo>&#x000B1;</mo>"),
        (r"\mathcal S", "<mi>\U0001d4ae</mi>"),
        (r"\mathbf k", "<mi>\U0001d424</mi>"),
        (r"Q\cos\xi", '<mi>Q</mi><mspace width="0.167em"/><mi>cos</mi><mspace width="0.167em"/><mi>&#x003BE;</mi>'),
        (r"\sin(x)", "<mi>sin</mi><mo"),
    ],
)
def test_what_the_converter_of_equations_leaves_out_is_put_in(equation: str, part: str) -> None:
    pytest.importorskip("mkdocs")
    assert part in loaded("site_hooks")._mathml(equation, "inline")


def test_links_of_a_page_in_a_folder_are_taken_from_there() -> None:
    pytest.importorskip("mkdocs")
    moved_links = loaded("site_hooks").moved_links
    assert moved_links("[a](../how-to.md)", "docs/reference/b.md", "reference/b.md") == "[a](../how-to.md)"
    assert moved_links("![a](../../figures/c.png)", "docs/reference/b.md", "reference/b.md") == "![a](../figures/c.png)"
    assert moved_links("[a](docs/theory.md)", "CONTRIBUTING.md", "contributing.md") == "[a](theory.md)"
