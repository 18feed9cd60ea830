"""What a bare machine lacks is installed where we may, and named where we may not."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from tools.system_libraries import PACKAGES, loads, missing_packages, provide


def test_what_the_linker_does_not_find_is_missing():
    assert loads("libc.so.6")
    assert not loads("libnowhere.so.9")
    assert missing_packages(lambda library: library != "libXi.so.6", has_venv=True) == ["libxi6"]
    venv = f"python3.{sys.version_info.minor}-venv"
    assert missing_packages(lambda library: False, has_venv=False) == [venv, *PACKAGES.values()]


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
