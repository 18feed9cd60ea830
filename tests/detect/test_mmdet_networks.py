"""Networks of MMDetection's own configurations, small and seeded, against its own ``test_step`` and their differences.

``make test`` installs MMDetection without its compiled operators into a folder that only these tests read; a stand-in
takes the operators' place. Where MMDetection is installed whole, that is tested.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.contract import RaucaError
from rauca_core.detect import DensePredictions, load_detector
from rauca_core.detect.frameworks.mmdet_config import read_config
from rauca_core.detect.frameworks.mmdet_detector import PLAIN, MmdetDetector, import_registry
from rauca_core.detect.synth.framework_student import FrameworkStudent
from rauca_core.detect.synth.network import Truth
from rauca_core.training.hardenable import named_as, origin_of
from tests.detect.gradients import checked_gradient

# MMDetection's releases and torch's tell each other what is deprecated, ninety times.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore:torch.meshgrid")
PACKAGES = Path(sys.prefix) / "mmdetection"  # the Makefile fills it
NAMES = ("vehicle.car", "vehicle.bus")
SMALL = {
    "model.backbone.depth": 18,
    "model.backbone.norm_eval": False,
    "model.neck.in_channels": [64, 128, 256, 512],
}
TWO_STAGES = SMALL | {"model.roi_head.bbox_head.num_classes": 2, "model.roi_head.bbox_head.fc_out_channels": 32}
CHANGES: dict[str, dict[str, Any]] = {
    "retinanet/retinanet_r50_fpn_1x_coco": SMALL | {"model.bbox_head.num_classes": 2},
    "faster_rcnn/faster-rcnn_r50_fpn_1x_coco": TWO_STAGES,
    "dynamic_rcnn/dynamic-rcnn_r50_fpn_1x_coco": TWO_STAGES,
    "sparse_rcnn/sparse-rcnn_r50_fpn_1x_coco": SMALL
    | {"model.roi_head.num_stages": 2, "model.roi_head.stage_loss_weights": [1, 1], "model.rpn_head.num_proposals": 20,
       "model.test_cfg.rcnn.max_per_img": 20},
    "deformable_detr/deformable-detr_r50_16xb2-50e_coco": {
        "model.backbone.depth": 18, "model.neck.in_channels": [128, 256, 512], "model.bbox_head.num_classes": 2,
        "model.num_queries": 20, "model.test_cfg.max_per_img": 20, "model.encoder.num_layers": 1,
        "model.decoder.num_layers": 2,
    },
    "yolox/yolox_tiny_8xb8-300e_coco": {
        "model.backbone.widen_factor": 0.125, "model.neck.in_channels": [32, 64, 128], "model.neck.out_channels": 32,
        "model.bbox_head.in_channels": 32, "model.bbox_head.feat_channels": 32, "model.bbox_head.num_classes": 2,
    },
}  # fmt: skip
KINDS = tuple(CHANGES)
RETINANET, FASTER, DYNAMIC, SPARSE, DEFORMABLE, YOLOX = KINDS


@pytest.fixture(scope="module", autouse=True)
def mmdetection() -> Iterator[None]:
    """MMDetection can be imported in this module, and in no other."""
    if importlib.util.find_spec("mmdet"):
        yield
        return
    if not PACKAGES.is_dir():
        pytest.skip("MMDetection is missing; `make test` installs it")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path, str(PACKAGES)])
        patch.setitem(sys.modules, "mmcv._ext", importlib.import_module("tests.detect.mmcv_operators"))
        yield
    for name in [name for name in sys.modules if name.partition(".")[0] in ("mmdet", "mmengine", "mmcv")]:
        del sys.modules[name]


def described(kind: str) -> Any:
    """One of MMDetection's configurations, for small pictures of two classes."""
    config = importlib.import_module("mmengine").Config
    package = Path(importlib.import_module("mmdet").__file__ or "").parent
    found = config.fromfile(package / ".mim" / "configs" / f"{kind}.py")
    found.merge_from_dict(CHANGES[kind])
    if kind == SPARSE:
        for part in ("bbox_head", "train_cfg"):
            holder = found.model.roi_head if part == "bbox_head" else found.model
            value = holder[part] if part == "bbox_head" else holder[part].rcnn
            del value[2:]
        for head in found.model.roi_head.bbox_head:
            head.num_classes = 2
    data = found.test_dataloader.dataset
    data.metainfo = {"classes": NAMES}
    for step in data.pipeline:
        if step.type == "Resize":
            step.scale = (128, 128) if kind == YOLOX else (160, 96)
    return found


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of a kind: a configuration as MMDetection writes it, and seeded weights."""
    made: dict[str, Path] = {}

    def make(kind: str) -> Path:
        if kind not in made:
            made[kind] = tmp_path_factory.mktemp("networks") / kind.partition("/")[0]
            made[kind].mkdir()
            described(kind).dump(made[kind] / "config.py")
            config = importlib.import_module("mmengine.config").ConfigDict(read_config(made[kind] / "config.py").model)
            with torch.random.fork_rng(devices=[]):  # biases are drawn as it is built, else by what ran before
                torch.manual_seed(0)
                model = import_registry().build(config)
            torch.save({"meta": {"epoch": 12}, "state_dict": seeded(model).state_dict()}, made[kind] / "epoch_12.pth")
        return made[kind]

    return make


def seeded(model: Any) -> Any:
    """Weights that keep activations moderate and let scores differ."""
    draw = torch.Generator().manual_seed(0)
    for name, one in model.named_parameters():
        if "init_proposal_bboxes" in name:  # centers and sizes, which compiled operators want positive
            one.data.uniform_(0.3, 0.8, generator=draw)
        elif one.dim() > 1:
            gain = 3.0 if "cls" in name and not name.startswith("bbox_head.cls_convs") else 1.0  # four in a row
            one.data.normal_(0, gain / one[0].numel() ** 0.5, generator=draw)
    return model


@pytest.fixture
def images(picture: Callable[[int, int], NDArray[np.float32]]) -> Tensor:
    one = torch.from_numpy(picture(60, 90)).permute(2, 0, 1)
    return torch.stack([one, one.flip(2)]).contiguous()


def said_by_mmdetection(detector: MmdetDetector, config: Any, images: Tensor) -> list[Any]:
    """``test_step`` on the pixels that the adapter scales to, through the rest of MMDetection's own pipeline."""
    compose = importlib.import_module("mmcv.transforms").Compose
    steps = [step for step in config.test_dataloader.dataset.pipeline if step.type in ("Pad", "PackDetInputs")]
    height, width = detector._preparation.size_of(*images.shape[2:])
    factors = width / images.shape[3], height / images.shape[2]
    scaled = 255 * torch.nn.functional.interpolate(images, (height, width), mode="bilinear").flip(1)
    data: dict[str, list[Any]] = {"inputs": [], "data_samples": []}
    for image in scaled:
        packed = compose(steps)(
            {
                "img": image.permute(1, 2, 0).numpy().copy(), "img_id": 0, "img_path": "", "img_shape": (height, width),
                "ori_shape": tuple(images.shape[2:]), "scale_factor": factors,
            }
        )  # fmt: skip
        data["inputs"].append(packed["inputs"])
        data["data_samples"].append(packed["data_samples"])
    with torch.no_grad():
        return [sample.pred_instances for sample in detector.network.test_step(data)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_folder_of_mmdetections_detects_what_its_own_test_step_does(
    kind: str, folder_of: Callable[[str], Path], images: Tensor
) -> None:
    folder = folder_of(kind)
    detector = load_detector(folder)
    assert isinstance(detector, MmdetDetector)
    assert (detector.name, detector.class_names) == (folder.name, NAMES)  # those of the configuration
    config = described(kind)
    limits = config.model.test_cfg.get("rcnn", config.model.test_cfg)
    scores, overlap = limits.get("score_thr", 0.0), limits.get("nms", {}).get("iou_threshold", 1.0)
    found = detector.detect(images, scores, overlap)
    limit = torch.tensor([90.0, 60.0, 90.0, 60.0])
    for ours, theirs in zip(found, said_by_mmdetection(detector, config, images), strict=True):
        order = theirs.scores.argsort(descending=True, stable=True)
        assert len(ours.scores) == len(order) >= 5
        torch.testing.assert_close(ours.scores, theirs.scores[order], rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(ours.boxes, theirs.bboxes[order].clamp(min=0).minimum(limit), rtol=1e-4, atol=1e-2)
        assert torch.equal(ours.labels, theirs.labels[order])


@pytest.mark.parametrize("kind", KINDS)
def test_it_learns_by_its_own_losses_and_is_written_as_it_was_read(
    kind: str, folder_of: Callable[[str], Path], images: Tensor, tmp_path: Path
) -> None:
    given = shutil.copytree(folder_of(kind), tmp_path / "given")
    (given / "mine.names").write_text("car\nbus\n")
    held = torch.load(given / "epoch_12.pth", weights_only=True)
    held["meta"]["dataset_meta"] = {"classes": ("car", "bus")}  # before what the configuration says
    torch.save(held, given / "epoch_12.pth")
    origin = origin_of(str(given))
    student, card = origin.network()
    assert isinstance(student, FrameworkStudent)
    truths = [
        Truth(torch.tensor([[20.0, 25.0, 60.0, 45.0]]), torch.tensor([0])),
        Truth(torch.zeros(0, 4), torch.zeros(0).long()),
    ]
    adam = torch.optim.Adam(student.train().parameters(), 2e-5)  # all else is random: matches jump
    seen = []
    for _ in range(3):
        with torch.random.fork_rng():
            torch.manual_seed(0)
            loss = torch.stack(list(student.losses(images, truths, images).values())).sum()
        adam.zero_grad()
        loss.backward()
        adam.step()
        seen.append(float(loss.detach()))
    assert seen[-1] < seen[0] or kind == DYNAMIC  # whose losses grow with what it learns
    target = tmp_path / f"hardened-{card.name}"
    origin.save(target, student.eval(), card)
    written = load_detector(named_as(str(given), target))
    assert (written.name, written.class_names) == ("hardened-given", ("car", "bus"))
    assert {path.name for path in target.iterdir()} == {path.name for path in given.iterdir()}
    found, meant = written.dense(images), student.dense(images)
    torch.testing.assert_close(found.classes.amax(-1), meant.classes.amax(-1))
    before, after = held["state_dict"], torch.load(target / "epoch_12.pth", weights_only=True)["state_dict"]
    assert before.keys() == after.keys()
    assert all(torch.equal(before[name], after[name]) for name in before if "running_" in name)
    model = registered(target / "config.py")  # what MMDetection itself makes of the folder
    unmatched = model.load_state_dict(after)
    assert not unmatched.missing_keys + unmatched.unexpected_keys


def registered(config: Path) -> Any:
    return import_registry().build(importlib.import_module("mmengine").Config.fromfile(config).model)


def test_a_model_without_settings_of_training_is_refused_with_the_way_out(
    folder_of: Callable[[str], Path], tmp_path: Path
) -> None:
    folder = shutil.copytree(folder_of(FASTER), tmp_path / "bare")
    config = described(FASTER)
    config.test_dataloader.dataset.metainfo = {"classes": ("car", "bus")}
    config.model.train_cfg = None
    config.dump(folder / "config.py")
    with pytest.raises(
        RaucaError, match=r"bare: cannot be trained; its own losses fail .*rauca dataset export"
    ) as told:
        origin_of(str(folder))
    assert "\n" not in str(told.value)


def slope_of(detector: Any, images: Tensor, of: Callable[[DensePredictions], Tensor]) -> Tensor:
    images = images.detach().requires_grad_()
    return torch.autograd.grad(of(detector.dense(images)), images)[0]


@pytest.mark.parametrize("kind", KINDS)
def test_scores_and_boxes_have_gradients_whatever_the_layout_of_the_images_in_memory(
    kind: str, folder_of: Callable[[str], Path], images: Tensor
) -> None:
    detector = load_detector(folder_of(kind))
    seen: list[bool] = []
    detector.network.backbone.register_forward_pre_hook(lambda _, given: seen.append(given[0].is_contiguous()))
    last = images.contiguous(memory_format=torch.channels_last)
    permuted = images.permute(2, 3, 1, 0).contiguous().permute(3, 2, 0, 1)  # as an attack's pictures come
    for of in (lambda said: (said.objectness[..., None] * said.classes).sum(), lambda said: said.boxes.sum()):
        expected = slope_of(detector, images, of)
        assert (expected.abs().sum((1, 2, 3)) > 0).all()
        for other in (last, permuted):
            found = slope_of(detector, other, of)
            assert torch.cosine_similarity(found.flatten(), expected.flatten(), dim=0) > 0.999
    assert all(seen)


@pytest.mark.parametrize(
    "kind", [RETINANET, DEFORMABLE, YOLOX]
)  # regions of two stages take none; Deformable DETR has kinks
def test_the_gradient_is_the_derivative(kind: str, folder_of: Callable[[str], Path], images: Tensor) -> None:
    assert checked_gradient(load_detector(folder_of(kind)), images[:1], rtol=1e-2).abs().sum() > 0


def test_a_trainings_own_checkpoint_is_refused_with_the_command_that_makes_it_plain(
    folder_of: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = folder_of(RETINANET)
    held = torch.load(folder / "epoch_12.pth", weights_only=True)
    held["meta"] |= {"dataset_meta": {"classes": ("lorry", "ship")}}
    held["message_hub"] = {"loss": importlib.import_module("mmengine.logging").HistoryBuffer()}
    torch.save(held, tmp_path / "CHECKPOINT")
    (tmp_path / "mine").mkdir()
    shutil.copy(folder / "config.py", tmp_path / "mine")
    with pytest.raises(RaucaError, match=re.escape(PLAIN)):
        MmdetDetector("mine", folder / "config.py", tmp_path / "CHECKPOINT")
    monkeypatch.chdir(tmp_path)
    exec(PLAIN.split('"')[1], {})
    shutil.move("PLAIN.pth", "mine")
    assert load_detector("mine").class_names == ("lorry", "ship")  # the checkpoint's before the configuration's
