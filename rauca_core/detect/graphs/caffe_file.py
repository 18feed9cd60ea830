"""A caffemodel (NetParameter): the weights of each layer by its name."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import RaucaError
from .wire import Kind, Message, read_file

MAX_LAYERS = 10_000

# Field numbers of caffe.proto
_NET = {2: Kind.BYTES, 100: Kind.BYTES}
_LAYER = {1: Kind.BYTES, 7: Kind.BYTES}
_BLOB = {
    1: Kind.INTEGER,
    2: Kind.INTEGER,
    3: Kind.INTEGER,
    4: Kind.INTEGER,
    5: Kind.FLOAT32,
    7: Kind.BYTES,
    8: Kind.FLOAT64,
}
_SHAPE = {1: Kind.INTEGER}


def read_blobs(path: Path) -> dict[str, list[NDArray[Any]]]:
    """Weights in the order in which each layer holds them.

    Raises:
        RaucaError: missing, cut off or damaged file, a file of caffe's old format, values that do not fill a shape.
    """
    net = Message(path, read_file(path), _NET, MAX_LAYERS)
    if 2 in net:
        raise RaucaError(f"{path}: is in caffe's format of before 2014; upgrade it with upgrade_net_proto_binary")
    found: dict[str, list[NDArray[Any]]] = {}
    for data in net.messages(100):
        layer = Message(path, data, _LAYER)
        blobs = [_read_blob(path, layer.text(1), blob) for blob in layer.messages(7)]
        if layer.text(1) in found and blobs:
            raise RaucaError(f"{path}: two layers are called {layer.text(1)}")
        found.setdefault(layer.text(1), blobs)
    if not any(found.values()):
        raise RaucaError(f"{path}: holds no weights; this is no caffemodel")
    return found


def _read_blob(path: Path, layer: str, data: memoryview) -> NDArray[Any]:
    blob = Message(path, data, _BLOB, limit=2**24)
    values = blob.floats(5) if 5 in blob else blob.floats(8)
    if 7 in blob:
        shape = Message(path, blob.messages(7)[-1], _SHAPE, limit=16).integers(1)
    else:  # before blobs had shapes they were always num, channels, height, width
        shape = [blob.integer(number) for number in (1, 2, 3, 4)]
    if not all(0 < extent < 2**31 for extent in shape) or math.prod(shape) != len(values):
        raise RaucaError(f"{path}: layer {layer} holds {len(values)} values for a shape of {shape}; damaged file")
    if not np.isfinite(values).all():
        raise RaucaError(f"{path}: layer {layer} holds values that are not finite; damaged file")
    return values.reshape(shape)
