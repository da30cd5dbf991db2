"""Reads YAML with plain values only, and refuses short files that expand to a very large content.

Unlike in PyYAML, ``1e-3`` is a number and ``2024-01-31`` a text. The following is refused: repeated keys, tags other
than those of plain values, values that do not fit their tag, numbers that are too large for a float, deep nesting, and
aliases that contain themselves or expand to very many values.
"""

from __future__ import annotations

import re
from typing import Any

import yaml

# Deepest nesting of lists and mappings; files of this project need six, and Python allows a thousand nested calls.
_DEEPEST = 100
_TOO_DEEP = f"lists and mappings nested more than {_DEEPEST} deep"
# Largest number of values after aliases are expanded; files of robots have a hundredth of this.
_MOST_VALUES = 1_000_000
_TAG = "tag:yaml.org,2002:"
_NUMBERS = (_TAG + "int", _TAG + "float")
_PLAIN = tuple(_TAG + kind for kind in ("null", "bool", "int", "float", "str", "seq", "map"))


def load_yaml(text: str) -> Any:
    """Content of a YAML text: mappings, lists, texts, numbers, true and false, None.

    Raises:
        yaml.YAMLError: If the text is no valid YAML or is refused; with the line if it is known.
    """
    return yaml.load(text, Loader=_Loader)


def _error_at(problem: str, node: yaml.Node | yaml.Event) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)


class _Loader(yaml.SafeLoader):
    """Loader that builds plain values and refuses everything else."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()
        if self._depth >= _DEEPEST:
            raise _error_at(_TOO_DEEP, event)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None:
            _require_small(node)
        return node

    def resolve(self, kind: type[yaml.Node], value: Any, implicit: Any) -> str:
        tag = super().resolve(kind, value, implicit)
        # In YAML 1.1, 1:30 is the number 90; here it stays a text.
        return _TAG + "str" if tag in _NUMBERS and ":" in value else tag

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            value = super().construct_object(node, deep)
        # int(), float() and PyYAML's table of true and false raise these errors.
        except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
            kind = node.tag.removeprefix(_TAG)
            raise _error_at(f"{_cut(node)} cannot be read as !!{kind}", node) from error
        if isinstance(value, int) and not isinstance(value, bool) and abs(value) > _LARGEST_FLOAT:
            raise _error_at(f"the number {_cut(node)} is too large", node)
        if isinstance(value, str) and any("\ud800" <= letter <= "\udfff" for letter in value):
            raise _error_at("half of a surrogate pair, which is no character", node)
        return value

    def construct_mapping(self, node: yaml.Node, deep: bool = False) -> dict[Any, Any]:
        if not isinstance(node, yaml.MappingNode):
            raise _error_at("a mapping was wanted", node)
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in seen:
                raise _error_at(f"the key {_cut(key)} is given twice", key)
            seen.add(key.value)
        return super().construct_mapping(node, deep)

    def no_such_tag(self, node: yaml.Node) -> Any:
        """Refuse a value with a tag that is not plain."""
        tag = node.tag.replace(_TAG, "!!")
        raise _error_at(f"the tag {tag[:40]} is not allowed, only plain values are", node)


_LARGEST_FLOAT = int(1.7976931348623157e308)


def _cut(node: yaml.Node) -> str:
    """Text of a node, for a message."""
    text = node.value if isinstance(node, yaml.ScalarNode) else "a list or mapping"
    return text if len(text) <= 40 else f"{text[:40]}…"


def _require_small(root: yaml.Node) -> None:
    """Refuse a node that contains itself, or that has very many values or levels after aliases are expanded."""
    # Size and depth of each visited node by its id, because an alias repeats a node.
    known: dict[int, tuple[int, int]] = {}
    open_nodes: set[int] = set()

    def size_and_depth(node: yaml.Node) -> tuple[int, int]:
        if id(node) in open_nodes:
            raise _error_at("an alias stands for a list or mapping that contains it", node)
        if id(node) not in known:
            open_nodes.add(id(node))
            parts = [size_and_depth(part) for part in _parts(node)]
            open_nodes.discard(id(node))
            known[id(node)] = 1 + sum(size for size, _ in parts), 1 + max((depth for _, depth in parts), default=0)
        size, depth = known[id(node)]
        if size > _MOST_VALUES:
            raise _error_at(f"with its aliases expanded it has more than {_MOST_VALUES} values", node)
        if depth > _DEEPEST:
            raise _error_at(_TOO_DEEP, node)
        return size, depth

    size_and_depth(root)


def _parts(node: yaml.Node) -> list[yaml.Node]:
    """Entries of a list, keys and values of a mapping."""
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


_Loader.yaml_constructors = {tag: make for tag, make in _Loader.yaml_constructors.items() if tag in _PLAIN}
_Loader.yaml_constructors[None] = _Loader.no_such_tag
# Dates stay text, because no key takes a date, and PyYAML's message for an impossible date is not clear.
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != _TAG + "timestamp"]
    for first, resolvers in _Loader.yaml_implicit_resolvers.items()
}


class _Dumper(yaml.SafeDumper):
    """Dumper that quotes a text if the loader would read it as a number or change its line breaks."""


def _text_node(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    # Without quotes, PyYAML would read rare line breaks back as spaces or as several line breaks.
    return dumper.represent_scalar(_TAG + "str", text, style='"' if _RARE_BREAKS & set(text) else None)


_RARE_BREAKS = set("\x85\u2028\u2029")
_Dumper.add_representer(str, _text_node)

# PyYAML follows YAML 1.1, where a number with an exponent needs a point: 1e-3 would be text.
for _side in (_Loader, _Dumper):
    _side.add_implicit_resolver(_TAG + "float", re.compile(r"^[-+]?\d+(?:\.\d*)?[eE][-+]?\d+$"), list("-+0123456789"))


def settings_text(content: dict[str, Any]) -> str:
    """Plain values as YAML that `load_yaml` reads back unchanged, keys in their order."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
