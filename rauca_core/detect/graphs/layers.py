"""What a network is made of once its file format is behind us.

Values between layers are named; a layer's value bears the layer's name. Images are (B, C, H, W), rows (B, N, K).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # float64 until batch norms are folded: small variances make scales that cost digits
ActivationKind = Literal["relu", "relu6", "sigmoid", "hard_swish"]

IMAGE = ":image"  # the network's input, (B, 3, size, size); no format allows this as a name


@dataclass(frozen=True)
class Layer:
    """One value: its name and the names of the values it is computed from."""

    name: str
    inputs: tuple[str, ...]


@dataclass(frozen=True)
class Convolution(Layer):
    """Cross-correlation with zero padding.

    Attributes:
        kernel: (out, in / groups, height, width).
        bias: (out,).
        padding: (rows, columns) on both sides; None for TensorFlow's SAME, which may pad one more after than before.
    """

    kernel: Array
    bias: Array
    stride: tuple[int, int]
    dilation: tuple[int, int]
    padding: tuple[int, int] | None
    groups: int


@dataclass(frozen=True)
class Affine(Layer):
    """value * scale + shift; both (C,) along the channels, or scalars ()."""

    scale: Array
    shift: Array


@dataclass(frozen=True)
class Activation(Layer):
    kind: ActivationKind


@dataclass(frozen=True)
class Sum(Layer):
    """Of two values of one shape."""


@dataclass(frozen=True)
class Product(Layer):
    """Of two images with the same channels; one may be 1 x 1."""


@dataclass(frozen=True)
class Mean(Layer):
    """Over rows and columns: (B, C, 1, 1)."""


@dataclass(frozen=True)
class Permute(Layer):
    order: tuple[int, ...]


@dataclass(frozen=True)
class Reshape(Layer):
    """To ``shape``; 0 keeps the value's own extent there, -1 takes what is left."""

    shape: tuple[int, ...]


@dataclass(frozen=True)
class Concat(Layer):
    axis: int


@dataclass(frozen=True)
class Softmax(Layer):
    axis: int
