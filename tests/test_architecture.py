"""Imports go one way, and each heavy dependency stays behind its own modules."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import tendonrepro

PACKAGE = Path(tendonrepro.__file__).parent

# Rooms from bottom to top. A module may import from rooms below, and from its own what stands before it.
ROOMS = [
    ("errors", "arrays"),
    ("files", "samples"),
    # the paper: pure functions
    ("matrices", "kinematics", "metrics", "friction", "encoder", "disturbance", "trajectory", "servo"),
    ("elementary", "arm", "drive", "actuator", "control"),
    ("dynamics", "streaming"),
    ("unroll",),
    ("lane_loop", "lanes"),
    ("compiled", "stability", "slow_error", "margins", "stability_map"),
    ("controllers",),
    ("resolution", "simulate"),
    ("kernel",),
    ("bundle",),
    ("batch",),
    # what users write and what the paper printed
    ("strict_yaml",),
    ("config_model",),
    ("quantity",),
    ("physical",),
    ("config_control", "config_manipulator", "config_reference"),
    ("config_experiment",),
    ("readings",),
    ("config_box",),
    ("config_errors",),
    ("config_overrides", "shipped"),
    ("config_draft",),
    ("config", "published"),
    ("config_ensemble", "config_kinds", "drawn"),
    ("box",),
    # configuration to physics
    ("rig",),
    ("runs", "user_law"),
    ("explanation", "explain"),
    # results
    ("records",),
    ("traces", "summary", "plant_record", "manifest", "typeset", "talk", "parallel"),
    ("comparison", "results", "screen", "citation"),
    # the paper's data set: from the repository to disk
    ("dataset.names", "dataset.zenodo", "dataset.headers", "dataset.web_errors", "dataset.web"),
    ("dataset.download", "dataset.data_lock"),
    ("dataset.by_hand", "dataset.resolve", "dataset.fetch_text"),
    ("dataset.fetch",),
    # from files of any format to signals
    ("dataset.unreadable", "dataset.signals", "dataset.units", "dataset.stamps", "dataset.charset"),
    ("dataset.matlab_parts", "dataset.matlab_values"),
    ("dataset.bounds", "dataset.filetype", "dataset.heading"),
    ("dataset.matlab_elements", "dataset.matlab_hdf", "dataset.matlab_plain", "dataset.matlab_objects"),
    ("dataset.matlab_tree", "dataset.matlab_figure", "dataset.matlab_stream", "dataset.matlab"),
    ("dataset.archive", "dataset.arrays_file", "dataset.cells"),
    ("dataset.hdf5_file", "dataset.text_style", "dataset.workbook"),
    ("dataset.text_table",),
    ("dataset.readers",),
    ("dataset.guard",),
    # from signals to measured runs
    ("dataset.words", "dataset.evidence", "dataset.timebase"),
    ("dataset.columns", "dataset.mapping", "dataset.recorded_error"),
    ("dataset.long_form", "dataset.clock", "dataset.angle_units"),
    ("dataset.panels", "dataset.joints", "dataset.coupled"),
    ("dataset.meaning", "dataset.assignment", "dataset.mapping_text", "dataset.remarks"),
    ("dataset.suggestion", "dataset.assembly"),
    ("tables", "figure_style"),
    ("figure_files", "figure_panels"),
    ("figure_compare", "figure_decouple"),
    ("figures", "experiment", "doctor"),
    ("workflow",),
    # beyond the paper's own runs
    ("explain_text", "figure_explain"),
    ("explain_files",),
    ("sweep_points", "sweep_table", "sweep_words", "figure_sweep_map"),
    ("figure_sweep",),
    ("sweep",),
    ("shards",),
    ("ensemble_data", "ensemble_plan"),
    ("ensemble_shares", "ensemble_block", "ensemble_folder"),
    ("ensemble_table", "ensemble_run", "figure_ensemble"),
    ("ensemble_words",),
    ("ensemble",),
    ("arithmetic", "sensitivity"),
    ("dataset.measured_file",),
    ("dataset.inspection", "dataset.ingest"),
    # measured runs: tables, reference, statistics
    ("dataset.printed_tables", "measured_statistics"),
    ("dataset.reference_record",),
    (
        "dataset.reference_onset",
        "dataset.reference_signal",
        "dataset.reference_turns",
        "dataset.reference_shapes",
    ),
    ("dataset.reference_fit", "dataset.reference_knots", "dataset.reference_motion"),
    ("dataset.reference_config",),
    ("verdicts",),
    ("claim_plants", "claim_rules"),
    ("claim_statements",),
    ("claim_ensemble",),
    ("claim_angles", "claim_measured"),
    ("claims",),
    ("claim_report", "figure_claims", "figure_laws"),
    ("ledger",),
    ("dataset.residuals", "dataset.row_files", "figure_overlay"),
    ("dataset.validate_tables", "dataset.validate_text", "dataset.rerun"),
    ("dataset.reruns",),
    ("dataset.validate",),
    ("identify_misfit", "identify_state", "identify_judge"),
    ("identify_search", "identify_report", "figure_identify"),
    ("identify_task",),
    ("identify",),
    ("cli_options",),
    ("cli_study", "cli_data"),
    ("cli",),
    ("__main__",),
]
PHYSICS = {name for room in ROOMS[2:6] for name in room}

OWNERS = {
    "numba": {"compiled"},
    "llvmlite": {"compiled"},
    "platformdirs": {"compiled"},
    "scipy": {
        "box",
        "dataset.matlab",
        "dataset.reference_fit",
        "dataset.reference_knots",
        "ensemble_shares",
        "simulate",
        "stability",
        "trajectory",
    },
    "h5py": {
        "traces",
        "shards",
        "dataset.hdf5_file",
        "dataset.matlab_hdf",
        "dataset.matlab_plain",
        "dataset.matlab_stream",
    },
    "pandas": {"tables", "dataset.text_table"},
    "matio": {"dataset.matlab_objects"},
    "python_calamine": {"dataset.workbook"},
    "charset_normalizer": {"dataset.charset"},
    "yaml": {"strict_yaml"},
    "filelock": {"results"},
    "typer": {"cli", "cli_data", "cli_options", "cli_study"},
    "requests": {"dataset.web", "dataset.web_errors"},
    "pooch": {"dataset.download"},
    "SALib": {"sensitivity"},
    "joblib": {"ensemble_run"},
    "distributed": {"ensemble_run"},
    "rich": {"talk"},
}
PREFIX_OWNERS = {
    "matplotlib": "figure",
    "pydantic": ("config", "quantity", "physical", "dataset.mapping"),
}


def modules() -> list[str]:
    """Names below the package: ``arm``, ``dataset.web``."""
    paths = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py") if path.stem != "__init__"]
    return sorted(".".join(path.with_suffix("").parts) for path in paths)


def tree_of(module: str) -> ast.Module:
    return ast.parse(PACKAGE.joinpath(*module.split(".")).with_suffix(".py").read_text(encoding="utf-8"))


def imported(module: str) -> Iterator[str]:
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
            assert node.module is not None
            if node.module in {"tendonrepro", "tendonrepro.dataset"}:
                yield from (f"{node.module}.{name.name}" for name in node.names)
            else:
                yield node.module


def own(module: str) -> set[str]:
    """Modules of the package that a module imports."""
    names = {name.partition(".")[2] for name in imported(module) if name.startswith("tendonrepro.")}
    return names - {"__version__"}


def test_every_module_has_a_room() -> None:
    assert modules() == sorted(name for room in ROOMS for name in room)


@pytest.mark.parametrize("module", modules())
def test_imports_go_down(module: str) -> None:
    floor = {name: level for level, room in enumerate(ROOMS) for name in room}
    upwards = {
        name
        for name in own(module)
        if floor[name] > floor[module]
        or (floor[name] == floor[module] and not _stands_before(name, module, ROOMS[floor[module]]))
    }
    assert not upwards


def _stands_before(name: str, module: str, room: tuple[str, ...]) -> bool:
    return room.index(name) < room.index(module)


@pytest.mark.parametrize("module", modules())
def test_heavy_dependencies_stay_behind_their_owners(module: str) -> None:
    used = {name.split(".")[0] for name in imported(module)}
    for library, owners in OWNERS.items():
        assert library not in used or module in owners, f"{module} imports {library}"
    for library, prefix in PREFIX_OWNERS.items():
        assert library not in used or module.startswith(prefix), f"{module} imports {library}"


@pytest.mark.parametrize("module", sorted(PHYSICS))
def test_physics_is_pure(module: str) -> None:
    """No file, clock, print, randomness of its own or global state."""
    tree = tree_of(module)
    calls = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    assert not calls & {"open", "print", "time.time", "np.random.default_rng", "np.random.seed"}
    assert not any(isinstance(node, ast.Global) for node in ast.walk(tree))


@pytest.mark.parametrize("module", modules())
def test_functions_fit_a_screen(module: str) -> None:
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.FunctionDef):
            doc = ast.get_docstring(node, clean=False) or ""
            assert node.end_lineno is not None
            lines = node.end_lineno - node.lineno + 1 - len(doc.splitlines())
            assert lines <= 60, f"{module}.{node.name} has {lines} lines"
