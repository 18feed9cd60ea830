"""Files made by hand to hurt: each with the words that its reader says, or None where it may be read.

What the campaign of `fuzz` found lies beside as bytes in ``corpus/<reader>/``.
"""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tests.contract.samples import PLAN

from .mutate import DEPTH, LONG_NUMBER

DEEP = b"[" * DEPTH + b"]" * DEPTH
Nasty = tuple[str, str, Callable[[bytes], bytes], str | None]


def changed(**fields: Any) -> Callable[[bytes], bytes]:
    """The healthy JSON with other fields."""
    return lambda healthy: json.dumps({**json.loads(healthy), **fields}).encode()


def deep_within(healthy: bytes) -> bytes:
    """Not too deep to be read, but for whoever would write it again."""
    return changed(made="@")(healthy).replace(b'"@"', b"[" * 500 + b"]" * 500)


def given(data: bytes) -> Callable[[bytes], bytes]:
    return lambda healthy: data


def png(width: int, height: int, extra: bytes = b"") -> bytes:
    """A PNG of a few bytes that declares any size."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + extra + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")


def jpeg(width: int, height: int) -> bytes:
    frame = struct.pack(">HBHHB", 17, 8, height, width, 3) + b"\x01\x22\x00\x02\x11\x01\x03\x11\x01"
    return b"\xff\xd8\xff\xc0" + frame + b"\xff\xda\x00\x0c\x03\x01\x00\x02\x11\x03\x11\x00\x3f\x00" + bytes(50)


def archive(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def boasting(healthy: bytes) -> bytes:
    """An archive whose list of contents says that its arrays unpack to 3 GiB each."""
    changed, at = bytearray(healthy), 0
    while (at := changed.find(b"PK\x01\x02", at)) >= 0:
        changed[at + 24 : at + 28] = struct.pack("<I", 3 * 2**30)
        at += 4
    return bytes(changed)


def long_shape(healthy: bytes) -> bytes:
    """Positions whose header declares a shape of 12 TB."""
    source, stream = zipfile.ZipFile(io.BytesIO(healthy)), io.BytesIO()
    with zipfile.ZipFile(stream, "w") as target:
        for name in source.namelist():
            body = source.read(name)
            if name == "positions.npy":
                header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 3), }".ljust(117) + "\n"
                body = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode()
            target.writestr(name, body)
    return stream.getvalue()


def no_array(healthy: bytes) -> bytes:
    """A member that is named as an array and holds other bytes: numpy hands them out as they are."""
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(healthy)) as source, zipfile.ZipFile(stream, "w") as target:
        for name in source.namelist():
            target.writestr(name, b"no array")
    return stream.getvalue()


class Trap:
    """Pickled, it would write a file where it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (Path("trap was sprung"),)


def saved(value: object) -> bytes:
    stream = io.BytesIO()
    torch.save(value, stream)
    return stream.getvalue()


def safetensors(header: dict[str, Any], length: int | None = None, data: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + data


def onnx(change: Callable[[Any, Any, Any], None], value: Any) -> Callable[[bytes], bytes]:
    """The healthy graph after ``change(model, onnx, value)``."""

    def changed(healthy: bytes) -> bytes:
        import onnx

        model = onnx.load_model_from_string(healthy)
        change(model, onnx, value)
        return bytes(model.SerializeToString())

    return changed


def _size(model: Any, onnx: Any, size: int) -> None:
    for axis in (2, 3):
        model.graph.input[0].type.tensor_type.shape.dim[axis].dim_value = size


def _elsewhere(model: Any, onnx: Any, place: str) -> None:
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value=place)


def _literal(model: Any, onnx: Any, text: str) -> None:
    onnx.helper.set_model_props(model, {"names": text, "imgsz": text})


def _loop(model: Any, onnx: Any, kind: str) -> None:
    model.graph.node.insert(0, onnx.helper.make_node(kind, [], ["never"]))


def _function(model: Any, onnx: Any, kind: str) -> None:
    """A node in a branch in a function, called in front of the graph."""
    node, opsets = onnx.helper.make_node(kind, [], ["never"]), [onnx.helper.make_opsetid("", 17)]
    branch = onnx.helper.make_graph([node], "branch", [], [])
    choice = onnx.helper.make_node("If", ["x"], [], then_branch=branch, else_branch=branch)
    _call(model, onnx, [onnx.helper.make_function("own", "F0", ["x"], ["y"], [choice], opsets)])


def _laughs(model: Any, onnx: Any, count: int) -> None:
    """Functions that each call the next one twice."""
    opsets = [onnx.helper.make_opsetid("", 17), onnx.helper.make_opsetid("own", 1)]
    calls = [[(f"F{i + 1}", "x", "m"), (f"F{i + 1}", "m", "y")] for i in range(count)] + [[("Neg", "x", "y")]]
    made = [[onnx.helper.make_node(n, [a], [b], domain="own" if n[0] == "F" else "") for n, a, b in c] for c in calls]
    _call(model, onnx, [onnx.helper.make_function("own", f"F{i}", ["x"], ["y"], m, opsets) for i, m in enumerate(made)])


def _call(model: Any, onnx: Any, functions: list[Any]) -> None:
    model.functions.extend(functions)
    model.opset_import.append(onnx.helper.make_opsetid("own", 1))
    model.graph.node.insert(0, onnx.helper.make_node("F0", [model.graph.input[0].name], ["unused"], domain="own"))


def _expand(model: Any, onnx: Any, count: int) -> None:
    shape = onnx.numpy_helper.from_array(np.array([count], np.int64), "large")
    model.graph.initializer.append(shape)
    model.graph.node.insert(0, onnx.helper.make_node("ConstantOfShape", ["large"], ["unused"]))


HALF_BYTES = safetensors({"x": {"dtype": "F4", "shape": [2], "data_offsets": [0, 1]}}, None, b"x")
NET = b"[net]\nwidth=32\nheight=32\nchannels=3\n"
WIDE = NET + b"[convolutional]\nfilters=65536\nsize=31\n" * 3
LAYERS = NET + b"[maxpool]\nsize=1\n" * 5000
COARSE = NET + b"[maxpool]\nsize=1\nstride=32\n" * 300
FINE = NET + b"[upsample]\nstride=32\n" * 2
FINE += b"[convolutional]\nfilters=30\nsize=1\n[convolutional]\nfilters=7\nsize=1\n"
FINE += b"[yolo]\nmask=0\nanchors=4,6\nclasses=2\nnum=1\n"
MISFIT = (
    b"[net]\nwidth=32\nheight=32\nchannels=3\n[convolutional]\nfilters=7\nsize=3\npad=1\n[convolutional]\nfilters=7\n"
    b"size=3\n[shortcut]\nfrom=-2\n[yolo]\nmask=0\nanchors=4,6\nclasses=2\nnum=1\n"
)
RING = PLAN.ring.to_json() | {"azimuths_deg": [0.0] * 3000, "elevations_deg": [1.0] * 3000}
UNFIT = "cannot build|lacks|another model's weights"
OUTSIDE = "refused|outside|name of 1 to"

NASTY: tuple[Nasty, ...] = (
    *((name, "deep", given(DEEP), "nested|recursion") for name in ("plan", "study", "camouflage", "mmdet-config")),
    ("camouflage", "deep within", deep_within, "not valid JSON"),
    ("plan", "digits", lambda h: h.replace(b'"seed": 7', b'"seed": ' + LONG_NUMBER.encode()), "not valid JSON"),
    ("plan", "large number", changed(min_visible=10**400), "finite number"),
    ("plan", "not a number", changed(recolor_share=float("nan")), "finite number"),
    ("plan", "countless frames", changed(ring=RING, locations=10000), "plans 180000000000 frames"),
    ("plan", "odd color", changed(reference_srgb=[1e300, 0, 0]), "0 to 255"),
    ("plan", "weather's path", lambda h: h.replace(b'"day"', b'"../../day"'), "may hold only"),
    ("frame-json", "path", changed(id="../../x"), "relative path"),
    ("frame-json", "zero byte", changed(id="a\0b"), "folder is called"),
    ("camouflage", "path", changed(name="../../x"), OUTSIDE),
    ("camouflage", "hidden", changed(name=".bashrc"), OUTSIDE),
    ("vehicle-json", "path", changed(name="/tmp/x"), OUTSIDE),
    ("detector-card", "path", changed(called="../../x"), OUTSIDE),
    ("detector-card", "classes", changed(class_names=["x"] * 20_000), "at most"),
    ("checksums", "path", given(b"0" * 64 + b"  ../outside\n"), None),
    ("ledger", "odd frame", given(b'{"frame": ["x"], "state": "done"}\n{"frame": "x", "state": []}\n'), None),
    ("ledger", "deep", given(DEEP + b"\n"), None),
    ("history", "no object", given(b"3\n4\n"), "line 1 is damaged"),
    ("png", "60 000 pixels", given(png(60_000, 60_000)), "8192|bomb|exceeds"),
    ("png", "120 million pixels", given(png(12_000, 10_000)), "at most 8192x8192"),  # where Pillow warns
    ("png", "cut", given(png(99, 99)), "not a readable image"),
    ("png", "postscript", given(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n"), "not a readable image"),
    ("jpeg", "65 500 pixels", given(jpeg(65_500, 65_500)), "8192|bomb|exceeds"),
    ("vehicle-npz", "pickle", given(archive(positions=np.array([Trap()], object))), "damaged"),
    ("vehicle-npz", "lone array", given(b"\x93NUMPY\x01\x00\x76\x00" + b" " * 117 + b"\n"), "damaged"),
    ("vehicle-npz", "boasting", boasting, "unpacks to"),
    ("vehicle-npz", "long shape", long_shape, "damaged"),
    ("vehicle-npz", "no array", no_array, "is no array"),
    ("frame-npz", "no array", no_array, "is no array"),
    ("frame-npz", "text", given(archive(A=["x"], B=["y"], distance=["z"])), "values of type"),
    ("checkpoint-tensors", "long header", given(safetensors({}, 2**63)), "damaged"),
    ("checkpoint-tensors", "type", given(HALF_BYTES), "damaged"),
    ("checkpoint-json", "path", changed(tensors="../../x"), "relative path"),
    ("checkpoint-json", "identity", changed(identity=3), None),
    ("training-json", "identity", changed(identity=3), "another identity"),
    ("published-card", "wide", changed(widths=[4096] * 8), "parameters that its card"),
    ("extractor-card", "wide", changed(widths=[1024] * 8), "parameters that its card"),
    ("state-pth", "pickle", given(saved({"model": Trap()})), "could run code"),
    ("state-pth", "virtual", given(saved({"x": torch.zeros(1).expand(10**6, 10**6)})), "larger than what"),
    ("darknet-cfg", "wide", given(WIDE), "too large a network"),
    ("darknet-cfg", "many layers", given(LAYERS), "at most 1000"),
    ("darknet-cfg", "coarse", given(COARSE), "scales the image"),
    ("darknet-cfg", "fine", given(FINE), "too large"),
    ("darknet-cfg", "misfit", given(MISFIT), "do not fit together"),
    ("caffe-prototxt", "deep", given(b"a {" * 5000), "unexpected"),
    ("onnx", "vast", onnx(_size, 1_000_000), "at most 4096"),
    ("onnx", "path", onnx(_elsewhere, "../../../etc/passwd"), "outside its folder"),
    ("onnx", "absolute path", onnx(_elsewhere, "/etc/passwd"), "outside its folder"),
    ("onnx", "no file", onnx(_elsewhere, "."), "missing beside it"),
    ("onnx", "literal", onnx(_literal, "-" * 60_000 + "1"), None),
    ("onnx", "brackets", onnx(_literal, "[" * 60_000), None),
    ("onnx", "loop", onnx(_loop, "Loop"), "an operator Loop"),
    ("onnx", "loop in a function", onnx(_function, "Loop"), "an operator Loop"),
    ("onnx", "functions in functions", onnx(_laughs, 40), "more than 50000 nodes"),
    ("onnx", "expand", onnx(_expand, 2**45), None),
    ("transformers", "countless layers", changed(encoder_layers=2**31), "at most 256"),
    ("transformers", "wide", changed(d_model=2**16), "another model's weights|cannot build"),
    ("transformers", "number", changed(d_model=10**400), "at most"),
    ("transformers", "other file", changed(backbone="../evil", use_pretrained_backbone=True), UNFIT),
    ("preprocessor", "large number", changed(size={"height": 1e308, "width": float("inf")}), "not known here"),
)  # fmt: skip
