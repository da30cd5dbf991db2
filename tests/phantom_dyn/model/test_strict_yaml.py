"""Strict YAML: what is read, what is refused, and that settings are read back as written."""

import contextlib
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from phantom_dyn.errors import ParameterError
from phantom_dyn.model.files.settings_file import load_mapping, number_at
from phantom_dyn.model.files.strict_yaml import load_yaml, settings_text

LAUGHS = "".join(f"l{k}: &l{k} [{', '.join([f'*l{k - 1}'] * 9) if k else ', '.join(['lol'] * 9)}]\n" for k in range(9))


MERGES = "a: &a {k: 1}\n" + "".join(
    f"m{k}: &m{k} {{<<: [{', '.join([f'*m{k - 1}' if k else '*a'] * 9)}]}}\n" for k in range(9)
)


CHAIN = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 3000))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: " + "9" * 400, r"line 1 \(the number 9{40}… is too large\)"),
        ("a: " + "9" * 5000, r"9{40}… cannot be read as !!int"),
        ("a: !!int x", "x cannot be read as !!int"),
        ("a: !!bool 7", "7 cannot be read as !!bool"),
        ("b: 1\na: !!binary aGk=", r"line 2 \(the tag !!binary is not read"),
        ("a: !!timestamp 2001-01-01", "the tag !!timestamp is not read"),
        ("a: !!set {x, y}", "the tag !!set is not read"),
        ("a: !!python/object/apply:os.system [ls]", "the tag !!python/object/apply:os.system is not read"),
        ("a: !!map [1]", "a mapping was wanted"),
        ("a: &x [*x]", "an alias stands for what it is a part of"),
        ("a: &x {b: *x}", "an alias stands for what it is a part of"),
        ("a: *nobody", "found undefined alias 'nobody'"),
        ("a: " + "[" * 3000 + "]" * 3000, "more than 100 lists and mappings in one another"),
        ("a: " + "{a: " * 300 + "1" + "}" * 300, "more than 100 lists and mappings in one another"),
        (CHAIN, "more than 100 lists and mappings in one another"),
        (LAUGHS, "its aliases stand for more than 1000000 values"),
        (MERGES, "its aliases stand for more than 1000000 values"),
        ('a: "\\ud800"', "half of a letter of UTF-16"),
        ("a: \x07", r"at character 4 \(U\+0007, which no text holds\)"),
        ("{? [1, 2] : 3}", "found unhashable key"),
        ("a: 1\na: 2", "the key a is given twice"),
    ],
    ids=lambda text: text[:20],
)
def test_what_is_no_plain_yaml_is_refused_with_its_place(tmp_path, text, message):
    path = tmp_path / "columns.yaml"
    path.write_text(text, encoding="utf-8")
    started = time.process_time()
    with pytest.raises(ParameterError, match=message) as refusal:
        load_mapping(path, ParameterError)
    assert str(refusal.value).startswith(f"{path} is not valid YAML")
    assert time.process_time() - started < 5.0  # followed, the aliases would take hours


@pytest.mark.parametrize("word", ["2023-02-30", "2001-01-01", "2024-13-45T99:99:99", "1:30", "190:20:30.5", "0o17"])
def test_dates_and_times_are_texts(word):
    assert load_yaml(f"a: {word}") == {"a": word}


def test_aliases_of_a_reasonable_size_are_followed():
    # Oracle: the same file written out.
    assert load_yaml("a: &x {k: [1, 2]}\nb: *x\nc: {<<: *x, m: 3}") == {
        "a": {"k": [1, 2]},
        "b": {"k": [1, 2]},
        "c": {"k": [1, 2], "m": 3},
    }


@given(
    st.dictionaries(
        st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=8),
        st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=12)
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.dates().map(str)
        | st.booleans(),
        max_size=4,
    )
)
def test_what_is_written_is_read_back_unchanged(content):
    assert load_yaml(settings_text(content)) == content


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused_as_yaml(text):
    # Oracle: the kinds of value that JSON has, and none but them.
    with contextlib.suppress(yaml.YAMLError):
        assert isinstance(load_yaml(text), dict | list | str | int | float | None)


def test_a_file_of_many_megabytes_is_no_settings_file(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("# " + "x" * 6_000_000)
    with pytest.raises(ParameterError, match="has 6 MB, wanted a YAML file of at most 5 MB"):
        load_mapping(path, ParameterError)


@pytest.mark.parametrize(("value", "most"), [(1e13, 1e12), (-2.0, 1.0)])
def test_a_number_beyond_its_limit_is_refused(value, most):
    with pytest.raises(ParameterError, match="wanted a number within"):
        number_at(value, "a.yaml", "key", most=most)


def test_a_long_value_is_cut_in_the_message():
    with pytest.raises(ParameterError) as refusal:
        number_at("x" * 5000, "a.yaml", "key")
    assert len(str(refusal.value)) < 200


def test_the_file_itself_is_named(tmp_path):
    path = Path(tmp_path / "recordings.yaml")
    path.write_text("[1, 2]")
    with pytest.raises(ParameterError, match=r"recordings\.yaml holds the list \[1, 2\], wanted keys with values"):
        load_mapping(path, ParameterError)
