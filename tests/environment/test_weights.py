from __future__ import annotations

import json

import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.environment import LightSplitter, ModelCard, load_extractor, save_extractor
from rauca_core.environment.weights import shipped_weights

CARD = ModelCard(widths=(8, 8), detail=4, data=[{"name": "drawn"}], command="rauca efe train", seed=3, epochs=2)


@pytest.fixture
def saved(tmp_path):
    torch.manual_seed(0)
    net = LightSplitter(CARD.widths, CARD.detail)
    path = tmp_path / "net.safetensors"
    save_extractor(path, net, CARD)
    return path, net


def test_weights_come_back(saved):
    path, net = saved
    again, card = load_extractor(path)
    assert card.to_json() == CARD.to_json() | {"widths": [8, 8]}
    assert not again.training
    assert all(torch.equal(a, b) for a, b in zip(net.state_dict().values(), again.state_dict().values(), strict=True))


def change(path, **fields):
    card = path.with_suffix(".json")
    card.write_text(json.dumps(json.loads(card.read_text()) | fields))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda p: p.unlink(), "no such weights"),
        (lambda p: p.with_suffix(".json").unlink(), "model card is missing"),
        (lambda p: p.write_bytes(p.read_bytes()[:-3]), "not the file that its card describes"),
        (lambda p: change(p, widths=[8, 16]), "does not hold the network"),
        (lambda p: change(p, widths=[8]), "2 to 8 levels"),
        (lambda p: change(p, detail=7), "multiple of 4"),
        (lambda p: change(p, metrics=[]), "metrics: must be a JSON object"),
        (lambda p: change(p, version=99), "update rauca"),
        (lambda p: change(p, surprise=1), "surprise"),
    ],
)
def test_anything_wrong_is_one_line(saved, spoil, said):
    path, _ = saved
    spoil(path)
    with pytest.raises(RaucaError, match=said) as caught:
        load_extractor(path)
    assert "\n" not in str(caught.value)
    assert "net." in str(caught.value)


def test_weights_that_are_not_finite_are_refused(saved):
    path, net = saved
    torch.nn.init.constant_(net.head.bias, float("nan"))
    save_extractor(path, net, CARD)
    with pytest.raises(RaucaError, match="NaN"):
        load_extractor(path)


@pytest.mark.stored
def test_the_shipped_weights_are_small_and_better_than_none():
    net, card = load_extractor()
    assert shipped_weights().stat().st_size < 10 * 2**20
    assert card.metrics["all"]["psnr_db"] > 25
    assert card.command.startswith("rauca efe train")
    assert sum(p.numel() for p in net.parameters()) < 1e6
