"""The commands as functions: those that run something, then those around files; see docs/python.md."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

from tendonrepro.api.result import Result
from tendonrepro.configuration.load import Config, LoadedConfig, load_config
from tendonrepro.configuration.request import Request, formats_of
from tendonrepro.console import Talk
from tendonrepro.results.on_disk import read_result
from tendonrepro.results.store import make_manifest, read_manifest
from tendonrepro.results.study import Outcome
from tendonrepro.results.traces import TRACES, export_traces, read_traces

Changes: TypeAlias = Mapping[str, Any] | None
Formats: TypeAlias = str | Sequence[str] | None


def _yaml(value: Any) -> str:
    """A value as `--set` takes it; arrays are lists, and paths are text."""
    return json.dumps(value, default=lambda held: str(held) if isinstance(held, Path) else held.tolist())


def _overrides(changes: Changes) -> list[str]:
    return [f"{key}={_yaml(value)}" for key, value in (changes or {}).items()]


def _path(given: str | Path | None) -> Path | None:
    return None if given is None else Path(given)


def _request(given: dict[str, Any]) -> Request:
    """What many functions share, out of the arguments of one."""
    source = given.pop("config", None)
    return Request(
        None if source is None else str(source),
        _path(given.pop("out", None)),
        _overrides(given.pop("set", None)),
        given.pop("seed", None),
        given.pop("controllers", None),
        force=given.pop("force", False),
        formats=formats_of(given.pop("formats", None), figures=given.pop("figures", True)),
    )


def _written(command: str, run: Callable[..., dict[str, Any]], given: dict[str, Any]) -> Result:
    """Result of a command that writes its own folder."""
    found = run(request=_request(given), talk=Talk(), **given)
    text = found.pop("text")
    folder = Path(found["out"])
    return Result(command, Outcome(found, [text]), read_manifest(folder), _folder=folder)


def compare(
    config: str | Path | None = None,
    *,
    set: Changes = None,
    seed: int | None = None,
    controllers: Sequence[int] | None = None,
    laws: Mapping[str, Callable[..., Any]] | None = None,
) -> Result:
    """Run Controllers 1 to 3 and the payload run: Figures 13 to 16, Tables 2 and 3.

    Parameters
    ----------
    config : str or Path, optional
        A file, or a shipped name.
    set : mapping, optional
        New values by dotted key, such as ``{"control.gains.lam": 6}``.
    seed : int, optional
    controllers : sequence of int, optional
        Those to run.
    laws : mapping, optional
        Name -> function or object of your own; see docs/python.md.

    Raises
    ------
    TendonreproError
        As on the command line.
    """
    return _experiment(_request({**locals()}).load("compare"), laws)


def decouple(config: str | Path | None = None, *, set: Changes = None, seed: int | None = None) -> Result:
    """Run the decoupling experiment: Figures 6 and 9 to 12, Table 1. Parameters are as of `compare`."""
    return _experiment(_request({**locals()}).load("decouple"))


def reproduce(
    out: str | Path = "reports", *, formats: Formats = None, figures: bool = True, force: bool = False
) -> dict[str, Result]:
    """Run both experiments and the fitted plant into `out`, with `live.html`, and return results by name.

    `formats` and `figures` are as of `ensemble`. `force` overwrites other results, and files changed since.
    """
    from tendonrepro.experiments.command import paper_orders, run_experiments
    from tendonrepro.reporting.live.command import PAGE, check_target, page_beside

    page = Path(out) / PAGE
    check_target(page, force=force)
    request = Request(out=Path(out), force=force, formats=formats_of(formats, figures=figures))
    orders = paper_orders(None, request)
    found = run_experiments(orders, Talk())
    page_beside(page, orders, Talk())
    return {name: open(one["out"]) for name, one in found.items()}


def statics(config: str | Path | None = None, *, set: Changes = None, seed: int | None = None) -> Result:
    """Survey the tension of every tendon over the working half-plane. Parameters are as of `compare`."""
    loaded, started = _request({**locals()}).load("decouple"), time.perf_counter()
    from tendonrepro.experiments.statics import study_statics

    return _studied("statics", loaded, study_statics(loaded), started)


def explain(config: str | Path | None = None, *, set: Changes = None, seed: int | None = None) -> Result:
    """Give stability margins and error ratios of the sampled loop. Parameters are as of `compare`."""
    loaded, started = _request({**locals()}).load("compare"), time.perf_counter()
    from tendonrepro.analysis.command import study_explain

    return _studied("explain", loaded, study_explain(loaded), started)


def sweep(
    over: Mapping[str, Sequence[Any]],
    config: str | Path | None = None,
    *,
    set: Changes = None,
    seed: int | None = None,
    controllers: Sequence[int] | None = None,
) -> Result:
    """Run the comparison over values of one or two keys.

    `over` has them by dotted key: ``{"sampling_period": [0.5, 1, 2]}``. The others are as of `compare`.
    """
    request, started = _request({**locals()}), time.perf_counter()
    from tendonrepro.experiments.sweep import load_sweep, study_sweep

    keys = [f"{key}={','.join(map(_yaml, values))}" for key, values in over.items()]
    ready = load_sweep(request, keys)
    return _studied("sweep", ready.base, study_sweep(ready, keys, Talk()), started)


def recover(log: str | Path) -> Result:
    """Tell which controller made a log: a trace file, or results folder.

    Raises
    ------
    UsageError
        When no run of it has torque, desired and measured angles.
    """
    from tendonrepro.evidence.recover import study_recover

    started = time.perf_counter()
    return _studied("recover", load_config(None, "compare"), study_recover(Path(log), Talk()), started)


def ensemble(
    draws: int = 1024,
    *,
    config: str | Path | None = None,
    set: Changes = None,
    seed: int | None = None,
    readings: str = "default",
    jobs: int = -1,
    device: Literal["cpu", "gpu"] = "cpu",
    out: str | Path = "reports/ensemble",
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
) -> Result:
    """Run many plausible plants under many readings of the text; an interrupted call goes on from `out`.

    Parameters
    ----------
    draws : int
        Plants, a power of two.
    config, set, seed
        As of `compare`; the configuration is that of an ensemble.
    readings : str
        ``default``, or comma-separated names.
    jobs : int
        Processes; -1 is one for each processor.
    device : str
        ``gpu`` runs on a GPU of NVIDIA's, by CuPy.
    formats : str or sequence of str, optional
        Of figures, ``png``, ``pdf`` or ``svg``; else all three.
    figures : bool
        Whether to draw any.
    force : bool
        Replace other results.
    """
    given = {**locals()}
    from tendonrepro.monte_carlo.command import run_ensemble

    return _written("ensemble", run_ensemble, given)


def identify(
    fit: Literal["controller_2", "all"] = "controller_2",
    *,
    config: str | Path | None = None,
    readings: str = "printed",
    generations: int = 60,
    population: int = 48,
    seeds: int = 3,
    unknowns: int = 10,
    rows: str = "",
    jobs: int = -1,
    device: Literal["cpu", "gpu"] = "cpu",
    out: str | Path = "reports/identify",
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
) -> Result:
    """Search plants and readings closest to the printed numbers; an interrupted call goes on.

    Parameters
    ----------
    fit : str
        ``controller_2``, or ``all`` sixteen numbers.
    generations, population, seeds : int
        Of each search, members of a generation, and searches of a reading.
    unknowns : int
        Parameters that are searched at most, those that move the fitted numbers most.
    rows : str
        Names of the parameters to search instead, comma-separated.
    config, readings, jobs, device, out, formats, figures, force
        As of `ensemble`.
    """
    given = {**locals()}
    from tendonrepro.identification.command import run_identify

    return _written("identify", run_identify, given)


def predict(
    draws: int = 256,
    *,
    config: str | Path | None = None,
    set: Changes = None,
    seed: int | None = None,
    readings: str | None = None,
    device: Literal["cpu", "gpu"] = "cpu",
    out: str | Path = "reports/predict",
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
) -> Result:
    """Predict what experiments on a bench would give under each reading.

    Parameters are as of `ensemble`; the default is fourteen main readings.
    """
    given = {**locals()}
    from tendonrepro.evidence.predict import READINGS, run_predict

    return _written("predict", run_predict, given | {"readings": readings or READINGS})


def tune(
    plants: int = 16,
    *,
    searches: int = 4,
    generations: int = 4,
    population: int = 6,
    laws: Mapping[str, Callable[..., Any]] | None = None,
    any_plant: bool = False,
    config: str | Path | None = None,
    set: Changes = None,
    seed: int | None = None,
    jobs: int = -1,
    device: Literal["cpu", "gpu"] = "cpu",
    out: str | Path = "reports/tune",
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
) -> Result:
    """Tune every law on the same plants, and compare them; an interrupted call goes on.

    Parameters
    ----------
    searches, generations, population : int
        Searches of each law and plant, generations of each, members of these.
    laws : mapping, optional
        Name -> function of your own with an attribute ``bounds``; see docs/python.md.
    any_plant : bool
        Also plants on which the published gains are unstable.
    config, set, seed, jobs, device, out, formats, figures, force
        As of `ensemble`; the seed is that of the searches.
    """
    given = {**locals()}
    from tendonrepro.tuning.command import run_tune

    return _written("tune", run_tune, given | {"laws": (), "given": laws})


def validate(
    measured: str | Path = "data/measured.h5",
    config: str | Path | None = None,
    *,
    set: Changes = None,
    out: str | Path = "reports/validate",
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
) -> Result:
    """Compare measured data with paper and model; results are written to `out`."""
    given = {**locals()}
    from tendonrepro.validation.command import run_validate

    return _written("validate", run_validate, given | {"measured": Path(measured)})


def claims(*ids: str, out: str | Path = "reports", measured: str | Path | None = None) -> Result:
    """Judge the published claims, or those named, from results under `out`.

    Without an ensemble there the stored one stands in. Nothing is written.
    """
    from tendonrepro.verdicts.command import judged
    from tendonrepro.verdicts.report import as_data, details_text, table_text

    started = time.perf_counter()
    _, verdicts, judged_by = judged(Path(out), _path(measured), ids, Talk())
    text = "\n\n".join(map(details_text, verdicts)) if ids else table_text(verdicts, every=True)
    outcome = Outcome(as_data(verdicts, judged_by), [text])
    return _studied("claims", load_config(None, "compare"), outcome, started)


def config(source: str | Path | None = None, *, set: Changes = None) -> Config:
    """Return a checked, frozen configuration; `source` is a file or a shipped name."""
    return load_config(source or "compare", None, overrides=_overrides(set)).config


def open(folder: str | Path) -> Result:
    """Read the stored result of any command, or a trace file; a measured one, too.

    Raises
    ------
    DataMissingError
        When there is none, or it is damaged.
    """
    path = Path(folder)
    if path.is_dir() and not (path / TRACES).exists():
        found = read_result(path)
        outcome = Outcome(found.data, list(found.tables.values()))
        return Result(found.command, outcome, dict(found.manifest), _folder=path)
    from tendonrepro.experiments.run import outcome_of

    file = read_traces(path)
    # A measured file has a mapping in place of a configuration.
    manifest = {"config": {"sha256": file.config_sha256}, **json.loads(file.manifest_json)}
    return Result(file.experiment, outcome_of(file), manifest, file)


def fetch(
    record: str = "19467931", out: str | Path = "data/zenodo", *, force: bool = False
) -> dict[str, Any]:
    """Download a record, by default the paper's, and verify it; a second call needs no network."""
    from tendonrepro.dataset.fetch import run_fetch

    return run_fetch(record, Path(out), None, force, False, Talk())


def inspect(*paths: str | Path, mapping: str | Path | None = None, force: bool = False) -> dict[str, Any]:
    """Tell what is in files; with `mapping`, write a mapping file to edit."""
    from tendonrepro.dataset.command import run_inspect

    return run_inspect([*map(Path, paths)], _path(mapping), force=force)


def ingest(
    *paths: str | Path,
    mapping: str | Path = "data/mapping.yaml",
    out: str | Path = "data/measured.h5",
    confirm: bool = False,
    force: bool = False,
) -> dict[str, Any]:
    """Convert measured data to a trace file; `confirm` says that the mapping is right."""
    from tendonrepro.dataset.command import run_ingest

    talk, files = Talk(), [*map(Path, paths)]
    return run_ingest(files, Path(mapping), Path(out), force=force, dry_run=False, talk=talk, confirm=confirm)


def figures(
    out: str | Path = "reports", names: Sequence[str] = (), *, formats: Formats = None, force: bool = False
) -> list[Path]:
    """Draw figures again from stored traces, all or those named; `formats` are as of `ensemble`."""
    from tendonrepro.experiments.command import redraw

    return redraw(Path(out), list(names) or None, force=force, formats=formats_of(formats))


def tables(out: str | Path = "reports", *, force: bool = False) -> list[Path]:
    """Write tables again from stored traces."""
    from tendonrepro.experiments.command import rewrite_tables

    return rewrite_tables(Path(out), force=force)


def export(
    file: str | Path, form: str = "csv", out: str | Path | None = None, *, force: bool = False
) -> Path:
    """Write stored traces as ``csv``, ``parquet`` or ``mat``."""
    return export_traces(Path(file), form, _path(out), force=force)


def animate(
    file: str | Path,
    out: str | Path | None = None,
    *,
    run: str | None = None,
    speed: float = 1.0,
    force: bool = False,
) -> list[str]:
    """Film the arm, its tendons coloured by tension, and return the files."""
    from tendonrepro.results.figures.animation import animate as make

    found = make(Path(file), Talk(), run=run, speed=speed, out=_path(out), force=force)
    return list(found["files"])


def diff(first: str | Path, second: str | Path) -> dict[str, Any]:
    """Tell what differs between two results; ``same`` is True where nothing does."""
    from tendonrepro.results.difference import difference

    return difference(Path(first), Path(second))


def report(results: str | Path = "reports", out: str | Path | None = None, *, force: bool = False) -> Path:
    """Write one HTML file of all that was run."""
    from tendonrepro.reporting.command import run_report

    return Path(run_report(Path(results), _path(out), force=force)["path"])


def live(
    config: str | Path | None = None,
    out: str | Path = "live.html",
    *,
    set: Changes = None,
    force: bool = False,
) -> Path:
    """Write one HTML file that runs the experiment in a browser; `config` becomes one of its presets."""
    from tendonrepro.reporting.live.command import run_live

    return Path(run_live(_request({**locals()}))["path"])


def _experiment(loaded: LoadedConfig, laws: Mapping[str, Callable[..., Any]] | None = None) -> Result:
    """Simulate in this process, which needs no main guard; a notebook has none."""
    from tendonrepro.experiments.loops import growing
    from tendonrepro.experiments.run import outcome_of, prepared, simulate_all, trace_file
    from tendonrepro.experiments.user_law import laws_of

    started = time.perf_counter()
    experiment = prepared(loaded, laws_of((), laws))
    loaded = experiment.loaded
    (traces,) = simulate_all([experiment], Talk())
    seconds = time.perf_counter() - started
    manifest = make_manifest(loaded, seconds) | {"growing_hz": growing(experiment.loops)}
    file = trace_file(loaded, traces, manifest)
    return Result(loaded.config.experiment, outcome_of(file), manifest, file)


def _studied(command: str, loaded: LoadedConfig, outcome: Outcome, started: float) -> Result:
    manifest = make_manifest(loaded, time.perf_counter() - started, command) | dict(outcome.manifest)
    return Result(command, outcome, manifest)
