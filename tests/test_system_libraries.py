"""What a bare machine lacks is installed where we may, and named where we may not."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tools.system_libraries import PACKAGES, loads, missing_packages, provide, trusts_someone


def test_what_the_linker_does_not_find_is_missing():
    assert loads("libc.so.6")
    assert not loads("libnowhere.so.9")
    assert missing_packages(lambda library: library != "libXi.so.6", True, lambda: True) == ["libxi6"]
    venv = f"python3.{sys.version_info.minor}-venv"
    everything = [venv, "ca-certificates", *PACKAGES.values()]
    assert missing_packages(lambda library: False, False, lambda: False) == everything


def test_a_machine_without_certificates_trusts_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "none.pem"))
    monkeypatch.setenv("SSL_CERT_DIR", str(tmp_path))
    assert not trusts_someone()
    (tmp_path / "authority.pem").touch()
    assert trusts_someone()
    monkeypatch.setenv("SSL_CERT_DIR", str(tmp_path / "no folder"))
    assert not trusts_someone()
    monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "authority.pem"))
    assert trusts_someone()


def test_who_may_install_gets_them_and_everybody_else_the_line_to_run(capsys):
    ran: list[Sequence[str]] = []
    assert provide([], may_install=False, run=lambda command: ran.append(command) or 0) == 0
    assert provide(["libxi6", "libgl1"], may_install=True, run=lambda command: ran.append(command) or 0) == 0
    assert ran == [["apt-get", "update", "-qq"], ["apt-get", "install", "--yes", "-qq", "libxi6", "libgl1"]]
    assert "installing libxi6 libgl1" in capsys.readouterr().out
    assert provide(["libxi6"], may_install=False, run=lambda command: ran.append(command) or 0) == 1
    assert len(ran) == 2
    assert "sudo apt-get install --yes libxi6" in capsys.readouterr().err


def test_an_installation_that_fails_is_no_success(capsys):
    assert provide(["libxi6"], may_install=True, run=lambda command: 100) == 1
    assert "`apt-get update -qq` failed" in capsys.readouterr().err
