"""Fewer layers that compute the same: batch norms inside convolutions, hard swish in one piece."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from .layers import Activation, Affine, Convolution, Layer, Product


def simplify(layers: Iterable[Layer], outputs: Iterable[str]) -> list[Layer]:
    """Layers, in an order of computation, that give the same ``outputs``; values in between may disappear."""
    kept = {layer.name: layer for layer in layers}
    outputs = tuple(outputs)
    _drop_identities(kept, outputs)
    _join_hard_swish(kept, outputs)
    _fold_affine(kept, outputs)
    return list(kept.values())


def _uses(layers: dict[str, Layer], outputs: tuple[str, ...]) -> Counter[str]:
    uses = Counter(name for layer in layers.values() for name in layer.inputs)
    uses.update(outputs)
    return uses


def _drop_identities(layers: dict[str, Layer], outputs: tuple[str, ...]) -> None:
    """Graphs divide all scores by a temperature of 1."""
    renamed: dict[str, str] = {}
    for name, layer in list(layers.items()):
        inputs = tuple(renamed.get(source, source) for source in layer.inputs)
        if _is_affine(layer, 1.0, 0.0) and name not in outputs:
            renamed[name] = inputs[0]
            del layers[name]
        elif inputs != layer.inputs:
            layers[name] = replace(layer, inputs=inputs)


def _fold_affine(layers: dict[str, Layer], outputs: tuple[str, ...]) -> None:
    """An affine map after a convolution, or after another affine map, that nobody else reads becomes part of it."""
    uses = _uses(layers, outputs)
    for name, layer in list(layers.items()):
        before = layers.get(layer.inputs[0])
        if not isinstance(layer, Affine) or before is None or uses[before.name] > 1:
            continue
        if isinstance(before, Convolution):
            kernel = before.kernel * layer.scale.reshape(-1, 1, 1, 1)
            joined: Layer = replace(before, name=name, kernel=kernel, bias=before.bias * layer.scale + layer.shift)
        elif isinstance(before, Affine):
            joined = replace(
                before, name=name, scale=before.scale * layer.scale, shift=before.shift * layer.scale + layer.shift
            )
        else:
            continue
        layers[name] = joined
        del layers[before.name]


def _join_hard_swish(layers: dict[str, Layer], outputs: tuple[str, ...]) -> None:
    """x * relu6(x + 3) / 6 is spelled out in four nodes; one layer of torch's own is several times faster."""
    uses = _uses(layers, outputs)
    for name, sixth in list(layers.items()):
        chain = _hard_swish_chain(layers, sixth)
        if chain and all(uses[inner] == 1 for inner in chain[1:]):
            layers[name] = Activation(name, chain[:1], "hard_swish")
            for inner in chain[1:]:
                del layers[inner]


def _hard_swish_chain(layers: dict[str, Layer], sixth: Layer) -> tuple[str, ...]:
    """(x, x + 3, relu6, product) when ``sixth`` ends such a chain, else ()."""
    product = layers.get(sixth.inputs[0])
    if not (_is_affine(sixth, 1 / 6, 0.0) and isinstance(product, Product)):
        return ()
    for x, gate in (product.inputs, product.inputs[::-1]):
        relu6 = layers.get(gate)
        if not (isinstance(relu6, Activation) and relu6.kind == "relu6"):
            continue
        three = layers.get(relu6.inputs[0])
        if three is not None and _is_affine(three, 1.0, 3.0) and three.inputs == (x,):
            return x, three.name, relu6.name, product.name
    return ()


def _is_affine(layer: Layer, scale: float, shift: float) -> bool:
    return (
        isinstance(layer, Affine)
        and layer.scale.ndim == 0
        and layer.shift.ndim == 0
        and bool(np.isclose(layer.scale, scale, rtol=1e-6))
        and bool(np.isclose(layer.shift, shift, rtol=1e-6))
    )
