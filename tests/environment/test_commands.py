"""`rauca efe` as users type it, on drawn data."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from pipelines.cli import app
from rauca_core.contract import Dataset, RaucaError
from rauca_core.contract.files import png_bytes
from rauca_core.environment import LightSplitter, ModelCard, estimate, load_exact
from rauca_core.environment.preview import preview
from rauca_core.environment.weights import load_extractor, load_published, save_extractor
from rauca_core.runtime.images import read_image
from rauca_core.training.extractor_fit import WEIGHTS, Fit, fit
from rauca_core.training.settings import ExtractorSettings

GREY = (140, 140, 140)


def efe(*arguments: object) -> None:
    app(["efe", *map(str, arguments)], standalone_mode=False)


@pytest.fixture
def weights(tmp_path) -> Path:
    torch.manual_seed(0)
    path = tmp_path / "tiny.safetensors"
    save_extractor(path, LightSplitter((8, 8), 4), ModelCard(widths=(8, 8), detail=4))
    return path


def test_train_finetune_evaluate(dataset, tmp_path):
    efe("train", dataset.folder, "--out", tmp_path / "a", "--epochs", 1, "--threads", 1)
    card = json.loads((tmp_path / "a" / "light-splitter.json").read_text())
    assert card["data"][0]["vehicle"] == "box"
    assert set(card["metrics"]) == {"clear", "fog", "all"}
    assert str(tmp_path) not in json.dumps(card)
    efe("finetune", dataset.folder, "--weights", tmp_path / "a" / WEIGHTS, "--out", tmp_path / "b", "--epochs", 1)
    told = tmp_path / "figures.json"
    efe("evaluate", dataset.folder, "--weights", tmp_path / "b" / WEIGHTS, "--json", told)
    figures = json.loads(told.read_text())
    assert set(figures) == {"clear", "fog", "all"}
    assert set(figures["all"]["ours"]) == {"psnr_db", "mse", "mae", "bce", "ms"}
    assert figures["all"]["transfer"]["mse"] < figures["all"]["none"]["mse"]


def test_the_papers_extractor_is_one_command(dataset, tmp_path):
    train = ("published", dataset.folder, "--out", tmp_path / "a", "--epochs", 1, "--threads", 1)
    efe(*train, "--width", "quarter")
    weights = tmp_path / "a" / "published.safetensors"
    assert load_published(weights).widths == (16, 32, 64, 128, 256)
    made = weights.read_bytes()
    efe(*train, "--width", "quarter")
    assert weights.read_bytes() == made
    with pytest.raises(RaucaError, match="other channels than --width paper; choose another --out"):
        efe(*train)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("published", "nowhere", "--out", "x"), "not a data set"),
        (("published", "nowhere", "--out", "x", "--width", "half"), "choose paper or quarter"),
        (("train", "nowhere", "--out", "x"), "not a data set"),
        (("train", "nowhere", "--out", "x", "--lr", "9"), "lr: "),
        (("evaluate", "nowhere", "--weights", "no.safetensors"), "no.safetensors: no such weights"),
        (("preview", "a.png", "b.png", "--out", "s.jpg"), "must end in .png"),
        (("preview", "a.png", "b.png", "--out", "s.png", "--reference", "grey"), "grey"),
    ],
)
def test_mistakes_are_one_line(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RaucaError, match=said) as caught:
        efe(*arguments)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_held_out_data_sets(dataset, dataset_factory, box_vehicle, tmp_path):
    other = dataset_factory(tmp_path / "other", box_vehicle, locations=1)
    settings = ExtractorSettings.make(epochs=1, threads=1)
    path, outcome = fit(Fit(datasets=[dataset.folder], out=tmp_path / "run", settings=settings, tests=[other.folder]))
    _, card = load_extractor(path)
    assert [(d["name"], d["frames"], d["tested on"]) for d in card.data] == [("data", 8, 0), ("other", 4, 4)]
    assert len(outcome.errors) == 2


def test_light_is_estimated_where_none_was_rendered(dataset, dataset_factory, box_vehicle, tmp_path, weights):
    dark = dataset_factory(tmp_path / "dark", box_vehicle, light=False)
    net, _ = load_extractor(weights)
    frame = dark.frames()[0].id
    light = estimate(Dataset(dark.folder), frame, net)
    exact = load_exact(dataset, frame)
    assert light.A.shape == exact.A.shape
    assert light.A.dtype == np.float32
    paint = read_image(dark.frame_folder(frame) / "paint.png") > 0
    assert (light.A[~paint] == 0).all()
    assert np.allclose(light.B[~paint], exact.B[~paint], atol=0.01)


class TestPreview:
    @pytest.fixture
    def files(self, tmp_path):
        rng = np.random.default_rng(0)
        image, mask = tmp_path / "car.png", tmp_path / "mask.png"
        image.write_bytes(png_bytes(rng.integers(0, 255, (30, 45, 3), np.uint8)))
        pixels = np.zeros((30, 45), np.uint8)
        pixels[5:20, 10:40] = 255
        mask.write_bytes(png_bytes(pixels))
        return image, mask

    def test_the_sheet(self, files, weights):
        net, _ = load_extractor(weights)
        sheet = preview(*files, GREY, net)
        assert sheet.shape == (3 * 30 + 8, 4 * 45 + 12, 3)
        assert (sheet[:30, :45] == read_image(files[0])).all()
        white, black = sheet[34:64, :45].astype(int), sheet[34:64, 49:94].astype(int)
        inside = read_image(files[1]) > 0
        assert (white[inside] >= black[inside]).all()
        assert (white[inside] > black[inside]).mean() > 0.5
        assert (white[~inside] == black[~inside]).all()

    def test_files_that_do_not_fit(self, files, weights, tmp_path):
        net, _ = load_extractor(weights)
        image = files[0]
        with pytest.raises(RaucaError, match="in color"):
            preview(image, image, GREY, net)
        small = tmp_path / "small.png"
        small.write_bytes(png_bytes(np.zeros((8, 8), np.uint8)))
        with pytest.raises(RaucaError, match=r"small.png: is 8x8 pixels, .*45x30"):
            preview(image, small, GREY, net)
        with pytest.raises(RaucaError, match="is empty"):
            preview(small, small, GREY, net)
