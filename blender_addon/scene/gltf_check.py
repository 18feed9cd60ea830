"""Looks into a glTF file before Blender's importer does: what it refers to, what it would grow to, what is no number.

The importer follows any path, makes arrays as long as a file says, and walks a scene however often it meets itself.
"""

from __future__ import annotations

import base64
import struct
from collections import Counter
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..core import contract, reading
from .images import image_header

FLOAT = 5126
JSON_CHUNK = 0x4E4F534A
MAX_FILE_BYTES = 2**31
"""Of the file, and of each buffer beside it; the format's own lengths end at twice that."""
MAX_JSON_BYTES = 2**26
MAX_NODES = 100_000
"""Blender makes an object of each; a car from a game has some hundreds."""
MAX_EMPTY_VALUES = 2**24
"""Of all accessors without data, which stand for zeros: the only arrays larger than the file."""


def check_gltf(path: Path) -> int:
    """Check a .glb or .gltf; returns how many vertices have a NaN or infinite coordinate in its plain buffers.

    Raises:
        RaucaError: a buffer or image outside the file's folder, one too large, too many nodes, or nodes that are no
            tree.
        ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError, struct.error: the file is damaged.
    """
    document, binary = _read(path)
    for kind in ("buffers", "images"):
        for entry in document.get(kind, []):
            if "uri" in entry and not entry["uri"].startswith("data:"):
                reading.require_inside(path, unquote(entry["uri"]))
    _check_tree(document, path)
    empty = sum(int(a["count"]) for a in document.get("accessors", []) if "bufferView" not in a)
    if not 0 <= empty <= MAX_EMPTY_VALUES:
        raise ValueError("its accessors declare more zeros than any mesh has vertices")
    for number, image in enumerate(document.get("images", [])):
        reading.require_size(_image_header(document, image, binary, path), f"{path}: image {number}")
    primitives = [p for mesh in document.get("meshes", []) for p in mesh["primitives"]]
    accessors = {p["attributes"]["POSITION"] for p in primitives if "POSITION" in p["attributes"]}
    return sum(_bad(document, document["accessors"][i], binary, path) for i in sorted(accessors))


def _read(path: Path) -> tuple[dict[str, Any], bytes]:
    data = reading.read_limited(path, MAX_FILE_BYTES, "a vehicle")
    text, binary = data, b""
    if data[:4] == b"glTF":
        length, kind = struct.unpack_from("<II", data, 12)
        if kind != JSON_CHUNK:
            raise ValueError("the first chunk is not JSON")
        text, binary = data[20 : 20 + length], data[20 + length + 8 :]
    if len(text) > MAX_JSON_BYTES:
        raise ValueError(f"its JSON is larger than {MAX_JSON_BYTES >> 20} MiB")
    try:
        document = reading.parse_json(text, "its glTF part")
    except contract.RaucaError as error:
        raise ValueError(str(error)) from error  # told as any other damage, with what to do
    if not isinstance(document, dict):
        raise TypeError("its JSON is no object")
    return document, binary


def _check_tree(document: dict[str, Any], path: Path) -> None:
    """Every node has one parent or none, and none is its own ancestor: else a walk may never end."""
    nodes = document.get("nodes", [])
    if len(nodes) > MAX_NODES:
        raise contract.RaucaError(f"{path}: has {len(nodes)} nodes; at most {MAX_NODES} are read")
    children = [list(node.get("children", [])) for node in nodes]
    parents = Counter(child for some in children for child in some)
    level = [index for index in range(len(nodes)) if index not in parents]
    reached = 0
    while level:
        reached += len(level)
        level = [child for index in level for child in children[index]]
        if reached > len(nodes):
            break
    if reached != len(nodes) or any(count > 1 for count in parents.values()):
        raise ValueError("its nodes are no tree")


def _image_header(document: dict[str, Any], image: dict[str, Any], binary: bytes, path: Path) -> bytes:
    """The first bytes of an image; none where Blender would not find it either."""
    if "bufferView" in image:
        view = document["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        data = _buffer(document["buffers"][view["buffer"]], binary, path)
        return bytes(data[start : start + min(view["byteLength"], reading.HEADER_BYTES)])
    uri = image.get("uri", "")
    if uri.startswith("data:"):
        return base64.b64decode(uri.split(",", 1)[1])[: reading.HEADER_BYTES]
    return image_header(path.parent / unquote(uri)) if uri else b""


def _buffer(buffer: dict[str, Any], binary: bytes, path: Path) -> bytes:
    uri = buffer.get("uri")
    if uri is None:
        return binary
    if uri.startswith("data:"):
        return base64.b64decode(uri.split(",", 1)[1])
    return reading.read_limited(path.parent / unquote(uri), MAX_FILE_BYTES, "a vehicle's buffer")


def _bad(document: dict[str, Any], accessor: dict[str, Any], binary: bytes, path: Path) -> int:
    if "bufferView" not in accessor or accessor["componentType"] != FLOAT:
        return 0  # compressed or quantized positions hold no NaN
    view = document["bufferViews"][accessor["bufferView"]]
    buffer = _buffer(document["buffers"][view["buffer"]], binary, path)
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    strides = (view.get("byteStride", 12), 4)
    points: np.ndarray = np.ndarray((accessor["count"], 3), "<f4", buffer, start, strides)
    return int((~np.isfinite(points)).any(axis=1).sum())
