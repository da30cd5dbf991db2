"""Mutations that know what they change: lines and cells, elements and attributes, keys and values, arrays, bytes."""

import copy
import random
import re
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import yaml

from fuzz_values import LAUGHS, TEXTS, YAML_VALUES, bytes_value, value

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
_RAW = "RAWVALUE"


def several(rng: random.Random, content: Any, mutations: tuple[Callable[..., Any], ...]) -> Any:
    """One mutation most of the time, two or three at times."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        content = rng.choice(mutations)(rng, content)
    return content


# Bytes


def cut_bytes(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def flip_bits(rng: random.Random, data: bytes) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 4, 32))):
        if out:
            out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def put_bytes(rng: random.Random, data: bytes) -> bytes:
    at, new = rng.randrange(len(data) + 1), bytes_value(rng)
    return data[:at] + new + data[at + len(new) * rng.randrange(2) :]


def repeat_bytes(rng: random.Random, data: bytes) -> bytes:
    start = rng.randrange(len(data) + 1)
    stop = min(len(data), start + rng.choice((1, 8, 100)))
    return data[:stop] + data[start:stop] * rng.choice((1, 50)) + data[stop:]


BYTES = (cut_bytes, flip_bits, put_bytes, repeat_bytes)


def mutated_bytes(rng: random.Random, data: bytes) -> bytes:
    """Bytes cut off, flipped, put in or repeated."""
    return several(rng, data, BYTES)


# Lines of text


def change_number(rng: random.Random, text: str) -> str:
    found = list(_NUMBER.finditer(text))
    if not found:
        return text
    # Numbers near the start are as likely as all the others: names and heads stand there.
    one = rng.choice(found if rng.random() < 0.5 else found[:20])
    return text[: one.start()] + value(rng) + text[one.end() :]


def change_word(rng: random.Random, text: str) -> str:
    found = list(re.finditer(r"[A-Za-z_]\w*", text[:4000]))
    if not found:
        return text
    one = rng.choice(found)
    return text[: one.start()] + rng.choice(TEXTS) + text[one.end() :]


def change_lines(rng: random.Random, text: str) -> str:
    lines = text.split("\n")
    k = rng.randrange(len(lines)) if rng.random() < 0.7 else 0
    kind = rng.randrange(6)
    if kind == 0:
        del lines[k]
    elif kind == 1:
        lines.insert(k, lines[k])
    elif kind == 2:
        other = rng.randrange(len(lines))
        lines[k], lines[other] = lines[other], lines[k]
    elif kind == 3:
        lines[k] = value(rng)
    elif kind == 4:
        lines[k] = lines[k] + rng.choice((",", ";", '"', "\t", "#", ":", "\r", "\0"))
    else:
        lines = lines[:k]
    return "\n".join(lines)


def change_column(rng: random.Random, text: str) -> str:
    rows = [line.split(",") for line in text.split("\n")]
    k, new = rng.randrange(len(rows[0])), value(rng)
    kind = rng.randrange(5)
    for n, row in enumerate(rows):
        if k >= len(row):
            continue
        if kind == 0:
            del row[k]
        elif kind == 1:
            row.insert(k, row[k])
        elif kind == 2 and n:
            row[k] = new
        elif kind == 3 and not n:
            row[k] = rng.choice(("t", "q.pin", "q.", "f.tip.x", "v.pin", "i.pin", "x.pin", "q_ref.pin", "Tau.pin", new))
        elif kind == 4 and n:
            row[k] = f"{row[k]}e{rng.choice(('5', '-9', '300', '-300'))}" if "e" not in row[k] else row[k]
    return "\n".join(",".join(row) for row in rows)


TEXT = (change_number, change_number, change_word, change_lines)


def mutated_csv(rng: random.Random, text: str) -> bytes:
    """A table of text with wrong cells, rows and columns; now and then with wrong bytes."""
    out = several(rng, text, (*TEXT, change_column)).encode("utf-8", "surrogatepass")
    return mutated_bytes(rng, out) if rng.random() < 0.15 else out


# Elements and attributes


def _elements(root: ElementTree.Element) -> list[tuple[ElementTree.Element | None, ElementTree.Element]]:
    return [(None, root), *((parent, child) for parent in root.iter() for child in parent)]


def change_attribute(rng: random.Random, root: ElementTree.Element) -> ElementTree.Element:
    element = rng.choice([element for element in root.iter() if element.attrib] or [root])
    if not element.attrib:
        return root
    name = rng.choice(sorted(element.attrib))
    kind, old = rng.randrange(7), element.attrib[name]
    if kind == 0:
        del element.attrib[name]
    elif kind == 1:
        words = old.split() or [""]
        words[rng.randrange(len(words))] = value(rng)
        element.set(name, " ".join(words))
    elif kind == 2:
        element.set(name, f"{old} {old}")
    elif kind == 3:
        other = rng.choice(sorted(element.attrib))
        element.attrib[name], element.attrib[other] = element.attrib[other], old
    elif kind == 4:
        element.set(rng.choice(("name", "type", "value", "xyz", "axis", "pos", "class", "ref", "joint")), old)
    else:
        element.set(name, value(rng))
    return root


def change_element(rng: random.Random, root: ElementTree.Element) -> ElementTree.Element:
    pairs = [pair for pair in _elements(root) if pair[0] is not None]
    if not pairs:
        return root
    parent, child = rng.choice(pairs)
    assert parent is not None
    kind = rng.randrange(6)
    if kind == 0:
        parent.remove(child)
    elif kind == 1:
        parent.insert(rng.randrange(len(parent) + 1), copy.deepcopy(child))
    elif kind == 2:
        rng.choice([element for _, element in pairs]).append(copy.deepcopy(child))
    elif kind == 3:
        child.tag = rng.choice(("joint", "link", "body", "inertial", "geom", "mimic", "equality", "freejoint", "text"))
    elif kind == 4:
        child.text = value(rng)
    else:
        deep = child
        for _ in range(rng.choice((3, 300))):
            deep = ElementTree.SubElement(deep, child.tag, dict(child.attrib))
    return root


def change_facts(rng: random.Random, root: ElementTree.Element) -> ElementTree.Element:
    """What robots in the field have: limits swapped, a mimic, two axes, an inertia twice, another kind of joint."""
    joints = [element for element in root.iter("joint") if element.get("name")]
    links = [element for element in root.iter() if element.tag in ("link", "body")]
    if not joints or not links:
        return root
    joint, link, kind = rng.choice(joints), rng.choice(links), rng.randrange(8)
    limit = joint.find("limit")
    if kind == 0 and limit is not None:
        limit.set("lower", limit.get("upper", "1"))
        limit.set("upper", rng.choice(("-5", "nan", "1e308")))
    elif kind == 1:
        given = {"joint": rng.choice((joints[0].get("name", ""), "nobody", "")), "multiplier": value(rng)}
        ElementTree.SubElement(joint, "mimic", given)
    elif kind == 2:
        ElementTree.SubElement(joint, "axis", {"xyz": rng.choice(("0 0 0", "1 0 0", "nan 0 0", "1e-200 0 0"))})
    elif kind == 3 and link.find("inertial") is not None:
        link.append(copy.deepcopy(link.find("inertial")))  # type: ignore[arg-type]
    elif kind == 4:
        joint.set("type", rng.choice(("fixed", "floating", "planar", "prismatic", "continuous", "ball", "free", "")))
    elif kind == 5:
        joint.set("range", rng.choice(("1 -1", "0 0", "nan nan", "1")))
    elif kind == 6:
        joint.set("name", rng.choice((joints[0].get("name", ""), *TEXTS)))
    else:
        link.set("name", rng.choice((links[0].get("name", ""), *TEXTS)))
    return root


def mutated_xml(rng: random.Random, text: str) -> bytes:
    """A robot file with wrong elements and attributes; now and then with wrong text or bytes."""
    kind = rng.random()
    if kind < 0.15:
        return mutated_bytes(rng, text.encode())
    if kind < 0.3:
        return several(rng, text, TEXT).encode("utf-8", "surrogatepass")
    root = several(rng, ElementTree.fromstring(text), (change_attribute, change_element, change_facts))
    out = ElementTree.tostring(root, encoding="unicode").encode("utf-8", "surrogatepass")
    if rng.random() < 0.03:
        head = b'<!DOCTYPE a [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
        out = head + out.replace(b'name="', b'name="&b;', 1)
    return out


# Keys and values


def _places(content: Any) -> list[tuple[Any, Any]]:
    """Every container with the key or index of one of its entries."""
    found: list[tuple[Any, Any]] = []
    entries = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, entry in entries:
        found += [(content, key), *_places(entry)]
    return found


def change_entry(rng: random.Random, content: Any) -> Any:
    places = _places(content)
    if not places:
        return content
    holder, key = rng.choice(places)
    kind = rng.randrange(9)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, list):
        holder.insert(key, copy.deepcopy(holder[key]))
    elif kind == 1:
        holder[rng.choice((*TEXTS, 1, None, True))] = copy.deepcopy(holder[key])
    elif kind == 2:
        other, at = rng.choice(places)
        holder[key] = copy.deepcopy(other[at])
    elif kind == 3:
        holder[key] = [copy.deepcopy(holder[key])] * rng.choice((0, 1, 2))
    elif kind == 4:
        holder[key] = {rng.choice(("mass", "a", "kind")): copy.deepcopy(holder[key])}
    elif kind == 5 and isinstance(holder[key], int | float):
        holder[key] = -holder[key]
    elif kind == 6 and isinstance(holder[key], int | float):
        holder[key] = rng.choice((1e307, 1e-300, 10**400, 1e12, 0, 0.0, 2**64))
    else:
        holder[key] = f"{_RAW}{rng.randrange(len(YAML_VALUES) + len(TEXTS))}X"
    return content


def mutated_yaml(rng: random.Random, text: str) -> bytes:
    """A YAML file with wrong keys, values, tags, dates, aliases and nesting; now and then with wrong text or bytes."""
    kind = rng.random()
    if kind < 0.1:
        return mutated_bytes(rng, text.encode())
    if kind < 0.25:
        return several(rng, text, TEXT).encode("utf-8", "surrogatepass")
    if kind < 0.28:
        return (LAUGHS + text).encode()
    content = several(rng, yaml.safe_load(text), (change_entry,))
    out = yaml.dump(content, sort_keys=False, default_flow_style=rng.choice((None, False)))
    raw = (*YAML_VALUES, *TEXTS)
    return re.sub(rf"{_RAW}(\d+)X", lambda found: raw[int(found.group(1))], out).encode("utf-8", "surrogatepass")


def mutated_json(rng: random.Random, text: str, loads: Callable[[str], Any], dumps: Callable[[Any], str]) -> bytes:
    """A JSON file with wrong keys and values; now and then with wrong text or bytes."""
    if rng.random() < 0.25:
        return several(rng, text, TEXT).encode("utf-8", "surrogatepass")
    out = dumps(several(rng, loads(text), (change_entry,)))
    return re.sub(rf'"{_RAW}(\d+)X"', lambda _: rng.choice(("NaN", "1e999", "[" * 2000, '"x"')), out).encode()
