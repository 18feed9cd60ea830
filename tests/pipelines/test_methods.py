"""`rauca optimize --method`: the method's settings, under what the user typed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import pipelines.optimize_camouflage as command
from pipelines.cli import app
from rauca_core.attack import OptimiserSettings, make_settings
from rauca_core.attack.methods import METHODS, settings_of
from rauca_core.attack.naturalness import Naturalness


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The settings that a command line ends up with."""

    def settings(*options: str) -> OptimiserSettings:
        seen = []
        monkeypatch.setattr(command, "optimize_camouflage", lambda *given: seen.append(given[2]) or Path("c.json"))
        result = CliRunner().invoke(app, ["optimize", "data", "--out", "x", *options], catch_exceptions=False)
        assert result.exit_code == 0
        return seen[0]

    return settings


def test_without_a_method_options_are_the_settings(chosen: Any) -> None:
    assert chosen("--weight", "2", "--no-roa") == make_settings(weights=(2.0,), roa=False)


@pytest.mark.parametrize("name", METHODS)
def test_a_method_replaces_defaults(chosen: Any, name: str) -> None:
    assert chosen("--method", name) == make_settings(**settings_of(name))


def test_typed_options_win(chosen: Any) -> None:
    found = chosen("--method", "fca", "--light", "exact", "--beta", "0.01", "--name", "fca lit", "--weight", "3")
    assert (found.light, found.beta, found.name, found.weights) == ("exact", 0.01, "fca lit", (3.0,))
    assert (found.method, found.paint, found.limit, found.samples) == ("fca", "facets", "tanh", 2)


def test_a_methods_patches_stay_unless_their_size_is_typed(chosen: Any) -> None:
    natural = Naturalness(palette=("#1b2a1b", "#4b5320"), feature_cm=5.0)
    typed = ("--method", "ours", "--palette", "#1b2a1b,#4b5320")
    assert chosen(*typed).natural == natural
    assert chosen(*typed, "--feature-size", "20").natural == natural.model_copy(update={"feature_cm": 20.0})
    assert chosen("--method", "fca", *typed[2:]).natural == natural.model_copy(update={"feature_cm": None})


def test_methods_and_their_assumptions_are_documented() -> None:
    page = (Path(__file__).parents[2] / "docs" / "methods.md").read_text()
    for method in METHODS.values():
        assert f"## {method.name}" in page
        assert method.source in page
        assert all(sentence in " ".join(page.split()) for sentence in method.assumed)
