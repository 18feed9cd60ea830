"""Every command line in README and docs is one that the real programs take: command, options, values."""

from __future__ import annotations

import itertools
import re
import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from PIL import Image

from pipelines.cli import app
from pipelines.dataset_options import dataset_parser, slurm_parser
from pipelines.evaluate import split_defences
from pipelines.naturalness import natural_settings
from pipelines.optimize import chosen_settings
from pipelines.options import split_names
from rauca_core.attack import make_settings
from rauca_core.contract import find_preset
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.color import find_colors
from rauca_core.contract.plan import FINISHES
from rauca_core.dataset_tools import FORMATS
from rauca_core.detect import SOURCES
from rauca_core.study.ablations.catalogue import experiment_named
from rauca_core.study.assessment import Condition
from rauca_core.study.defences import make_defence
from rauca_core.study.views import weather_sets

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PROGRAMS = ("rauca", "make", "python", "torchrun", "blender")
OBJECTS_IN_BLENDER = ("rauca ...", "rauca lamp")  # names of things in a scene, not commands
# Programs of pipelines/ that stand for a rauca command.
SCRIPTS = {"make_dataset": ["dataset", "make"]}
ROOT_COMMAND: Any = typer.main.get_command(app)


@dataclass(frozen=True)
class Line:
    """A command line as a page has it; ``whole`` when it could be typed, not only mentioned."""

    page: str
    words: tuple[str, ...]
    whole: bool

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.words)}"


def lines_of(page: Path) -> Iterator[Line]:
    """Command lines in code blocks, which are whole, and in code spans, which may be mentions."""
    text, prose, fenced = page.read_text(), [], False
    for line in text.splitlines():
        fenced ^= line.lstrip().startswith("```")
        if fenced or line.startswith("    "):
            yield from _read(page, re.split(r"\s{3,}", line.strip())[0], whole=True)
        else:
            prose.append(line)
    for span in re.findall(r"`([^`]+)`", "\n".join(prose)):
        yield from _read(page, " ".join(span.split()), whole=False)


def _read(page: Path, text: str, whole: bool) -> Iterator[Line]:
    if text in OBJECTS_IN_BLENDER or not re.match(rf"({'|'.join(PROGRAMS)})( |$)", text):
        return
    text = text.replace("$SLURM_ARRAY_TASK_ID", "1")  # a number, in a file for sbatch
    words = shlex.split(re.sub(r"\[(--[^\]]*)\]", r"\1", text), comments=True)
    whole = whole and "..." not in words
    words = [re.sub(r",?\.\.\.$", "", word) for word in words if word != "..."]
    for choice in itertools.product(*(word.split("|") for word in words)):
        yield Line(page.name, choice, whole)


LINES = list(dict.fromkeys(line for page in PAGES for line in lines_of(page)))


def rauca_arguments(line: Line) -> list[str] | None:
    """What ``rauca`` is given; None for another program."""
    program, *words = line.words
    if program == "rauca":
        return words
    if "-m" in words and words[words.index("-m") + 1 :][:1] == ["pipelines"]:
        return words[words.index("-m") + 2 :]
    script = next((word for word in words if word.startswith("pipelines/")), None)
    if script is None or (name := Path(script).stem) not in SCRIPTS:
        return None
    rest = words[words.index(script) + 1 :]
    return [*SCRIPTS[name], *(rest[1:] if rest[:1] == ["--"] else rest)]


RAUCA = [(line, arguments) for line in LINES if (arguments := rauca_arguments(line)) is not None]


def test_pages_have_commands() -> None:
    assert len(RAUCA) > 100
    assert {line.page for line in LINES} >= {"README.md", "quick-start.md", "optimizer.md", "evaluation.md"}


@pytest.mark.parametrize(("line", "arguments"), RAUCA, ids=[str(line) for line, _ in RAUCA])
def test_rauca_takes_it(line: Line, arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    noise = np.random.default_rng(0).integers(0, 256, (16, 16, 3), np.uint8)
    Image.fromarray(noise).save("forest.jpg")  # the pages' photograph
    command, context, path, rest = ROOT_COMMAND, None, "", list(arguments)
    while rest and not rest[0].startswith("-") and hasattr(command, "commands"):
        assert rest[0] in command.commands, f"no command `rauca {path}{rest[0]}`"
        command, path, rest = command.commands[rest[0]], f"{path}{rest[0]} ", rest[1:]
    if hasattr(command, "commands"):
        assert not line.whole or rest == ["--help"] or not path, f"`rauca {path}` wants a command"
        return
    if rest == ["--help"]:
        return
    if path == "dataset make ":
        values = _parsed_by_argparse(rest, line.whole)
    else:
        context = _parsed_by_typer(command, path.strip(), rest, line.whole)
        values = context.params
    _check_values(path.strip(), context, {k: v for k, v in values.items() if v is not None})


def _parsed_by_typer(command: Any, name: str, arguments: list[str], whole: bool) -> Any:
    """The command's context; a mention may leave out what is required, and gets a stand-in for it."""
    for _ in range(6):
        try:
            return command.make_context(name, list(arguments))
        except Exception as error:
            parameter = getattr(error, "param", None)
            if whole or type(error).__name__ != "MissingParameter" or parameter is None:
                raise
            stand_in = ["yolov3-tiny"] if parameter.name in ("detector", "name") else ["X"]
            options = [option for option in parameter.opts if option.startswith("--")]
            arguments = [*arguments, *options[:1], *stand_in]
    raise AssertionError(f"rauca {name}: needs more than six things")


def _parsed_by_argparse(arguments: list[str], whole: bool) -> dict[str, Any]:
    if not whole:
        arguments += [] if "--out" in arguments else ["--out", "X"]
    cluster, others = slurm_parser().parse_known_args(arguments)
    return {**vars(dataset_parser().parse_args(others)), **vars(cluster)}


def _is_open(value: str) -> bool:
    """A page's stand-in like FILE, or a file of the reader's."""
    return value.isupper() or Path(value).suffix != ""


def _check_detectors(names: str) -> None:
    for name in names.split(","):
        known = name == "all" or name.endswith("/") or name.partition("=")[0] in SOURCES  # a folder is the reader's own
        assert known or _is_open(name), f"no detector {name!r}"


def _check_preset(name: str) -> None:
    if not _is_open(name):
        find_preset(name)


def _check_vehicle(name: str) -> None:
    shipped = {folder.name for folder in (assets_folder() / "vehicles").iterdir() if folder.is_dir()}
    assert name in shipped or _is_open(name) or "/" in name, f"no vehicle {name!r}"


def _check_sets(names: list[str]) -> None:
    weather_sets(split_names(names))


def _each(check: Callable[[str], Any]) -> Callable[[Any], None]:
    def every(values: Any) -> None:
        for value in [values] if isinstance(values, str) else values:
            check(str(value))

    return every


def _check_defence(name: str) -> None:
    if name != "nutnet":  # it is made once it has learnt
        make_defence(name)


CHECKS: Mapping[tuple[str, str], Callable[[Any], Any]] = {
    ("dataset make", "weathers"): _check_preset,
    ("dataset make", "finish"): lambda name: FINISHES.index(name),
    ("dataset make", "vehicle"): _check_vehicle,
    ("dataset export", "form"): lambda name: name == "X" or FORMATS.index(name),
    ("dataset recolor", "colors"): find_colors,
    ("demo", "vehicle"): _check_vehicle,
    ("bench vehicle", "vehicle"): _check_vehicle,
    ("bench render", "vehicle"): _check_vehicle,
    ("assess", "detectors"): _each(_check_detectors),
    ("assess", "fail_below"): lambda given: [Condition.parse(one) for one in given],
    ("assess", "vehicle"): _each(_check_vehicle),
    ("assess", "defences"): lambda given: [_check_defence(name) for name in split_defences(given)],
    ("optimize", "detector"): _each(_check_detectors),
    ("evaluate", "detectors"): _each(_check_detectors),
    ("evaluate", "weathers"): _check_sets,
    ("evaluate", "defences"): lambda given: [_check_defence(name) for name in split_defences(given)],
    ("evaluate", "vehicle"): _each(_check_vehicle),
    ("ablate", "name"): lambda name: experiment_named("beta" if name == "yolov3-tiny" else name),
    ("harden", "detector"): _check_detectors,
    ("detectors train", "name"): _check_detectors,
    ("weights fetch", "names"): _each(_check_detectors),
    ("efe preview", "reference"): find_colors,
}


def _check_values(command: str, context: Any, values: Mapping[str, Any]) -> None:
    """Values that a name stands for are looked up by the code that will look them up."""
    for name, value in values.items():
        if check := CHECKS.get((command, name)):
            check(value)
    if command == "optimize":
        make_settings(**{**chosen_settings(context), **natural_settings(context)})


def test_make_has_the_targets() -> None:
    targets = {word for line in LINES if line.words[0] == "make" for word in line.words[1:]}
    assert targets >= {"demo", "test"}
    known = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert targets <= set(known)


def test_programs_and_modules_are_there() -> None:
    words = {word for line in LINES if line.words[0] != "rauca" for word in line.words}
    assert not [word for word in words if word.endswith(".py") and not (ROOT / word).is_file()]
    modules = {line.words[2] for line in LINES if line.words[:2] == ("python", "-m")}
    assert not [m for m in modules if not (ROOT / f"{m.replace('.', '/')}.py").is_file()]


def _leaves(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    if not hasattr(command, "commands"):
        yield path, command
    for name, below in getattr(command, "commands", {}).items():
        yield from _leaves(below, (*path, name))


def known_options() -> set[str]:
    """Of all commands, and of the programs that they are given to."""
    options = {o for _, c in _leaves(ROOT_COMMAND) for p in c.params for o in (*p.opts, *p.secondary_opts)}
    for parser in (dataset_parser(), slurm_parser()):
        options |= {option for action in parser._actions for option in action.option_strings}
    return options | {"--help"}


def test_options_named_alone_exist() -> None:
    known = known_options()
    for page in PAGES:
        for span in re.findall(r"`(--[a-z][^`]*)`", page.read_text()):
            for option in re.findall(r"--[a-z][\w-]*", span):
                assert option in known, f"{page.name}: {option}"


@pytest.mark.parametrize("path", [path for path, _ in _leaves(ROOT_COMMAND)], ids=" ".join)
def test_help(path: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        ROOT_COMMAND.main([*path, "--help"], prog_name="rauca")
    said = capsys.readouterr().out
    assert stop.value.code == 0
    assert "--help" in said
    assert path[-1] in said
