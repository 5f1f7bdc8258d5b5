"""The documentation site: it builds without a warning, every link and picture is there, and the drawing is current."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache, partial
from html import unescape
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from queue import Queue
from threading import Thread
from types import ModuleType
from typing import Any
from urllib.parse import unquote, urlencode

import pytest

from tests.house import test_independence
from tests.house.test_live import NODE, VALUES, compared_with_theory

ROOT = Path(__file__).parents[2]


@cache
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
    expected = {(used, room) for room, used in test_independence.arrows(test_independence.graph_of("granular_lmp"))}
    assert rooms.arrows() == {pair for pair in expected if rooms.LEFT_OUT.isdisjoint(pair)}


def test_an_arrow_that_a_chain_implies_is_left_out_and_no_other() -> None:
    rooms = loaded("rooms")
    assert rooms.reduced({("a", "b"), ("b", "c"), ("a", "c"), ("a", "d")}) == {("a", "b"), ("b", "c"), ("a", "d")}


OTHER_HELP = pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="each argparse breaks lines in another way")


@pytest.mark.parametrize("name", ["scene.csv", "cases.csv", pytest.param("commands.txt", marks=OTHER_HELP)])
def test_what_the_reference_takes_of_the_sources_is_current(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")  # of the terminal, which may be wider
    made = loaded("generated").FILES[name]()
    assert (ROOT / "docs" / name).read_text("utf-8") == made, "make reference writes it"


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


# The program of the site's search, in Node in place of a browser; it answers a page of results for each question
SEARCH = """
const fs = require("fs"), vm = require("vm");
const [program, index, ...questions] = process.argv.slice(1);
const answers = [];
const place = {console, postMessage: (answer) => answers.push(answer)};
place.self = place;
place.addEventListener = (_, listener) => { place.ask = listener; };
vm.runInNewContext(fs.readFileSync(program, "utf8"), place);
(async () => {
  await place.ask({data: {type: 0, data: {options: {}, ...JSON.parse(fs.readFileSync(index))}}});
  for (const data of questions) await place.ask({data: {type: 2, data}});
  console.log(JSON.stringify(answers.slice(1).map(({data}) => data.items.map((page) => page[0].location))));
})();
"""


def found_first(site: Path, questions: list[str]) -> list[str]:
    """Return the page, without its section, that a search of the site shows first for each question; "" for none."""
    if NODE is None:
        pytest.skip("no Node")
    (program,) = site.glob("assets/javascripts/workers/search.*.min.js")
    words = [NODE, "-e", SEARCH, str(program), str(site / "search" / "search_index.json"), *questions]
    answers = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return [pages[0].partition("#")[0] if pages else "" for pages in json.loads(answers)]


def test_a_search_shows_the_page_that_answers_first(site: Path) -> None:
    answers = {
        word: page.replace(".md", "/") for page, words in loaded("site_hooks").sought().items() for word in words
    }
    assert {"steel", "PDMS", "group velocity", "friction", "Hertz", "polydisperse"} < answers.keys()
    answers |= {"wave speed": "crystals/", "periodic": "reference/scene/", "hertz": answers["Hertz"], "zzz": ""}
    assert dict(zip(answers, found_first(site, [*answers]), strict=True)) == answers


# ---------------------------------------------------------------- the site in a browser

WIDTHS = (1280, 390)  # pixels of a window and of a telephone
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
# Loads each page into a frame of its own, and posts what `SEEN` gives of it
FRAMES = """<body><script>
const seen = [];
async function look(page) {
  const frame = document.createElement("iframe");
  frame.style.cssText = "width: WIDTHpx; height: 900px; border: 0";
  frame.sandbox = "SANDBOX";
  await new Promise(done => { frame.onload = done; frame.src = "/" + page; document.body.append(frame); });
  const shown = frame.contentDocument;
  seen.push(SEEN);
  frame.remove();
}
(async () => {
  for (const page of PAGES) await look(page);
  await fetch("/", {method: "POST", body: JSON.stringify(seen)});
})();
</script></body>"""
WRONG = "shown.getElementById('live-wrong').textContent"
TOO_WIDE = "(e => e.scrollWidth - e.clientWidth)(shown.querySelector('main') || shown.body)"
SORTED = """(table => {
  const head = table.tHead.rows[0].cells[3];
  const numbers = () => [...table.tBodies[0].rows].map(row => Number(row.cells[3].textContent));
  const sorted = () => { head.click(); return numbers(); };
  return [sorted(), sorted(), head.ariaSort];
})(shown.querySelector("article table"))"""
FILTERED = """(field => {
  const rows = [...shown.querySelectorAll("article .csv tbody tr")];
  const kept = () => rows.filter(row => !row.hidden).map(row => row.textContent);
  field.value = "JKR radii";
  field.dispatchEvent(new Event("input"));
  const some = kept();
  field.value = "";
  field.dispatchEvent(new Event("input"));
  return [some, kept().length, rows.length];
})(shown.querySelector("article .filter"))"""
FORM_FILLED = """(values => {
  const form = shown.getElementById("live");
  for (const name in values) form.elements[name].value = values[name];
  form.dispatchEvent(new Event("input"));
  return [shown.querySelectorAll("svg .curve").length, JSON.parse(form.dataset.motion)];
})(VALUES)"""


class Served(SimpleHTTPRequestHandler):
    """Files of the site, and a place where a page leaves what it has seen."""

    def log_message(self, *words: Any) -> None:
        pass

    def do_POST(self) -> None:
        answers: Queue[Any] = self.server.answers
        answers.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.send_response(204)
        self.end_headers()


@pytest.fixture(scope="module")
def server(site: Path) -> Iterator[ThreadingHTTPServer]:
    """The site, served from this machine."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Served, directory=str(site))) as running:
        running.answers = Queue()
        Thread(target=running.serve_forever, daemon=True).start()
        yield running
        running.shutdown()


def seen(
    server: ThreadingHTTPServer, site: Path, pages: list[str], what: str, width: int = 1280, scripts: bool = True
) -> list[Any]:
    """Return what a script sees on each page of the site in a window of a width, with the pages' own scripts or not."""
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    frames = FRAMES.replace("WIDTH", str(width)).replace("PAGES", json.dumps(pages)).replace("SEEN", what)
    frames = frames.replace("SANDBOX", "allow-same-origin allow-scripts" if scripts else "allow-same-origin")
    (site / "frames.html").write_text(frames, encoding="utf-8")
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
    command += [f"--window-size={width + 60},1000", f"http://127.0.0.1:{server.server_address[1]}/frames.html"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as browser:
        try:
            answer: list[Any] = server.answers.get(timeout=300)
        finally:
            browser.terminate()
    return answer


@pytest.mark.parametrize("width", WIDTHS)
def test_no_page_is_wider_than_its_window(site: Path, server: ThreadingHTTPServer, width: int) -> None:
    pages = [path.relative_to(site).as_posix() for path in sorted(site.rglob("index.html"))]
    wider = dict(zip(pages, seen(server, site, pages, TOO_WIDE, width, scripts=False), strict=True))
    assert {page: pixels for page, pixels in wider.items() if pixels > 0} == {}


def test_a_page_that_is_too_wide_is_seen(site: Path, server: ThreadingHTTPServer) -> None:
    (site / "wide.html").write_text('<div style="width: 500px">wide</div>', encoding="utf-8")
    assert seen(server, site, ["wide.html", "live/index.html"], TOO_WIDE, 390)[0] > 100


def test_the_head_of_a_long_table_sorts_its_rows(site: Path, server: ThreadingHTTPServer) -> None:
    ((up, down, way),) = seen(server, site, ["verification/"], SORTED)
    assert len(up) > 40
    assert up == sorted(up) != down
    assert down == up[::-1]
    assert way == "descending"


def test_the_field_of_a_long_table_keeps_the_rows_with_all_its_words(site: Path, server: ThreadingHTTPServer) -> None:
    ((some, after, rows),) = seen(server, site, ["reference/combinations/"], FILTERED)
    assert 0 < len(some) < 10
    assert all("jkr" in row and "radii" in row for row in some)
    assert after == rows > 1000


def test_the_form_of_the_live_page_draws_the_closed_form(site: Path, server: ThreadingHTTPServer) -> None:
    moved = FORM_FILLED.replace("VALUES", f"{json.dumps(VALUES)}[seen.length]")
    for values, (curves, shown) in zip(VALUES, seen(server, site, ["live/"] * len(VALUES), moved), strict=True):
        compared_with_theory(values, shown)
        assert curves >= 4


def test_the_live_page_says_what_is_wrong_and_keeps_its_curves(site: Path, server: ThreadingHTTPServer) -> None:
    wrong = [*VALUES[:1], VALUES[0] | {"radius": "0,5"}]
    filled = f"[{FORM_FILLED.replace('VALUES', f'{json.dumps(wrong)}[seen.length]')}[0], {WRONG}]"
    right, refused = seen(server, site, ["live/"] * 2, filled)
    assert right == [6, ""]
    assert refused == [6, 'radius: "0,5" is no number; write one as 0.2 or 2e-1']


def test_the_address_of_the_live_page_keeps_its_values(site: Path, server: ThreadingHTTPServer) -> None:
    shown = 'JSON.parse(shown.getElementById("live").dataset.motion)'
    for values, read in zip(VALUES, seen(server, site, [f"live/#{urlencode(v)}" for v in VALUES], shown), strict=True):
        compared_with_theory(values, read)


# ---------------------------------------------------------------- hooks


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
