"""Imports go down from room to room, and each heavy library stays in the rooms that own it."""

from __future__ import annotations

import ast
import io
import tokenize
from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatchcase
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import tendonrepro

PACKAGE = Path(tendonrepro.__file__).parent

# From bottom to top. A file may import the rooms on lower floors, and anything in its own room.
FLOORS = [
    {"errors", "arrays", "files", "parallel", "console"},
    {"physics"},
    {"simulation", "configuration"},
    {"results"},
    {"experiments", "dataset"},
    {"analysis", "monte_carlo"},
    {"evidence", "identification", "verdicts"},
    {"validation"},
    {"reporting"},
    {"api"},
    {"cli"},
    {"__main__"},
]
FLOOR = {room: level for level, rooms in enumerate(FLOORS) for room in rooms}

OWNERS = {
    "llvmlite": ["simulation/codegen/machine.py"],
    "platformdirs": ["simulation/codegen/cache.py"],
    "matplotlib": ["results/figures/*", "*/figure*.py", "api/result.py"],
    "pydantic": ["configuration/*", "dataset/mapping.py"],
    "yaml": ["configuration/fields/strict_yaml.py", "configuration/shipped.py"],
    "xarray": ["results/traces.py", "api/result.py"],
    "h5py": ["dataset/arrays.py", "dataset/matlab.py"],
    "pandas": [
        "dataset/runs.py",
        "dataset/tables.py",
        "dataset/matlab.py",
        "results/export.py",
        "api/result.py",
    ],
    "pyarrow": ["results/export.py"],
    "matio": ["dataset/matlab.py"],
    "requests": ["dataset/fetch.py"],
    "urllib3": ["dataset/fetch.py"],
    "filelock": ["results/store.py", "dataset/fetch.py"],
    "joblib": ["parallel.py", "dataset/read.py"],
    "distributed": ["monte_carlo/cluster.py"],
    "SALib": ["verdicts/sensitivity.py"],
    "cma": ["identification/search.py"],
    "rich": ["console.py"],
    "jinja2": ["reporting/page.py"],
    "markdown_it": ["reporting/page.py"],
    "typer": ["cli/*"],
}

BUDGETS = {
    "ground": 255,
    "physics": 893,
    "simulation": 1815,
    "configuration": 1_703,
    "results": 2_365,
    "experiments": 2_076,
    "analysis": 790,
    "evidence": 933,
    "monte_carlo": 1_330,
    "identification": 714,
    "dataset": 1806,
    "verdicts": 2_352,
    "validation": 625,
    "reporting": 636,
    "api": 347,
    "cli": 616,
}
"""Code lines that a package may have: no comment, docstring or blank. What one needs, another gives."""

FILES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))
INNER = [file for file in FILES if file != "__init__.py"]


def tree_of(file: str) -> ast.Module:
    return ast.parse((PACKAGE / file).read_text(encoding="utf-8"))


def imported(file: str) -> Iterator[str]:
    """Dotted names that a file imports, wherever in it; of our own, those of files."""
    for node in ast.walk(tree_of(file)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file} imports relatively"
            module = node.module or ""
            folder = PACKAGE.parent.joinpath(*module.split("."))
            for name in node.names:
                is_file = folder.joinpath(f"{name.name}.py").exists() or folder.joinpath(name.name).is_dir()
                yield f"{module}.{name.name}" if is_file else module


def file_of(module: str) -> str:
    path = PACKAGE.parent.joinpath(*module.split("."))
    found = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return found.relative_to(PACKAGE).as_posix()


def own(file: str) -> set[str]:
    """Files of the package that a file imports."""
    return {file_of(name) for name in imported(file) if name.split(".")[0] == "tendonrepro"} - {"__init__.py"}


def room_of(file: str) -> str:
    return file.split("/", maxsplit=1)[0].removesuffix(".py")


def test_every_room_has_a_floor() -> None:
    assert {room_of(file) for file in INNER} == set(FLOOR)


@pytest.mark.parametrize("file", INNER)
def test_imports_go_down(file: str) -> None:
    room = room_of(file)
    others = {name for name in own(file) if room_of(name) != room}
    assert not {name for name in others if FLOOR[room_of(name)] >= FLOOR[room] > 0}
    assert not {name for name in others if FLOOR[room_of(name)] > 0 == FLOOR[room]}


def test_no_files_import_each_other_in_a_circle() -> None:
    TopologicalSorter({file: own(file) for file in INNER}).prepare()


@pytest.mark.parametrize("file", INNER)
def test_heavy_libraries_stay_with_their_owners(file: str) -> None:
    used = {name.split(".")[0] for name in imported(file)}
    for library, owners in OWNERS.items():
        assert library not in used or any(fnmatchcase(file, owner) for owner in owners), library


@pytest.mark.parametrize("file", [file for file in INNER if room_of(file) == "physics"])
def test_physics_is_pure(file: str) -> None:
    """No file, clock, print, randomness of its own or global state."""
    tree = tree_of(file)
    calls = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    assert not calls & {"open", "print", "time.time", "np.random.default_rng", "np.random.seed"}
    assert not any(isinstance(node, ast.Global) for node in ast.walk(tree))


@pytest.mark.parametrize("file", INNER)
def test_functions_fit_a_screen(file: str) -> None:
    for node in ast.walk(tree_of(file)):
        if isinstance(node, ast.FunctionDef):
            doc = ast.get_docstring(node, clean=False) or ""
            assert node.end_lineno is not None
            lines = node.end_lineno - node.lineno + 1 - len(doc.splitlines())
            assert lines <= 60, f"{file}: {node.name} has {lines} lines"


def code_lines(path: Path) -> int:
    """Lines with code on them: neither docstring nor comment nor blank."""
    text = path.read_text(encoding="utf-8")
    documented: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            documented.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    layout = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in {*layout, tokenize.ENDMARKER}:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - documented)


def test_each_package_keeps_its_budget() -> None:
    sizes: Counter[str] = Counter()
    for file in FILES:
        sizes[room_of(file) if "/" in file else "ground"] += code_lines(PACKAGE / file)
    over = {name: (size, BUDGETS[name]) for name, size in sizes.items() if size > BUDGETS[name]}
    assert not over, f"package: (code lines, budget) {over}"


def test_the_house_is_small_enough_to_know() -> None:
    """Folder names say where things are; a reader keeps this many in mind."""
    assert len([path for path in PACKAGE.iterdir() if (path / "__init__.py").exists()]) <= 15
    assert len([*PACKAGE.glob("*.py")]) <= 8
