"""Replace the text between two markers of a page, for commands that write their results there."""

from __future__ import annotations

import re


def between_markers(page: str, begin: str, end: str, inside: str) -> str:
    """The page with new text between two markers, each on a line of its own.

    Args:
        page: Text of the page.
        begin: First marker, which occurs once.
        end: Second marker, which occurs once, after the first.
        inside: The new text.

    Raises:
        ValueError: If a marker is missing or occurs twice, or they are in the wrong order.
    """
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if page.count(begin) != 1 or page.count(end) != 1 or not pattern.search(page):
        raise ValueError(f"The text has to hold {begin} and then {end}, each once: put them where the table goes.")
    return pattern.sub(lambda _: f"{begin}\n{inside}\n{end}", page)
