"""transformers' detection models: the real classes, small and with random weights, through a folder."""

from __future__ import annotations

import copy
import importlib.util
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from rauca_core.contract import RaucaError
from rauca_core.detect import load_detector
from rauca_core.detect.families import Resolved
from rauca_core.detect.frameworks.scaling import Scaling, read_scaling
from rauca_core.detect.frameworks.transformers_detector import TransformersDetector, load
from rauca_core.detect.frameworks.transformers_loading import (
    FAMILIES,
    import_transformers,
    translated_config,
    translated_name,
)
from tests.detect.gradients import checked_gradient

pytestmark = pytest.mark.skipif(not importlib.util.find_spec("transformers"), reason="the extra detectors is missing")

NAMES = {0: "N/A", 1: "Car", 2: "motorbike"}
SIZE = 96
PROCESSORS = {
    "detr": "DetrImageProcessor",
    "deformable_detr": "DeformableDetrImageProcessor",
    "rt_detr": "RTDetrImageProcessor",
    "rt_detr_v2": "RTDetrImageProcessor",
    "yolos": "YolosImageProcessor",
}


def photographs(count: int = 2, height: int = 60, width: int = 90) -> Tensor:
    torch.manual_seed(1)
    return nn.functional.interpolate(torch.rand(count, 3, 6, 9), (height, width), mode="bicubic").clamp(0, 1)


def small_model(kind: str) -> Any:
    """Every part of the architecture, narrow; all weights random, as some begin at zero and would hide mistakes."""
    transformers = import_transformers()
    backbone = {"embedding_size": 8, "hidden_sizes": [8, 16, 32, 64], "depths": [1, 1, 1, 1], "layer_type": "basic"}
    backbone["out_features"] = ["stage2", "stage3", "stage4"]
    common = {"d_model": 32, "encoder_layers": 1, "decoder_layers": 2, "num_queries": 20, "id2label": NAMES}
    common |= {f"{part}_attention_heads": 2 for part in ("encoder", "decoder")}
    common |= {f"{part}_ffn_dim": 32 for part in ("encoder", "decoder")}
    if kind.startswith("rt_detr"):
        common |= {"backbone_config": transformers.RTDetrResNetConfig(**backbone), "encoder_hidden_dim": 32}
        common |= {"encoder_in_channels": [16, 32, 64], "decoder_in_channels": [32, 32, 32]}
    else:
        common |= {"backbone_config": transformers.ResNetConfig(**backbone), "use_timm_backbone": False}
    if kind == "deformable_detr":
        common |= {"two_stage": True, "with_box_refine": True, "two_stage_num_proposals": 20}
    if kind == "yolos":
        common = {"hidden_size": 32, "num_hidden_layers": 2, "num_attention_heads": 2, "intermediate_size": 32}
        common |= {"num_detection_tokens": 20, "image_size": (64, 96), "id2label": NAMES}
    prefix = FAMILIES[kind].prefix
    config = getattr(transformers, f"{prefix}Config")(**common)
    torch.manual_seed(4)
    model = getattr(transformers, f"{prefix}ForObjectDetection")(config).eval()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter += 0.1 * torch.randn_like(parameter)
    return model


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    made = {kind: tmp_path_factory.mktemp(kind) for kind in FAMILIES}
    for kind, folder in made.items():
        small_model(kind).save_pretrained(folder)
    return made


def read(folder: Path, size: int | None = None) -> TransformersDetector:
    return load(Resolved("x", "transformers", (folder,), None), size)


@pytest.fixture(scope="module")
def detectors(folders: dict[str, Path]) -> dict[str, TransformersDetector]:
    return {kind: read(folder, SIZE) for kind, folder in folders.items()}


Made = dict[str, TransformersDetector]


def processor(kind: str) -> Any:
    square = kind.startswith("rt_detr")
    size = {"height": SIZE, "width": SIZE} if square else {"shortest_edge": SIZE, "longest_edge": 160}
    return getattr(import_transformers(), PROCESSORS[kind])(size=size)


@pytest.mark.parametrize("kind", FAMILIES)
@pytest.mark.parametrize("shape", [(60, 90), (150, 70), (40, 200)])
def test_images_are_prepared_and_results_decoded_as_transformers_does(
    kind: str, shape: tuple[int, int], detectors: Made
) -> None:
    detector, images = detectors[kind], photographs(2, *shape)
    threshold = detector.dense(images).classes.amax(2).median().item() - 1e-4
    reference = processor(kind)
    prepared = reference(images=list(images), do_rescale=False, return_tensors="pt")
    assert (detector.scaling.fit(kind, images) - prepared["pixel_values"]).abs().max() < 1e-5
    with torch.no_grad():
        outputs = detector.network(**prepared)
    expected = reference.post_process_object_detection(outputs, threshold=threshold, target_sizes=[shape] * 2)
    limit = torch.tensor([shape[1], shape[0]] * 2)
    found = detector.detect(images, threshold)
    assert sum(len(one.scores) for one in found) > 4
    for ours, theirs in zip(found, expected, strict=True):
        order = theirs["scores"].argsort(descending=True, stable=True)
        assert torch.equal(ours.labels, theirs["labels"][order])
        assert (ours.scores - theirs["scores"][order]).abs().max() < 1e-5
        assert (ours.boxes - theirs["boxes"][order].clamp(min=0).minimum(limit)).abs().max() < 1e-3


@pytest.mark.parametrize("kind", FAMILIES)
def test_gradients_reach_the_image_after_a_detection(kind: str, detectors: Made) -> None:
    detector = detectors[kind]
    detector.detect(photographs(height=64))  # leaves tables of positions behind that dense must be able to use
    images = photographs(height=64).requires_grad_()
    found = detector.dense(images)
    assert found.boxes.shape == (2, 20, 4)
    assert found.classes.shape == (2, 20, 3)
    for value in (found.classes.amax((1, 2)).sum(), found.boxes.sum()):
        (gradient,) = torch.autograd.grad(value, images, retain_graph=True)
        assert torch.isfinite(gradient).all()
        assert (gradient.abs().sum((1, 2, 3)) > 0).all()
    assert all(parameter.grad is None for parameter in detector.network.parameters())


def test_the_gradient_is_the_derivative(detectors: Made) -> None:
    """Of DETR's: its descendants choose queries, and let no gradient through the places where they look first."""
    exact = TransformersDetector("exact", copy.deepcopy(detectors["detr"].network), size=SIZE)
    checked_gradient(exact, photographs(1).clamp(0.1, 0.9), boxes=0.0, step=1e-7, rtol=1e-3)


@pytest.mark.parametrize("shape", [(1, 3, 33, 301), (3, 3, 211, 37), (2, 3, 1, 1)])
def test_any_size_aspect_and_batch(shape: tuple[int, ...], detectors: Made) -> None:
    torch.manual_seed(3)
    images = torch.rand(shape)
    limit = torch.tensor([shape[3], shape[2]] * 2)
    for detector in detectors.values():
        found = detector.detect(images, 0.0)
        assert len(found) == shape[0]
        assert all((one.boxes >= 0).all() and (one.boxes <= limit).all() for one in found)
        assert [len(one.boxes) for one in detector.detect(images, 1.0)] == [0] * shape[0]


def test_images_without_a_pixel_left_are_refused(detectors: Made) -> None:
    for call in (detectors["detr"].detect, detectors["detr"].dense):
        with pytest.raises(RaucaError, match=r"x: .* too narrow"):
            call(torch.rand(1, 3, 1, 2000))


def test_a_model_in_memory_is_copied(detectors: Made) -> None:
    model = small_model("detr").train()
    detector = load_detector(model, SIZE, names=("n/a", "car", "motorcycle"))
    assert load_detector(model, SIZE).class_names == detector.class_names  # in COCO's words
    assert detector.fingerprint == load_detector(model, SIZE).fingerprint == detectors["detr"].fingerprint
    assert model.training
    before = detector.dense(photographs(1)).classes
    nn.init.zeros_(model.class_labels_classifier.weight)
    assert torch.equal(before, detector.dense(photographs(1)).classes)
    others = (load_detector(model, size).fingerprint for size in (SIZE, SIZE + 32))
    assert len({detector.fingerprint, *others}) == 3
    with pytest.raises(RaucaError, match="predicts 3 classes, 2 names"):
        load_detector(model, names=("car", "bus"))
    with pytest.raises(RaucaError, match="model type None is not supported"):
        TransformersDetector("line", nn.Linear(1, 1), ("car",))


@pytest.mark.parametrize("kind", FAMILIES)
def test_folders_with_labels_of_their_own(kind: str, folders: dict[str, Path], detectors: Made) -> None:
    """A folder is enough of a name; what its labels are called is the caller's to say."""
    detector = load_detector(folders[kind], SIZE, classes={"Car": "vehicle", "motorbike": "vehicle"})
    assert detector.class_names == ("n/a", "vehicle")
    images = photographs()
    (own, ours) = (one.dense(images).classes for one in (detectors[kind], detector))
    assert torch.equal(ours[..., 1], own[..., 1:].amax(-1))
    with pytest.raises(RaucaError, match="files name its classes; leave names out, or rename by classes"):
        load_detector(folders[kind], names=("a", "b", "c"))
    with pytest.raises(RaucaError, match="has no class 'van' to rename; its own are n/a, car, motorcycle"):
        load_detector(folders[kind], classes={"van": "car"})


def test_folders_that_do_not_fit_are_refused(folders: dict[str, Path], tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(folders["detr"], folder)
    weights, config = folder / "model.safetensors", folder / "config.json"
    good, described = load_file(weights), json.loads(config.read_text())
    key = "class_labels_classifier.weight"

    def refused(message: str, state: dict[str, Tensor] | None = None, **changed: Any) -> None:
        save_file(good if state is None else state, weights)
        config.write_text(json.dumps(described | changed))
        with pytest.raises(RaucaError, match=message) as error:
            read(folder)
        assert "\n" not in str(error.value)

    refused(f"safetensors: tensor {key} holds values that are not finite", good | {key: good[key] * float("nan")})
    refused(f"safetensors: lacks tensor {key}", {name: one for name, one in good.items() if name != key})
    refused(f"safetensors: has another shape of tensor {key}", good | {key: torch.zeros(92, 32)})
    refused("safetensors: has an unknown tensor extra", good | {"extra": torch.zeros(2)})
    refused(
        r"safetensors: (lacks|has an unknown) tensor .* and \d+ more",
        {f"{index}.{name}": one for index, (name, one) in enumerate(good.items())},
    )
    refused("config.json: model type 'owlvit' is not supported; known are detr", model_type="owlvit")
    refused("config.json: transformers cannot build this model", d_model="wide")
    refused(
        "config.json: backbone 'swin' is not supported", use_timm_backbone=True, backbone_config=None, backbone="swin"
    )
    config.write_text("{")
    with pytest.raises(RaucaError, match=r"config\.json: not valid JSON"):
        read(folder)
    config.write_text(json.dumps(described))
    weights.rename(folder / "pytorch_model.bin")
    with pytest.raises(RaucaError, match=r"only weights as \.safetensors are read"):
        read(folder)
    with pytest.raises(RaucaError, match=r"config\.json: not found"):
        read(tmp_path / "absent")
    with pytest.raises(RaucaError, match="multiple of 32"):
        read(folders["rt_detr"], 100)


def test_code_in_a_folder_is_never_run(folders: dict[str, Path], tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(folders["detr"], folder)
    (folder / "evil.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    described = json.loads((folder / "config.json").read_text())
    described["auto_map"] = {"AutoConfig": "evil.Config", "AutoModelForObjectDetection": "evil.Model"}
    (folder / "config.json").write_text(json.dumps(described))
    read(folder)
    assert not (tmp_path / "ran").exists()


def test_the_preprocessor_file_decides_over_the_usual(tmp_path: Path) -> None:
    path = tmp_path / "preprocessor_config.json"
    assert read_scaling(path, Scaling()) == Scaling()

    def read(**options: Any) -> Scaling:
        path.write_text(json.dumps(options))
        return read_scaling(path, Scaling())

    assert read(size=480, max_size=800) == Scaling(480, 800)
    assert read(size={"height": 320, "width": 640}, do_normalize=False) == Scaling(
        0, 0, 320, 640, (0.0,) * 3, (1.0,) * 3
    )
    assert read(image_mean=[0.5] * 3, image_std=[0.25] * 3, resample=3) == Scaling(
        mean=(0.5,) * 3, std=(0.25,) * 3, mode="bicubic"
    )
    for wrong in ({"size": {"longest_edge": 3}}, {"resample": 1}, {"do_resize": False}, {"size": {"height": "x"}}):
        with pytest.raises(RaucaError, match=r"preprocessor_config\.json"):
            read(**wrong)


@pytest.mark.parametrize(("name", "kind"), [("resnet18", "detr"), ("resnet50", "deformable_detr")])
def test_timms_resnet_is_transformers_resnet_under_other_names(name: str, kind: str) -> None:
    """torchvision's ResNet has timm's names and is the same network: it must compute the same features."""
    from rauca_core.detect.frameworks.torchvision_ops import import_torchvision

    transformers = import_transformers()
    config = translated_config({"model_type": kind, "backbone": name, "use_timm_backbone": True}, Path("config.json"))
    resnet = transformers.ResNetConfig(**config["backbone_config"])
    translated = transformers.ResNetBackbone(resnet).eval()
    original = getattr(import_torchvision().models, name)(weights=None).eval()
    prefix = "model.backbone.conv_encoder.model."
    state = {prefix + key: value for key, value in original.state_dict().items() if not re.match("fc", key)}
    renamed = {
        translated_name(key).removeprefix(prefix): value for key, value in (state | {"query": torch.ones(1)}).items()
    }
    assert renamed.pop("query").item() == 1
    translated.load_state_dict(renamed)
    images = photographs(1, 64, 64)
    expected = {}
    for stage in (2, 3, 4):
        getattr(original, f"layer{stage}").register_forward_hook(lambda *call, s=stage: expected.update({s: call[2]}))
    with torch.no_grad():
        original(images)
        features = translated(images).feature_maps
    stages = [int(one.removeprefix("stage")) for one in resnet.out_features]
    assert stages == ([2, 3, 4] if kind == "deformable_detr" else [4])
    for stage, feature in zip(stages, features, strict=True):
        assert (feature - expected[stage]).abs().max() < 1e-4 * expected[stage].abs().max()


def test_a_folder_that_names_timm_needs_none(folders: dict[str, Path], tmp_path: Path) -> None:
    """A DETR in the published form: timm's ResNet-18 and the tensor names of the time it was published."""
    from rauca_core.detect.frameworks.torchvision_ops import import_torchvision

    transformers = import_transformers()
    described = json.loads((folders["detr"] / "config.json").read_text())
    del described["backbone_config"]
    described |= {"use_timm_backbone": True, "backbone": "resnet18"}
    torch.manual_seed(5)
    model = transformers.DetrForObjectDetection(
        transformers.DetrConfig.from_dict(translated_config(described, Path("config.json")))
    )
    backbone = import_torchvision().models.resnet18(weights=None)
    state = {name: one for name, one in model.state_dict().items() if "backbone.model" not in name}
    old = {re.sub(r"\.o_proj\.", ".out_proj.", re.sub(r"mlp\.(fc\d)", r"\1", name)): one for name, one in state.items()}
    prefix = "model.backbone.conv_encoder.model."
    old |= {prefix + name: one for name, one in backbone.state_dict().items() if not name.startswith("fc")}
    save_file({name: one.contiguous() for name, one in old.items()}, tmp_path / "model.safetensors")
    (tmp_path / "config.json").write_text(json.dumps(described))
    loaded = read(tmp_path, SIZE).network
    name = "model.backbone.model.encoder.stages.3.layers.1.layer.1.convolution.weight"
    assert torch.equal(loaded.state_dict()[name], backbone.layer4[1].conv2.weight)
    assert all(torch.equal(loaded.state_dict()[name], one) for name, one in state.items())
