"""Imports go down from room to room, and each heavy library stays in the rooms that own it."""

from __future__ import annotations

import ast
from fnmatch import fnmatchcase
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import tendonrepro

PACKAGE = Path(tendonrepro.__file__).parent

# From bottom to top. A file may import the rooms on lower floors, and anything in its own room.
FLOORS = [
    {"errors", "arrays", "files", "parallel", "console"},
    {"physics"},
    {"simulation", "configuration"},
    {"results"},
    {"studies"},
    {"experiments", "dataset"},
    {"analysis", "monte_carlo"},
    {"evidence", "identification", "tuning", "verdicts"},
    {"validation"},
    {"reporting"},
    {"commands"},
    {"cli"},
    {"__main__"},
]
FLOOR = {room: level for level, rooms in enumerate(FLOORS) for room in rooms}

OWNERS = {
    "llvmlite": ["simulation/codegen/machine.py"],
    "matplotlib": ["results/figures/*", "*/figure*.py", "studies/result.py"],
    "pydantic": ["configuration/*", "dataset/mapping.py"],
    "yaml": ["configuration/strict_yaml.py"],
    "h5netcdf": ["results/traces.py"],
    "xarray": ["results/traces.py", "studies/result.py"],
    "h5py": ["dataset/nested.py"],
    "pandas": [
        "dataset/tables.py",
        "dataset/text.py",
        "dataset/read.py",
        "dataset/nested.py",
        "results/traces.py",
        "studies/result.py",
    ],
    "pyarrow": ["results/traces.py"],
    "matio": ["dataset/nested.py"],
    "nptdms": ["dataset/nested.py"],
    "requests": ["dataset/fetch.py"],
    "urllib3": ["dataset/fetch.py"],
    "filelock": ["files.py"],
    "loky": ["parallel.py"],
    "distributed": ["monte_carlo/ensemble.py"],
    "cma": ["monte_carlo/population.py"],
    "rich": ["console.py"],
    "jinja2": ["reporting/contents.py"],
    "markdown_it": ["reporting/page.py"],
    "typer": ["cli/*"],
}

FILES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))
INNER = [file for file in FILES if file != "__init__.py"]


@cache
def tree_of(file: str) -> ast.Module:
    return ast.parse((PACKAGE / file).read_text(encoding="utf-8"))


@cache
def imported(file: str) -> frozenset[str]:
    """Dotted names that a file imports, wherever in it; of our own, those of files."""
    found = set()
    for node in ast.walk(tree_of(file)):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file} imports relatively"
            module = node.module or ""
            folder = PACKAGE.parent.joinpath(*module.split("."))
            for name in node.names:
                is_file = folder.joinpath(f"{name.name}.py").exists() or folder.joinpath(name.name).is_dir()
                found.add(f"{module}.{name.name}" if is_file else module)
    return frozenset(found)


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


def test_imports_go_down() -> None:
    """Only rooms of the ground floor import each other."""
    pairs = [(file, other) for file in INNER for other in own(file) if room_of(file) != room_of(other)]
    assert not [pair for pair in pairs if FLOOR[room_of(pair[1])] >= max(FLOOR[room_of(pair[0])], 1)]


def test_no_files_import_each_other_in_a_circle() -> None:
    TopologicalSorter({file: own(file) for file in INNER}).prepare()


def test_heavy_libraries_stay_with_their_owners() -> None:
    used = {(name.split(".")[0], file) for file in INNER for name in imported(file)}
    heavy = [(library, file) for library, file in used if library in OWNERS]
    assert heavy
    assert not [pair for pair in heavy if not any(fnmatchcase(pair[1], owner) for owner in OWNERS[pair[0]])]


def test_physics_is_pure() -> None:
    """No file, clock, print, randomness of its own or global state."""
    nodes = [node for file in INNER if room_of(file) == "physics" for node in ast.walk(tree_of(file))]
    calls = {ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)}
    assert not calls & {"open", "print", "time.time", "np.random.default_rng", "np.random.seed"}
    assert not any(isinstance(node, ast.Global) for node in nodes)


def test_functions_fit_a_screen() -> None:
    for file in INNER:
        for node in ast.walk(tree_of(file)):
            if isinstance(node, ast.FunctionDef):
                doc = ast.get_docstring(node, clean=False) or ""
                assert node.end_lineno is not None
                lines = node.end_lineno - node.lineno + 1 - len(doc.splitlines())
                assert lines <= 60, f"{file}: {node.name} has {lines} lines"


# Stored results hold for this code of the physics to the letter. When they are made again, it goes from here.
UNTYPED = {"physics"}


def test_public_functions_say_what_they_take_and_give() -> None:
    """No ``Any`` in a signature; where a library has no better type, it has one name, such as `Look`."""
    for file in INNER:
        functions = [node for node in ast.walk(tree_of(file)) if isinstance(node, ast.FunctionDef)]
        for function in functions if room_of(file) not in UNTYPED else ():
            arguments = [node.annotation for node in ast.walk(function.args) if isinstance(node, ast.arg)]
            said = [kind for kind in (*arguments, function.returns) if kind is not None]
            names = {node.id for kind in said for node in ast.walk(kind) if isinstance(node, ast.Name)}
            assert function.name.startswith("_") or "Any" not in names, f"{file}: {function.name}"


FEW_LINES = 8
"""Of a function in which a reader sees at once what a word that fits anything stands for."""


def test_parameters_and_variables_are_called_by_what_they_are() -> None:
    """Not by words that fit anything."""
    for file in INNER:
        functions = [node for node in ast.walk(tree_of(file)) if isinstance(node, ast.FunctionDef)]
        for function in functions if room_of(file) not in UNTYPED else ():
            names = {node.arg for node in ast.walk(function.args) if isinstance(node, ast.arg)}
            assert function.end_lineno is not None
            if function.end_lineno - function.lineno > FEW_LINES:
                stored = (node for node in ast.walk(function) if isinstance(node, ast.Name))
                names |= {node.id for node in stored if isinstance(node.ctx, ast.Store)}
            assert not names & {"found", "held", "one"}, f"{file}: {function.name}"


def test_a_class_has_a_name_of_its_own() -> None:
    """One name stands for one thing, wherever a reader meets it."""
    rooms: dict[str, set[str]] = {}
    for file in INNER:
        for node in ast.walk(tree_of(file)):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                rooms.setdefault(node.name, set()).add(room_of(file))
    assert len(rooms) > 100
    assert {name: where for name, where in rooms.items() if len(where) > 1} == {}


def test_the_house_is_small_enough_to_know() -> None:
    """Folder names say where things are; a reader keeps this many in mind."""
    assert len([path for path in PACKAGE.iterdir() if (path / "__init__.py").exists()]) <= 16
    assert len([*PACKAGE.glob("*.py")]) <= 8


NAMED_TUPLES = {"_replace", "_fields", "_asdict"}
"""Public names of named tuples that begin with an underscore."""


def test_tests_enter_by_public_names() -> None:
    """What is worth a test of its own is worth a public name; a test of the inside holds it fast."""
    private = []
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tendonrepro"):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                names = [] if node.value.id in {"self", "cls", "os"} else [node.attr]
            elif isinstance(node, ast.Constant) and str(node.value).startswith("tendonrepro."):
                names = str(node.value).split(".")
            else:
                continue
            private += [
                f"{path.name}:{node.lineno} {name}"
                for name in names
                if name.startswith("_")
                and not name.startswith(("__", "_repr_", "_ipython_"))
                and name not in NAMED_TUPLES
            ]
    assert private == []
