"""A category is found under whichever name a detector's list uses."""

from __future__ import annotations

from pathlib import Path

import pytest

from rauca_core.contract import RaucaError
from rauca_core.detect import DarknetDetector, canonical, class_index, class_list, find_class
from rauca_core.detect.catalogue import SOURCES
from rauca_core.detect.classes import GAP, unusual_names
from rauca_core.detect.synth.card import read_card
from rauca_core.detect.weights import shipped_path

DARKNET = ("aeroplane", "motorbike", "diningtable", "sofa", "pottedplant", "tvmonitor")
COCO = ("airplane", "motorcycle", "dining table", "couch", "potted plant", "tv")


def test_every_list_has_its_length() -> None:
    eighty, ninety, twenty = (class_list(name) for name in ("coco-80", "coco-91", "voc-20"))
    assert (len(eighty), len(ninety), len(twenty)) == (80, 90, 20)
    assert tuple(name for name in ninety if name != GAP) == eighty
    assert set(twenty) <= set(eighty)
    assert len(set(eighty)) == 80


def test_published_numbers() -> None:
    """COCO's annotation files: 1 person, 3 car, 9 boat, 13 stop sign, 44 bottle, 72 tv, 90 toothbrush."""
    ninety = class_list("coco-91")
    numbers = {1: "person", 3: "car", 9: "boat", 13: "stop sign", 44: "bottle", 72: "tv", 90: "toothbrush"}
    assert {number: ninety[number - 1] for number in numbers} == numbers


def test_fingerprints_of_named_networks_are_those_of_before() -> None:
    """Results lie under them: lists that are always the same are left out."""
    for name in ("frcnn-synth", "detr-synth"):
        assert unusual_names(read_card(shipped_path(SOURCES[name]).with_suffix(".json"))[0].class_names) == ""
    eighty = class_list("coco-80")
    assert unusual_names(eighty) == ""
    assert len({unusual_names(names) for names in (eighty[::-1], ("car",), ("car", "van"), ("car van",))}) == 4


@pytest.mark.parametrize(("theirs", "ours"), list(zip(DARKNET, COCO, strict=True)))
def test_both_spellings_find_the_same(theirs: str, ours: str) -> None:
    assert canonical(theirs) == canonical(ours) == ours
    for name in ("coco-80", "coco-91", "voc-20"):
        names = class_list(name)
        assert find_class(names, theirs) == find_class(names, ours) == names.index(ours)
    assert find_class(DARKNET, ours) == DARKNET.index(theirs)


def test_spelling_does_not_matter() -> None:
    assert canonical(" Traffic_Light ") == "traffic light"
    assert find_class(("Car", "Boat"), "car") == 0


def test_gaps_are_no_category() -> None:
    assert find_class(class_list("coco-91"), GAP) is None


def test_a_list_without_the_class(detector: DarknetDetector) -> None:
    assert class_index(detector, "car") == 1
    with pytest.raises(RaucaError, match=r"every: knows no class 'truck' \(its 2 are boat, car.*choose a detector"):
        class_index(detector, "truck")


def test_unreadable_lists(tmp_path: Path) -> None:
    from rauca_core.detect.classes import read_names

    path = tmp_path / "a.names"
    with pytest.raises(RaucaError, match="not found"):
        read_names(path)
    path.write_text("\n \n")
    with pytest.raises(RaucaError, match="holds no class names"):
        read_names(path)
    path.write_bytes(b"\xff\xfe\x00car")
    with pytest.raises(RaucaError, match="cannot be read as text"):
        read_names(path)
