"""Looks into a glTF file for what Blender's importer passes over: vertices that are not numbers."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

FLOAT = 5126
JSON_CHUNK = 0x4E4F534A


def bad_vertices(path: Path) -> int:
    """Number of vertices with a NaN or infinite coordinate in the plain buffers of a .glb or .gltf.

    Raises:
        ValueError, KeyError, struct.error, OSError: the file is damaged.
    """
    document, binary = _read(path)
    primitives = [p for mesh in document.get("meshes", []) for p in mesh["primitives"]]
    accessors = {p["attributes"]["POSITION"] for p in primitives if "POSITION" in p["attributes"]}
    return sum(_bad(document, document["accessors"][i], binary, path) for i in sorted(accessors))


def _read(path: Path) -> tuple[dict[str, Any], bytes]:
    data = path.read_bytes()
    if data[:4] != b"glTF":
        return json.loads(data), b""
    length, kind = struct.unpack_from("<II", data, 12)
    if kind != JSON_CHUNK:
        raise ValueError("the first chunk is not JSON")
    return json.loads(data[20 : 20 + length]), data[20 + length + 8 :]


def _bad(document: dict[str, Any], accessor: dict[str, Any], binary: bytes, path: Path) -> int:
    if "bufferView" not in accessor or accessor["componentType"] != FLOAT:
        return 0  # compressed or quantised positions hold no NaN
    view = document["bufferViews"][accessor["bufferView"]]
    uri = document["buffers"][view["buffer"]].get("uri")
    if uri is None:
        buffer = binary
    elif uri.startswith("data:"):
        buffer = base64.b64decode(uri.split(",", 1)[1])
    else:
        buffer = (path.parent / unquote(uri)).read_bytes()
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    strides = (view.get("byteStride", 12), 4)
    points: np.ndarray = np.ndarray((accessor["count"], 3), "<f4", buffer, start, strides)
    return int((~np.isfinite(points)).any(axis=1).sum())
