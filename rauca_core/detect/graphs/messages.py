"""The messages of TensorFlow's and caffe's files, as far as SSDs need them, read by Google's protobuf library.

In binary a message inside another is declared as bytes and parsed when it is asked for, so nothing nests: of empty
messages alone a file becomes sixteen times as large, never more. Fields that are not named here are skipped in binary;
in text they are refused, as any of them could change the computation.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, text_format
from google.protobuf.message import DecodeError

from ...contract import RaucaError
from ...contract.reading import read_limited, read_text

MAX_FILE_BYTES = 2**27  # SSD300 on VGG, the largest in use, has 105 MB
MAX_TEXT_BYTES = 2**20

_BINARY = {
    # tensorflow/core/framework: graph.proto, node_def.proto, attr_value.proto, tensor.proto
    "GraphDef": "repeated bytes node = 1",
    "NodeDef": "string name = 1; string op = 2; repeated string input = 3; repeated bytes attr = 5",
    "Entry": "string key = 1; bytes value = 2",
    "AttrValue": "bytes list = 1; string s = 2; int64 i = 3; float f = 4; bool b = 5; int32 type = 6; bytes shape = 7; "
    "bytes tensor = 8",
    "ListValue": "repeated int64 i = 3",
    "TensorShape": "repeated bytes dim = 2",
    "Dim": "int64 size = 1; string name = 2",
    "TensorProto": "int32 dtype = 1; bytes tensor_shape = 2; bytes tensor_content = 4; repeated float float_val = 5; "
    "repeated double double_val = 6; repeated int32 int_val = 7; repeated int64 int64_val = 10; "
    "repeated bool bool_val = 11",
    # caffe.proto, of the weights
    "NetParameter": "string name = 1; repeated bytes layers = 2; repeated bytes layer = 100",
    "LayerParameter": "string name = 1; string type = 2; repeated bytes blobs = 7",
    "BlobProto": "int32 num = 1; int32 channels = 2; int32 height = 3; int32 width = 4; repeated float data = 5; "
    "bytes shape = 7; repeated double double_data = 8",
    "BlobShape": "repeated int64 dim = 1",
}

# caffe.proto, of the description in text; numbers are of no matter there, defaults stand in brackets
_TEXT = {
    "Network": "string name; string input; Shape input_shape; repeated int64 input_dim; repeated Layer layer",
    "Shape": "repeated int64 dim",
    "Layer": "string name; string type; repeated string bottom; repeated string top; repeated Param param; "
    "Phase phase; repeated Include include; "
    "Input input_param; Convolution convolution_param; BatchNorm batch_norm_param; "
    "Scale scale_param; ReLU relu_param; Permute permute_param; Flatten flatten_param; Reshape reshape_param; "
    "Softmax softmax_param; Concat concat_param; PriorBox prior_box_param; DetectionOutput detection_output_param",
    "Param": "string name; double lr_mult; double decay_mult",
    "Include": "Phase phase [TEST]",
    "Input": "Shape shape",
    "Filler": "string type; double value; double min; double max; double mean; double std; Norm variance_norm",
    "Convolution": "uint32 num_output; bool bias_term [true]; uint32 pad [0]; uint32 kernel_size; uint32 stride [1]; "
    "uint32 dilation [1]; uint32 group [1]; Engine engine; Filler weight_filler; Filler bias_filler",
    "BatchNorm": "bool use_global_stats [true]; double eps [1e-5]; double moving_average_fraction",
    "Scale": "bool bias_term [false]; Filler filler; Filler bias_filler",
    "ReLU": "double negative_slope [0]; Engine engine",
    "Permute": "repeated uint32 order",
    "Flatten": "int32 axis [1]",
    "Reshape": "Shape shape",
    "Softmax": "int32 axis [1]; Engine engine",
    "Concat": "int32 axis [1]",
    "PriorBox": "repeated double min_size; repeated double max_size; repeated double aspect_ratio; bool flip [true]; "
    "bool clip [false]; repeated double variance; double step; double step_h; double step_w; double offset [0.5]",
    "DetectionOutput": "uint32 num_classes; bool share_location [true]; int32 background_label_id [0]; "
    "bool variance_encoded_in_target [false]; CodeType code_type [CORNER]; Suppression nms_param; int32 keep_top_k; "
    "double confidence_threshold",
    "Suppression": "double nms_threshold; int32 top_k; double eta",
}
_ENUMS = {
    "Phase": ("TRAIN", "TEST"),
    "Engine": ("DEFAULT", "CAFFE", "CUDNN"),
    "Norm": ("FAN_IN", "FAN_OUT", "AVERAGE"),
    "CodeType": ("CORNER", "CENTER_SIZE", "CORNER_SIZE"),
}
_FIELD = re.compile(r"(repeated )?(\w+) (\w+)(?: = (\d+))?(?: \[(.+)\])?")


def _classes(syntax: str, messages: Mapping[str, str]) -> SimpleNamespace:
    """The library's class of each message."""
    of = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name=f"{syntax}.proto", package="rauca", syntax=syntax)
    for name, words in _ENUMS.items() if syntax == "proto2" else ():
        value = descriptor_pb2.EnumValueDescriptorProto
        file.enum_type.add(name=name, value=[value(name=word, number=k) for k, word in enumerate(words)])
    for message, text in messages.items():
        described = file.message_type.add(name=message)
        for place, declared in enumerate(text.split("; "), 1):
            found = _FIELD.fullmatch(declared)
            assert found is not None, declared
            repeated, kind, name, number, default = found.groups()
            field = described.field.add(name=name, number=int(number or place), default_value=default)
            field.label = of.LABEL_REPEATED if repeated else of.LABEL_OPTIONAL
            if kind[0].isupper():
                field.type_name = f".rauca.{kind}"
            else:
                field.type = getattr(of, f"TYPE_{kind.upper()}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    kinds = {name: pool.FindMessageTypeByName(f"rauca.{name}") for name in messages}
    return SimpleNamespace(**{name: message_factory.GetMessageClass(kind) for name, kind in kinds.items()})


BINARY = _classes("proto3", _BINARY)  # which refuses names that are no text
TEXT = _classes("proto2", _TEXT)  # which has defaults


def read_file(kind: Any, path: Path) -> Any:
    """The message that a file is; raises as :func:`parse`, and for a file that is missing, or far too large."""
    return parse(kind, read_limited(path, MAX_FILE_BYTES, "a detector's weights"), path)


def parse(kind: Any, data: bytes, path: Path) -> Any:
    """The message in ``data``, part of the file ``path``; raises :class:`RaucaError` when it is none."""
    try:
        return kind.FromString(data)
    except DecodeError as error:
        name = kind.DESCRIPTOR.name
        raise RaucaError(f"{path}: holds no {name} where one belongs; cut off, damaged, or another format") from error


def read_prototxt(path: Path) -> Any:
    """A caffe network's description.

    Raises:
        RaucaError: missing file, another format, an option that is not known; names the line.
    """
    text = read_text(path, MAX_TEXT_BYTES, "a caffe network in text")
    try:
        return text_format.Parse(text, TEXT.Network())
    except text_format.ParseError as error:
        place, _, reason = str(error).partition(" : ")
        line = place.partition(":")[0]
        told = " ".join(reason.split())[:200]
        raise RaucaError(f"{path}:{line}: unexpected in a caffe network in text: {told}") from error
