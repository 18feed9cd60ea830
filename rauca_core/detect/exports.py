"""Files of detectors that are not read, or not fit for an attack, and the commands that make others of them."""

from __future__ import annotations

from pathlib import Path

from ..contract import RaucaError

YOLOX_EXPORT = "python tools/export_onnx.py -n yolox-s -c best_ckpt.pth --output-name mine.onnx"
DETR_EXPORT = "optimum-cli export onnx --task object-detection --model FOLDER OUT"
RTDETR_EXPORT = "pip install 'ultralytics<8.4' && yolo export model=best.pt format=onnx"  # later ones end to end
_PICKLE = "a pickle may run a program and is never opened"
_DEPLOYED = "is made for another runtime and has no gradients"

# Of each suffix: what such a file is, and what to do; {yolo} is Ultralytics' command for this very file.
_REFUSED = {
    ".pt": (_PICKLE, "{yolo}, and give {stem}.onnx"),
    ".pth": (
        _PICKLE,
        f"for YOLOX: {YOLOX_EXPORT}; torchvision's networks: faster-rcnn={{path}}; MMDetection's: its FOLDER",
    ),
    ".ckpt": (_PICKLE, "load it in the program that trained it and give its .onnx, of torch.onnx.export"),
    ".pkl": (_PICKLE, "load it in the program that trained it and give its .onnx, of torch.onnx.export"),
    ".engine": (_DEPLOYED, "go back to the .pt it came from: {yolo_best}"),
    ".tflite": (_DEPLOYED, "go back to what it came from; for Ultralytics: {yolo_best}"),
    ".mlpackage": (_DEPLOYED, "go back to what it came from; for Ultralytics: {yolo_best}"),
    ".xml": (_DEPLOYED, "go back to what OpenVINO's model came from; for Ultralytics: {yolo_best}"),
    ".pt2": (
        "torch's reader of these runs programs that they hold, so rauca does not call it",
        "if you trust it: load_detector(torch.export.load('{path}'), size, names=[...]) in Python",
    ),
    ".h5": ("Keras is not read", "python -m tf2onnx.convert --keras {path} --output {stem}.onnx"),
    ".keras": ("Keras is not read", "python -m tf2onnx.convert --keras {path} --output {stem}.onnx"),
}
_REFUSED |= {".pickle": _REFUSED[".pkl"], ".bin": _REFUSED[".ckpt"], ".trt": _REFUSED[".engine"]}
_REFUSED |= {".plan": _REFUSED[".engine"], ".mlmodel": _REFUSED[".mlpackage"]}


def yolo_export(model: Path | str) -> str:
    """Ultralytics' command for an ONNX file that can be attacked: every prediction is in its output.

    Its ``nms=False`` alone was that too, and by 8.4.150 is the very opposite.
    """
    return f"`yolo export model={Path(model).with_suffix('.pt')} format=onnx end2end=False`"


def refuse_unread(path: Path) -> None:
    """Raise for a file that no adapter reads, with the command that makes one of it; nothing in it is looked at.

    Raises:
        RaucaError: the file's suffix is one of those; names the file.
    """
    suffix = path.suffix.lower()
    if suffix not in _REFUSED:
        return
    if not path.exists():
        raise RaucaError(f"{path}: not found")
    reason, remedy = _REFUSED[suffix]
    stem = path.with_suffix("")
    told = remedy.format(path=path, stem=stem, yolo=yolo_export(path), yolo_best=yolo_export("best.pt"))
    raise RaucaError(f"{path}: not read, as {reason}; {told}" if reason == _PICKLE else f"{path}: {reason}; {told}")
