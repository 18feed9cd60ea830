"""Camouflages that learn beside the detector: which way they move, where they begin again, going on after a stop."""

from __future__ import annotations

from pathlib import Path

import torch

from benchmarks.stability.drawn import make_dataset
from rauca_core.attack import random_camouflage
from rauca_core.contract import Vehicle, load_vehicle
from rauca_core.contract.seeding import named_rng
from rauca_core.environment.frames import LightFrames
from rauca_core.render import TapSettings, linear_to_srgb
from rauca_core.render.composite import srgb_to_linear
from rauca_core.render.straight_through import straight_through
from rauca_core.runtime.images import read_image
from rauca_core.training.adversary import LIFE, Adversary
from rauca_core.training.camouflaged import CamouflagedSamples

SIZE, MAP, LR = 64, 64, 0.05


def known(count: int = 3) -> dict[str, list[torch.Tensor]]:
    generator = torch.Generator().manual_seed(1)
    return {"car": [torch.rand(20, 3, generator=generator) for _ in range(count)]}


def shade(adversary: Adversary, wanted: torch.Tensor, steps: range) -> None:
    """Steps whose loss grows towards a color."""
    for done in steps:
        texels = adversary.draw("car", named_rng("choice", done))
        (-(linear_to_srgb(texels) - wanted).square().sum()).backward()
        adversary.step(done + 1)


def distances(adversary: Adversary, wanted: torch.Tensor) -> list[float]:
    maps = [value for name, value in adversary.tensors().items() if name.endswith("texels")]
    return [float((one - wanted).abs().mean()) for one in maps]


def test_they_move_to_where_the_loss_grows_and_begin_again_by_turns() -> None:
    adversary, wanted = Adversary(known(), 2, LR, seed=3), torch.tensor([1.0, 0.0, 0.6])
    first = distances(adversary, wanted)
    shade(adversary, wanted, range(LIFE // 2 - 1))
    late = distances(adversary, wanted)
    assert all(now < 0.3 * then for now, then in zip(late, first, strict=True))
    shade(adversary, wanted, range(LIFE // 2 - 1, LIFE // 2))  # the second one's life ends here
    assert distances(adversary, wanted)[0] < 0.3 * first[0]
    assert distances(adversary, wanted)[1] > 0.5 * first[1]
    own = [value for name, value in adversary.tensors().items() if name.startswith("1.")]
    assert len(own) == 1  # nothing of Adam's memory is left
    assert min(float(one.amin()) for one in own) >= 0
    assert max(float(one.amax()) for one in own) <= 1


def test_it_goes_on_where_it_was() -> None:
    wanted = torch.tensor([0.0, 1.0, 0.2])
    whole, first, second = (Adversary(known(), 2, LR, seed=3) for _ in range(3))
    shade(whole, wanted, range(LIFE // 2 + 10))
    shade(first, wanted, range(LIFE // 2 + 3))
    second.restore({name: value.clone() for name, value in first.tensors().items()})
    shade(second, wanted, range(LIFE // 2 + 3, LIFE // 2 + 10))
    ends, again = whole.tensors(), second.tensors()
    assert ends.keys() == again.keys()
    assert all(torch.equal(ends[name], again[name]) for name in ends)


def test_what_pictures_say_reaches_the_texels(tmp_path: Path, box_vehicle: Vehicle) -> None:
    """Through four frames at once, mirrored and zoomed, contrast, blur and JPEG: brighter is brighter."""
    data, noise = make_dataset(tmp_path / "data", box_vehicle, SIZE, (40.0, 130.0)), tmp_path / "noise.json"
    random_camouflage(noise, load_vehicle(data.vehicle_folder, read_image), MAP, seed=3, cell=8)
    frames = LightFrames([data.folder])
    samples = CamouflagedSamples(frames, ("car",), SIZE, [noise], tmp_path / "taps", 0.99, TapSettings(MAP, 4))
    adversary = samples.adversary = Adversary(samples.known, 1, LR, seed=0)

    def seen(number: int) -> torch.Tensor:
        return samples.draw([0, 1, 2, 3] if number % 2 else [number % 4], named_rng("sight", number)).image

    first = [seen(number) for number in range(6)]
    assert all(one.amin() >= 0 and one.amax() <= 1 for one in first)
    wearing = [number for number, one in enumerate(first) if one.requires_grad]
    assert len(wearing) >= 3
    torch.stack(first).mean().backward()
    adversary.step(1)
    for number in wearing:
        assert float((seen(number) - first[number]).mean().detach()) > 0.001
    # a picture that shows none of them stays as it is
    assert all(torch.equal(seen(number), first[number]) for number in range(6) if number not in wearing)


def test_straight_through_is_the_changed_picture_to_the_bit() -> None:
    value, changed = torch.rand(2, 5, requires_grad=True), torch.rand(2, 5)
    through = straight_through(srgb_to_linear(value), changed)
    assert torch.equal(through, changed)
    (gradient,) = torch.autograd.grad(through.square().sum(), value)
    (wanted,) = torch.autograd.grad((2 * changed * srgb_to_linear(value)).sum(), value)
    torch.testing.assert_close(gradient, wanted)
