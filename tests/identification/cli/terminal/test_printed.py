"""What reaches a stream of a narrow encoding. Oracle: the bytes that Python writes."""

import io

import pytest

from identification.cli.terminal.printed import say


@pytest.mark.parametrize(
    ("encoding", "expected"),
    [
        ("ascii", b"0.4 +- 0.1 kg at 20 ?C\n"),
        ("latin-1", "0.4 ± 0.1 kg at 20 °C\n".encode("latin-1")),
        ("utf-8", "0.4 ± 0.1 kg at 20 °C\n".encode()),
    ],
)
def test_signs_that_a_stream_lacks_are_replaced(encoding, expected):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, newline="\n")
    say("0.4 ± 0.1 kg at 20 °C", file=stream, flush=True)
    assert stream.buffer.getvalue() == expected
