from __future__ import annotations

from identification.reporting.charts.svg import inline_svg


def test_text_of_an_element_is_never_rewritten():
    raw = '<svg width="1"><g id="u"/><use href="#u"/><text x="1.23456">d="0.123456" id="u" #010203</text></svg>'
    assert inline_svg(raw, "k", "t") == (
        '<svg role="img" aria-label="t" width="1"><g id="k-u"/><use href="#k-u"/>'
        '<text x="1.2">d="0.123456" id="u" #010203</text></svg>'
    )
