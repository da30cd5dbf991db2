"""Configuration of the documentation site; ``make docs`` builds it without warnings and without a network."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import jaxtyping  # noqa: F401  loaded first, so that types of arrays are shown with their shapes
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE.parent))

from generated_pages import write_pages

from phantom_dyn import __version__

project = "phantom-dyn"
author = "the phantom-dyn developers"
project_copyright = "the phantom-dyn developers"
release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
html_theme = "furo"
html_title = f"phantom-dyn {release}"
html_static_path: list[str] = []
myst_heading_anchors = 3
# Sources are linked to where they are read: beside the documentation in a clone.
myst_url_schemes = ("http", "https", "mailto")
# Annotations of arrays are strings for a checker of shapes; the text of each argument says the same to a reader.
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_use_ivar = True
exclude_patterns = ["_build"]


def name_outside_pages(app: Sphinx, docname: str, source: list[str]) -> None:
    """Name a page outside this folder, such as a benchmark's README, where it is linked: the site has no such page."""
    page = HERE / docname

    def named(link: re.Match[str]) -> str:
        target = (page.parent / link[2]).resolve()
        inside = target.is_relative_to(HERE)
        return link[0] if inside else f"{link[1]} (`{target.relative_to(HERE.parent)}`)"

    source[0] = re.sub(r"\[([^\]]+)\]\((\.\./[^)#]+\.md)\)", named, source[0])


def setup(app: Sphinx) -> None:
    """Write the generated pages before the sources are read; draw no diagrams, as that needs a network."""
    app.add_lexer("mermaid", TextLexer)
    app.connect("source-read", name_outside_pages)
    write_pages(HERE / "generated")
