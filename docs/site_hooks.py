"""Hooks of the documentation site: figures beside the sources, links out of ``docs``, equations, generated pages.

The pages are written so that they read on a repository's own web page too: links go by relative paths, equations stand
between dollars. Here figures become files of the site, links to other files of the repository lose their target (they
are shown as code), and equations become MathML, which browsers draw without a script or a connection.
"""

import re
from html import unescape
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_DISPLAY = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
_OUTSIDE = re.compile(r"\[([^\]]+)\]\(\.\./(?!figures/)([^)]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the figures of the repository."""
    for path in sorted((ROOT / "figures").rglob("*")):
        if path.suffix in (".png", ".gif", ".svg"):
            inside = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, inside, abs_src_path=str(path)))
    return files


def on_page_markdown(text: str, page: Any, **rest: Any) -> str:
    """Fill in the generated tables, and turn links that leave ``docs`` into what the site holds."""
    if "<!-- scene keys -->" in text:
        from granular_lmp.scene.json_schema import reference

        text = text.replace("<!-- scene keys -->", reference())
    if "<!-- commands -->" in text:
        text = text.replace("<!-- commands -->", _commands())
    text = text.replace("](../figures/", "](figures/").replace('src="../figures/', 'src="figures/')
    return _OUTSIDE.sub(r"`\2`", text)


def on_page_content(html: str, **rest: Any) -> str:
    """Turn equations into MathML."""
    html = _DISPLAY.sub(lambda match: _mathml(match[1], "block"), html)
    return _INLINE.sub(lambda match: _mathml(match[1], "inline"), html)


def _mathml(equation: str, display: str) -> str:
    return str(convert(unescape(equation), display=display))


def _commands() -> str:
    """Return ``--help`` of every command, as Markdown."""
    from granular_lmp.cli import help_texts

    return "\n\n".join(f"## `{name}`\n\n```text\n{text}\n```" for name, text in help_texts().items())
