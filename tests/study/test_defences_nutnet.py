"""NutNet: what it learnt is spared, what it never met is masked, and it says what it needs."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from typer.testing import CliRunner

from benchmarks.defences import ready_defences
from pipelines.cli import app
from rauca_core.contract import RaucaError
from rauca_core.contract.files import png_bytes
from rauca_core.study.defences import KINDS, make_defence, nutnet
from tests.study.test_defences_informed import picture

PATCH = (slice(None), slice(None), slice(32, 64), slice(24, 56))  # whole blocks of the picture's square of texture


def test_a_patch_is_masked_and_plain_pictures_are_spared(nutnet_learnt: Path) -> None:
    plain = picture(seed=11)
    plain[PATCH] = 0.5
    patched = plain.clone()
    patched[PATCH] = torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    defence = make_defence("nutnet")
    masked = (defence(patched) == 0).all(1)[0]
    assert masked[32:64, 24:56].float().mean() > 0.95
    masked[32:64, 24:56] = False
    assert masked.float().mean() < 0.05
    assert ((defence(plain) == 0).all(1)).float().mean() < 0.05
    assert (make_defence("nutnet:spared=20")(plain) == 0).float().mean() > 0.2


def test_the_smooth_mask_is_near_its_own(nutnet_learnt: Path) -> None:
    images, defence = picture(), make_defence("nutnet")
    assert (defence.stand_in(images) - defence(images)).abs().mean() < 0.3 * images.mean()
    blocks = images.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(defence.stand_in(blocks).square().sum(), blocks)
    straight = 2 * defence(images).square() / images.clamp(min=1e-6)
    assert not torch.allclose(gradient, straight, atol=1e-3)  # the choice of blocks has a slope, too


def test_the_command_teaches_it_and_without_it_the_error_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(nutnet, "weights_folder", lambda: tmp_path / "weights")
    monkeypatch.setattr(nutnet, "STEPS", 3)
    assert set(KINDS) - set(ready_defences()) == {"nutnet"}
    with pytest.raises(RaucaError, match=r"nutnet: has learnt nothing yet; run `rauca weights nutnet DATASET`"):
        make_defence("nutnet")
    (tmp_path / "frame.png").write_bytes(png_bytes((picture()[0].permute(1, 2, 0) * 255).byte().numpy()))
    said = CliRunner().invoke(app, ["weights", "nutnet", str(tmp_path)])
    assert said.exit_code == 0, said.output
    assert "learnt from 1 pictures" in said.output
    first = make_defence("nutnet").fingerprint
    nutnet.train([picture(seed=1)[0]])
    assert make_defence("nutnet").fingerprint != first
