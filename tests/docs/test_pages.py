"""What the documentation says about the package is true: links, commands, keys, numbers, examples."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from PIL import Image
from support import ROOT
from support.pages import CONTROLLERS, DOCS, NEEDS_DOCS, tables_of
from typer.main import get_command

import tendonrepro
from tendonrepro.cli.app import app
from tendonrepro.configuration.any_kind import json_schema
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import (
    ExperimentName,
    LoadedConfig,
    load_config,
    shipped_folder,
    shipped_names,
)
from tendonrepro.configuration.models.control import Readings
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import all_loops, build_loops
from tendonrepro.experiments.user_law import laws_of
from tendonrepro.physics.linear_loop import decay_rate
from tendonrepro.physics.metrics import mae
from tendonrepro.results.traces import read_traces
from tendonrepro.simulation.stepper import simulate

PACKAGE = Path(tendonrepro.__file__).parent
pytestmark = NEEDS_DOCS

PAGES = sorted(DOCS.glob("*.md"))
TEXTS = {path: path.read_text(encoding="utf-8") for path in [*PAGES, ROOT / "README.md"] if path.exists()}
EXPERIMENTS: tuple[ExperimentName, ...] = ("compare", "decouple")
SHORT = ("reference.periods=1", "reference.period=2.5", "reference.blend=1.25")


def page(name: str) -> str:
    return TEXTS[DOCS / name]


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)


def example(name: str, line: str) -> str:
    """The one Python block of a page that has such a line."""
    (found,) = (block for block in blocks(page(name), "python") if line in block)
    return found


def prose(text: str) -> str:
    return re.sub(r"^ *```.*?^ *```", "", text, flags=re.S | re.M)


def inline(text: str) -> list[str]:
    return re.findall(r"`([^`\n]+)`", prose(text))


def rows(text: str) -> list[list[str]]:
    """Cells of every table row; a bar that is escaped belongs to its cell."""
    lines = [line for line in prose(text).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]


def section(text: str, heading: str) -> str:
    """Text from a heading up to the next of the same or a higher level."""
    start = text.index(f"\n{heading}\n") + 1
    level = heading.index(" ")
    end = re.search(rf"^#{{1,{level}}} ", text[start + len(heading) :], re.M)
    return text[start:] if end is None else text[start : start + len(heading) + end.start()]


@pytest.fixture(scope="module")
def shipped() -> dict[str, LoadedConfig]:
    return {name: load_config(None, name) for name in EXPERIMENTS}


def leads_somewhere(key: str, tree: Any) -> bool:
    for part in key.split("."):
        if not isinstance(tree, dict) or part not in tree:
            return False
        tree = tree[part]
    return True


# ---- every page --------------------------------------------------------------------------------------------


def slug(heading: str) -> str:
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return kept.replace(" ", "-")


def test_relative_links_resolve() -> None:
    for path, text in TEXTS.items():
        for target in re.findall(r"\]\(([^)\s]+)\)", prose(text)):
            if re.match(r"[a-z]+:", target):
                continue
            file, _, anchor = target.partition("#")
            place = (path.parent / file).resolve() if file else path
            assert place.exists(), f"{path.name} links to {target}"
            if anchor:
                headings = re.findall(r"^#+ (.*)$", place.read_text(encoding="utf-8"), re.M)
                assert anchor in map(slug, headings), f"{path.name} links to {target}"


def test_functions_and_files_named_in_the_text_exist() -> None:
    """``module.function()`` and ``folder/file.py`` of the package."""
    own = {"my_law.py", "integral.py"}
    for path, text in TEXTS.items():
        for token in inline(text):
            if found := re.fullmatch(r"([a-z_.]+)\.(\w+)\(\)", token):
                module = importlib.import_module(f"tendonrepro.{found[1]}")
                assert callable(getattr(module, found[2], None)), f"{path.name} names {token}"
            if re.fullmatch(r"[\w/]+\.py", token) and token not in own:
                assert (ROOT / token).exists() or [*PACKAGE.rglob(token)], f"{path.name} names {token}"


# ---- commands ----------------------------------------------------------------------------------------------


def commands() -> list[tuple[str, str]]:
    found = []
    for path, text in TEXTS.items():
        shown = "".join(blocks(text, "sh") + blocks(text, "console")).splitlines()
        quoted = [line.removeprefix("$ ") for line in shown] + inline(text)
        found += [(path.name, line) for line in quoted if re.match(r"tendonrepro\s+[-a-z]", line)]
    return sorted(set(found))


COMMANDS = commands()


def words(command: str) -> list[str]:
    """Arguments after the program's name, without comment and redirection."""
    parts = shlex.split(command, comments=True)[1:]
    return list(itertools.takewhile(lambda part: part not in {">", "<", "|", "|&", "&&"}, parts))


def parse(command: Any, parts: list[str], name: str = "tendonrepro") -> Any:
    """Let typer parse a command without running it."""
    if not hasattr(command, "commands") or parts[0].startswith("-"):
        return command.make_context(name, list(parts))
    assert parts[0] in command.commands, parts
    return parse(command.commands[parts[0]], parts[1:], parts[0])


def test_commands_parse() -> None:
    program = get_command(app)
    for _, command in COMMANDS:
        # --version and --cite print and leave while they are parsed.
        with contextlib.suppress(typer.Exit):
            parse(program, words(command))


MISTAKES = ("lamb=", "-0.45")  # shown on purpose
PLACEHOLDERS = ("KEY", "my_arm.yaml")


def test_settings_in_commands_are_valid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "trajectory.csv").write_text(blocks(page("configs.md"), "csv")[0], encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    program, seen = get_command(app), set()
    for name, command in COMMANDS:
        if "--set" not in command or any(word in command for word in PLACEHOLDERS):
            continue
        context = parse(program, words(command))
        wrong = any(word in command for word in MISTAKES)
        assert name == "cli.md" or not wrong, command
        overrides = tuple(context.params["set"])
        kind = context.info_name if context.info_name in {"ensemble", "identify", "decouple"} else "compare"
        # Files of the page's own are not there.
        source = context.params.get("config") if context.params.get("config") in shipped_names() else None
        if (kind, source, overrides) in seen:
            continue
        seen.add((kind, source, overrides))
        with pytest.raises(TendonreproError) if wrong else contextlib.nullcontext():
            _ = (
                load_ensemble(None, overrides=overrides)
                if kind in {"ensemble", "identify"}
                else load_config(source, kind, overrides=overrides)
            )


def test_options_named_in_messages_exist() -> None:
    """A way out that is none would be worse than silence."""
    held: Any = [get_command(app)]
    for command in held:
        held.extend(getattr(command, "commands", {}).values())
    known = {
        option
        for command in held
        for parameter in command.params
        for option in (*parameter.opts, *parameter.secondary_opts)
    } | {"--porcelain", "--error-unmatch", "--help"}
    for path in PACKAGE.rglob("*.py"):
        named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", path.read_text(encoding="utf-8")))
        assert named <= known, path.name


# ---- configurations ----------------------------------------------------------------------------------------


def test_configuration_keys_in_the_text_exist(shipped: dict[str, LoadedConfig]) -> None:
    trees = [*(loaded.tree for loaded in shipped.values()), load_config("plain", None).tree]
    tops = {key for tree in trees for key in tree}
    for name, token in ((path.name, token) for path in PAGES for token in inline(TEXTS[path])):
        key = re.split(r"[:=]", token)[0]
        if re.fullmatch(r"\w+(\.\w+)+", key) and key.split(".")[0] in tops and not token.endswith("()"):
            # An option that the shipped files leave out.
            key = key.replace("tendons.unilateral", "tendons")
            of_a_base = {"manipulator.base", "manipulator.joints"}
            if key.endswith((".py", ".csv")) or key in {"control.Surface", "control.Law"} | of_a_base:
                continue
            assert any(leads_somewhere(key, tree) for tree in trees), (
                f"{name} names {token}, which no configuration in configs/ has"
            )


def test_slips_names_the_switch_of_every_reading() -> None:
    text = page("slips.md")
    missing = [name for name in Readings.model_fields if f"control.readings.{name}" not in text]
    assert not missing, "docs/slips.md says where the paper can be read so: add an entry with its switch"


def examples(key: str) -> list[str]:
    return [block for block in blocks(page("configs.md"), "yaml") if block.startswith(f"{key}:")]


@pytest.mark.parametrize("key", ["reference", "disturbance"])
def test_examples_load_and_build(key: str, tmp_path: Path) -> None:
    shipped_text = (shipped_folder() / "compare.yaml").read_text(encoding="utf-8")
    (tmp_path / "trajectory.csv").write_text(blocks(page("configs.md"), "csv")[0], encoding="utf-8")
    kinds = []
    for example in examples(key):
        path = tmp_path / "compare.yaml"
        text = re.sub(rf"^{key}:.*?(?=^\S)", f"{example}\n", shipped_text, flags=re.S | re.M)
        path.write_text(text, encoding="utf-8")
        loaded = load_config(path, "compare")
        loop = dict(build_loops(loaded.config, loaded.folder))["controller_1"]
        assert np.isfinite(loop.reference.q_d).all()
        assert np.abs(loop.reference.q_d).max() > 0
        kinds.append(getattr(loaded.config, key).kind)
    field = json_schema("compare")["properties"][key]
    without = field["discriminator"]["mapping"].keys() - {*kinds}
    assert not without, f"docs/configs.md has no example of {key} of kind {without}"
    assert len(kinds) == len({*kinds})


# ---- numbers -----------------------------------------------------------------------------------------------


def decay_rates(factor: str) -> dict[str, float]:
    loaded = load_config("plain", "compare", overrides=[f"manipulator.tendons.damping_factor={factor}"])
    found = {}
    for name, loop in build_loops(loaded.config, loaded.folder):
        stroke = loop.reference.q_d.max(axis=0)
        postures = [share * stroke for share in (0.0, 0.5, 1.0)]
        found[name] = decay_rate(postures, loop.plant, loop.controller.law, loop.actuator.delay)
    return found


def test_decay_rates_and_the_rule_for_the_damping_factor() -> None:
    head, _, *body = rows(section(page("assumptions.md"), "## The damping factor"))
    rates = {factor: decay_rates(factor) for factor in ("1", "1.25", "1.5", "2", "2.5", "3", "4", "5")}
    for factor, *cells in body:
        assert list(rates[factor]) == head[1:]
        assert [f"{rate:.2f}" for rate in rates[factor].values()] == cells, factor
    assert len(body) >= 5
    first = next(factor for factor, decays in rates.items() if min(decays.values()) >= 1.0)
    assert load_config("plain", "compare").config.manipulator.tendons.damping_factor.value == float(first)


def settings() -> list[tuple[str, list[str]]]:
    table = rows(section(page("slips.md"), "## What each interpretation does")) if DOCS.is_dir() else []
    return [(name.strip("`"), cells) for name, *cells in table if name[0] == "`" or name == "plain arm"]


@pytest.mark.slow
@pytest.mark.parametrize(("setting", "cells"), settings(), ids=[name for name, _ in settings()])
def test_what_each_reading_does(setting: str, cells: list[str]) -> None:
    data = tables_of("plain", *[setting] * (setting != "plain arm"))
    found = []
    for name in CONTROLLERS:
        status, sizes = data["status"][name], data["table2"][name]["mae_deg"]
        found.append(f"{sizes[0]:.3f} / {sizes[1]:.3f}" if status == "ok" else status)
    # A run near its bound of stability magnifies rounding, so the last digit is left free.
    for text, number in zip(cells, found, strict=True):
        if "/" in text and "/" in number:
            ours, ours_now = (np.array(x.split(" / "), dtype=float) for x in (text, number))
            np.testing.assert_allclose(ours_now, ours, atol=0.0015)
        else:
            assert text == number or (text == "ok" and "/" in number)


# ---- examples that run -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short comparison with the first law of the page beside Controller 1, as the page runs it."""
    folder = tmp_path_factory.mktemp("docs")
    law = folder / "my_law.py"
    law.write_text(example("python.md", "def steep"), encoding="utf-8")
    out = folder / "reports" / "compare"
    found = tendonrepro.compare(set=SHORT, controllers=[1], laws=[f"{law}:steep"], out=out).data
    assert list(found["table2"]) == ["controller_1", "steep"]
    assert found["status"]["steep"] == "ok"
    return out


def test_law_in_a_file(results: Path) -> None:
    runs = read_traces(results / "traces.h5").runs
    assert runs["steep"].attributes["law"] == "user law steep"
    # A steeper surface and a shorter effective delay: the page's law must beat Controller 1.
    assert (mae(runs["steep"]["e"]) < mae(runs["controller_1"]["e"])).all()
    assert (results / "tables" / "table2.csv").read_text(encoding="utf-8").count("\nsteep,") == 2


def test_law_with_memory_of_its_own(tmp_path: Path) -> None:
    """s holds the integral: without it the surface is Controller 3's, of the recorded error."""
    path = tmp_path / "law.py"
    path.write_text(example("python.md", "class Integral"), encoding="utf-8")
    loaded = load_config(None, "compare", overrides=SHORT, controllers=[3])
    loop = all_loops(loaded, laws_of([f"{path}:integral"]))["integral"]
    run = simulate(loop)
    e, L = run["e"], loop.L
    de = run["dq_d"] - np.diff(run["q_encoder"], axis=0, prepend=0.0) / L
    np.testing.assert_allclose(run["s"], de + 2.0 * e + 2.0 * L * np.cumsum(e, axis=0), atol=1e-9)


def test_law_with_two_gains_is_plain_time_delay_control_beside_any_run(tmp_path: Path) -> None:
    """Beside Controller 1, whose estimator is another, it does what the configuration's law ``tdc`` does."""
    path = tmp_path / "law.py"
    path.write_text(example("python.md", "def two_gains"), encoding="utf-8")
    plain = "runs.tdc={law: tdc, payload: {value: 0, unit: kg, source: 'assumed: none'}}"
    loops = all_loops(load_config(None, "compare", overrides=[*SHORT, plain]), laws_of([f"{path}:two_gains"]))
    first, own, tdc = (simulate(loops[run]) for run in ("controller_1", "two_gains", "tdc"))
    np.testing.assert_allclose(own["e"], tdc["e"], rtol=0, atol=1e-9)
    assert np.abs(own["H_hat"] - first["H_hat"]).max() > 0.01


@pytest.mark.parametrize(("library", "words"), [("xarray", "N m"), ("h5py", "rad")])
def test_ways_to_open_traces(
    library: str,
    words: str,
    results: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(results.parent.parent)
    scope: dict[str, Any] = {}
    exec(example("results.md", f"import {library}"), scope)
    assert words in capsys.readouterr().out
    if "tree" in scope:
        scope["tree"].close()


def test_the_film_is_of_the_shipped_configuration() -> None:
    with Image.open(DOCS / "motion.gif") as film:
        stamp = film.info["comment"].decode()
    assert load_config(None, "decouple").sha256[:8] in stamp
