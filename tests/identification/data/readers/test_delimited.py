"""CSV and its relatives. Oracle: the numbers that were written."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from identification.data.readers.read_table import read_raw, read_table
from phantom_dyn.errors import LogError


def assert_same(table, columns):
    assert list(table.columns) == list(columns)
    for name, values in columns.items():
        np.testing.assert_array_equal(table.columns[name], values)


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "   "])
def test_every_separator_gives_the_same_numbers(write, lines, columns, separator):
    assert_same(read_table(write([line.replace(",", separator) for line in lines])), columns)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_every_line_end_gives_the_same_numbers(write, lines, columns, end):
    assert_same(read_table(write(lines, end=end)), columns)


def test_a_byte_order_mark_is_no_part_of_the_first_name(write, lines, columns):
    assert_same(read_table(write(lines, encoding="utf-8-sig")), columns)


def test_comments_and_blank_lines_are_skipped(write, lines, columns):
    assert_same(
        read_table(write(["# by hand", "", lines[0], "  # units: SI", *lines[1:30], "", "#", *lines[30:], ""])), columns
    )


def test_spaces_around_names_and_numbers_do_not_count(write, lines, columns):
    assert_same(read_table(write([" " + line.replace(",", " , ") + " " for line in lines])), columns)


def test_quoted_names_and_numbers_are_read(write, lines, columns):
    assert_same(read_table(write([",".join(f'"{cell}"' for cell in line.split(",")) for line in lines])), columns)


def test_names_in_the_last_comment_are_found(write, lines, columns):
    assert_same(read_table(write(["# numpy.savetxt writes", "# " + lines[0], *lines[1:]])), columns)


def test_a_last_line_without_line_end_counts(tmp_path, lines, columns):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    assert_same(read_table(path), columns)


def test_whole_numbers_followed_by_fractions_are_read(write):
    rows = [f"{k},0" for k in range(300_000)] + [f"{300_000 + k},0.5" for k in range(60)]
    table = read_table(write(["t,q.a", *rows]))
    assert table.columns["q.a"].sum() == 30.0


def test_an_index_of_pandas_is_left_out_with_a_note(write, lines, columns):
    table = read_table(write(["," + lines[0], *(f"{7 + k},{line}" for k, line in enumerate(lines[1:]))]))
    assert_same(table, columns)
    assert table.warnings == ("log.csv: column 1 not used: it has no name and counts the rows.",)


@pytest.mark.parametrize("index", [lambda k: 0.01 * k, lambda k: f"row{k}", lambda k: -k])
def test_a_first_column_without_name_that_does_not_count_the_rows_is_refused(write, lines, index):
    path = write(["," + lines[0], *(f"{index(k)},{line}" for k, line in enumerate(lines[1:]))])
    with pytest.raises(LogError, match=r"column 1 has no name: name every column .* with index=False"):
        read_table(path)


def test_text_in_a_column_that_is_not_ours_does_no_harm(write, lines):
    path = write([lines[0] + ",state", *(line + ",moving" for line in lines[1:])])
    assert read_table(path).warnings == ("log.csv: column state not used: no name of a log's columns.",)


@pytest.mark.parametrize("text", ["abc", "0x10", "1_000", "2026-01-01", "true", "1.0 2.0"])
def test_text_is_reported_with_line_column_and_value(write, lines, text):
    lines[30] = lines[30].replace(lines[30].split(",")[2], text)
    with pytest.raises(LogError, match=rf"log\.csv, line 31, column v\.a holds '{text}' where a number should be"):
        read_table(write(lines))


def test_a_decimal_comma_is_reported(write, lines):
    rows = [lines[0].replace(",", ";"), *(line.replace(",", ";").replace(".", ",") for line in lines[1:])]
    with pytest.raises(LogError, match=r"line 2, column t holds '0,0' .* write the decimal point as a point"):
        read_table(write(rows))


def test_an_empty_cell_is_reported(write, lines):
    cells = lines[12].split(",")
    cells[1] = ""
    lines[12] = ",".join(cells)
    with pytest.raises(LogError, match=r"line 13, column q\.a is empty"):
        read_table(write(lines))


def test_the_line_is_that_of_an_editor_despite_comments(write, lines):
    rows = ["# first", lines[0], "", *lines[1:]]
    rows[20] = rows[20].replace(rows[20].split(",")[1], "x")
    with pytest.raises(LogError, match=r"line 21, column q\.a holds 'x'"):
        read_table(write(rows))


@pytest.mark.parametrize(("change", "values"), [(lambda s: s + ",1", 8), (lambda s: s.rsplit(",", 1)[0], 6)])
def test_a_row_of_another_length_is_reported_with_its_line(write, lines, change, values):
    lines[40] = change(lines[40])
    with pytest.raises(LogError, match=rf"line 41 has {values} values where 7 columns are named"):
        read_table(write(lines))


def test_a_row_of_another_length_between_spaces_is_reported(write, lines):
    rows = [line.replace(",", " ") for line in lines]
    rows[40] += " 1"
    with pytest.raises(LogError, match="line 41 has 8 values where 7 columns are named"):
        read_table(write(rows))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda write, lines: read_table(write([lines[0].replace("q.b", "q.a"), *lines[1:]])),
            r"the column name q\.a is there twice",
            id="a name given twice is refused",
        ),
        pytest.param(
            lambda write, lines: read_table(write([lines[0].replace("q.b", ""), *lines[1:]])),
            "column 5 has no name",
            id="a column without name is refused",
        ),
        pytest.param(
            lambda write, lines: read_table(write(lines[1:])),
            "no column names: line 1 holds numbers; put a line such as t,q",
            id="numbers without names are refused",
        ),
        pytest.param(
            lambda write, lines: read_table(write(lines[:1])),
            r"has no rows: there is nothing below its column names t, q\.a",
            id="names without rows are refused",
        ),
        pytest.param(
            lambda write, lines: read_table(write(lines, encoding="utf-16")),
            "is UTF-16 text: save it as UTF-8",
            id="utf 16 is refused",
        ),
    ],
)
def test_what_cannot_be_is_refused(write, lines, call, message):
    with pytest.raises(LogError, match=message):
        call(write, lines)


def test_a_file_of_comments_is_reported(write):
    with pytest.raises(LogError, match="has only comments"):
        read_table(write(["# nothing", "# here"]))


LETTER = b"Dear reader, this is a letter.\nIt has no table, none, at all.\nBye\n"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        *((empty, "empty") for empty in (b"", b"\n\n  \n", b"\xef\xbb\xbf")),
        *((strange, "no log") for strange in (LETTER, b"MATLAB 5.0\0\1\2\3" * 9, bytes(range(256)))),
    ],
)
def test_a_file_that_is_empty_or_no_log_is_reported(tmp_path, content, said):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(LogError, match=rf"log\.csv is {said}"):
        read_table(path)


@pytest.mark.parametrize("text", ["<robot name='a'/>", '{"t": [1, 2]}'])
def test_xml_and_json_are_reported(write, text):
    with pytest.raises(LogError, match=r"is no log \(it looks like XML or JSON\)"):
        read_table(write([text]))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=st.lists(
        st.lists(st.floats(-1e5, 1e5, allow_nan=False), min_size=3, max_size=3), min_size=1, max_size=70
    ),
    separator=st.sampled_from([",", ";", "\t", " "]),
    end=st.sampled_from(["\n", "\r\n"]),
    comment=st.integers(0, 70),
)  # fmt: skip
def test_what_is_written_is_read(tmp_path, values, separator, end, comment):
    rows = [separator.join(repr(x) for x in row) for row in values]
    rows.insert(min(comment, len(rows)), "# a comment")
    path = tmp_path / "log.csv"
    path.write_bytes((end.join([separator.join(["t", "q.a", "any name".replace(" ", "_")]), *rows]) + end).encode())
    raw = read_raw(path)
    np.testing.assert_array_equal(np.column_stack(list(raw.columns.values())), np.array(values))


def test_reading_does_not_import_pandas(tmp_path):
    # Arrow imports it for its own conversion to NumPy: longer than the reading, and deaf to Ctrl-C meanwhile.
    (tmp_path / "log.csv").write_text("t,q.a\n0,1\n0.1,2\n")
    script = (
        "import sys; from pathlib import Path; from identification.data.readers.delimited import read_delimited; "
        f"read_delimited(Path({str(tmp_path / 'log.csv')!r})); print('pandas' in sys.modules)"
    )
    assert subprocess.check_output([sys.executable, "-c", script], text=True) == "False\n"


def test_names_in_the_encoding_of_windows_are_read(write, lines):
    named = [lines[0].replace("q.a", "q.épaule"), *lines[1:]]
    assert "q.épaule" in read_table(write(named, encoding="cp1252")).columns
