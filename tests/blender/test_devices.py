"""Which device Cycles renders on, with preferences that pretend to have GPUs."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from blender_addon import devices
from rauca_core.contract import RaucaError


class Preferences:
    """Cycles' own, with an NVIDIA card that CUDA and OptiX both drive."""

    def __init__(self, *backends: str) -> None:
        self.compute_device_type = "NONE"
        cpu = SimpleNamespace(name="A CPU", type="CPU", use=True)
        self._entries = {b: [SimpleNamespace(name="A GPU", type=b, use=False), cpu] for b in backends}

    def get_devices_for_type(self, backend: str) -> list[SimpleNamespace]:
        return self._entries.get(backend, [])


@pytest.fixture
def pretend(monkeypatch):
    def have(*backends: str) -> Preferences:
        found = Preferences(*backends)
        monkeypatch.setattr(devices, "_preferences", lambda: found)
        return found

    return have


def test_the_best_backend_is_used_with_its_gpus_alone(pretend):
    preferences = pretend("CUDA", "OPTIX")
    scene = SimpleNamespace(cycles=SimpleNamespace(device="CPU"))
    assert [gpu.backend for gpu in devices.gpus()] == ["OPTIX", "CUDA"]
    assert devices.find("auto").described == devices.find("gpu").described == "OPTIX: A GPU"
    devices.use(scene, "gpu")
    assert (scene.cycles.device, preferences.compute_device_type) == ("GPU", "OPTIX")
    assert [(entry.type, entry.use) for entry in preferences.get_devices_for_type("OPTIX")] == [
        ("OPTIX", True), ("CPU", False),
    ]  # fmt: skip
    devices.use(scene, "cpu")
    assert scene.cycles.device == "CPU"


def test_without_a_gpu_it_is_refused_or_the_cpu(pretend):
    pretend()
    assert devices.find("auto").described == devices.find("cpu").described == "cpu"
    with pytest.raises(RaucaError, match=r"--render-device gpu: Blender .* sees no GPU .*--render-device cpu"):
        devices.find("gpu")
