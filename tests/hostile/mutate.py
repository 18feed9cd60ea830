"""Damage for files: what a disk, a careless writer or an attacker might make of a valid one.

Everything is drawn from a ``random.Random``, so the same damage serves hypothesis (whose Random shrinks) and the
coverage-guided campaign of `fuzz`.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable
from random import Random
from typing import Any

INTEGERS = (0, -1, 1, 2, 127, 255, 4096, 65535, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)
NUMBERS = (*INTEGERS, -(2**31), -(2**63), 10**400, 0.5, 1e-300, 1e308, -1e308, float("nan"), float("inf"), -0.0)
TEXTS = (
    *("", ".", "..", "../../../../etc/passwd", "/etc/passwd", "a/../../b", "C:\\x", "~root", "file:///etc/passwd"),
    *("\x00", "a\x00b", "\ud800", "é" * 300, "$(touch x)", "{0}%s", "__import__('os').getcwd()", "1e999", "nan"),
)
DEPTH = 100_000
LONG_NUMBER = "9" * 5000  # beyond the digits that Python turns into an int
_DEEP, _LONG = "@deep@", "@long@"
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e-?\d+)?")


def mutate_bytes(data: bytes, rng: Random) -> bytes:
    """One to four local accidents: cut, flipped, inserted, doubled, dropped, or overwritten with a large number."""
    for _ in range(rng.randint(1, 4)):
        data = rng.choice(_ACCIDENTS)(data, rng)
    return data


def mutate_text(data: bytes, rng: Random) -> bytes:
    """Lines doubled, dropped or exchanged, numbers replaced; sometimes the bytes themselves."""
    if rng.random() < 0.2:
        return mutate_bytes(data, rng)
    for _ in range(rng.randint(1, 3)):
        data = rng.choice((_exchange_number, _exchange_number, _line))(data, rng)
    return data


def mutate_json(data: bytes, rng: Random) -> bytes:
    """Values replaced, dropped, doubled or nested beyond measure; sometimes the text or bytes themselves."""
    if rng.random() < 0.2:
        return mutate_text(data, rng)
    try:
        tree = {"": json.loads(data)}
    except (ValueError, RecursionError):
        return mutate_bytes(data, rng)
    for _ in range(rng.randint(1, 3)):
        places = list(_places(tree, 0))
        holder, key = places[rng.randrange(len(places))]
        action = rng.random()
        if action < 0.15 and holder is not tree:
            del holder[key]
        elif action < 0.25 and isinstance(holder, list):
            holder.append(holder[key])
        else:
            holder[key] = _value(rng)
    text = json.dumps(tree[""])
    return text.replace(f'"{_DEEP}"', "[" * DEPTH + "]" * DEPTH).replace(f'"{_LONG}"', LONG_NUMBER).encode()


def mutate_lines(data: bytes, rng: Random) -> bytes:
    """One line of JSON lines as :func:`mutate_json`, or the file as text."""
    lines = data.splitlines()
    if not lines or rng.random() < 0.2:
        return mutate_text(data, rng)
    index = rng.randrange(len(lines))
    lines[index] = mutate_json(lines[index], rng)
    return b"\n".join(lines) + b"\n"


def _value(rng: Random) -> Any:
    kind = rng.randrange(6)
    if kind == 0:
        return rng.choice((None, True, False, [], {}, [[]], [None], {"": 0}))
    if kind == 1:
        return rng.choice((_DEEP, _LONG, "x" * 70_000, [0] * 5000))
    return rng.choice(NUMBERS) if kind < 4 else rng.choice(TEXTS)


def _places(value: Any, depth: int) -> Any:
    """Every (holder, key) of a tree."""
    if depth < 20 and isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield value, key
            yield from _places(value[key], depth + 1)


def _cut(data: bytes, rng: Random) -> bytes:
    return data[: rng.randint(0, len(data))]


def _flip(data: bytes, rng: Random) -> bytes:
    if not data:
        return data
    changed = bytearray(data)
    changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _insert(data: bytes, rng: Random) -> bytes:
    at = rng.randint(0, len(data))
    return data[:at] + rng.randbytes(rng.choice((1, 2, 4, 16, 300))) + data[at:]


def _double(data: bytes, rng: Random) -> bytes:
    begin = rng.randint(0, len(data))
    end = rng.randint(begin, min(len(data), begin + 4096))
    return data[:end] + data[begin:end] * rng.choice((1, 1, 20)) + data[end:]


def _drop(data: bytes, rng: Random) -> bytes:
    begin = rng.randint(0, len(data))
    return data[:begin] + data[begin + rng.choice((1, 4, 64, 1024)) :]


def _overwrite(data: bytes, rng: Random) -> bytes:
    kind = rng.choice(("B", "<H", ">H", "<I", ">I", "<Q", ">Q", "<f"))
    if kind == "<f":
        word = struct.pack(kind, rng.choice((float("nan"), float("inf"), -1e38, 1e-40)))
    else:
        word = struct.pack(kind, rng.choice(INTEGERS) % 2 ** (8 * struct.calcsize(kind)))
    at = rng.randint(0, len(data))
    return data[:at] + word + data[at + len(word) :]


def _exchange_number(data: bytes, rng: Random) -> bytes:
    numbers = list(_NUMBER.finditer(data))
    if not numbers:
        return _flip(data, rng)
    found = rng.choice(numbers)
    fresh = rng.choice((str(rng.choice(NUMBERS)), LONG_NUMBER, "x"))
    return data[: found.start()] + fresh.encode() + data[found.end() :]


def _line(data: bytes, rng: Random) -> bytes:
    lines = data.split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    action = rng.randrange(4)
    if action == 0:
        lines.insert(at, lines[other])
    elif action == 1:
        del lines[at]
    elif action == 2:
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines[at] = rng.choice(TEXTS).encode(errors="replace")
    return b"\n".join(lines)


Damage = Callable[[bytes, Random], bytes]
_ACCIDENTS: tuple[Damage, ...] = (_cut, _flip, _flip, _insert, _double, _drop, _overwrite, _overwrite)
