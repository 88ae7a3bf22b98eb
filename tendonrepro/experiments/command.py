"""What a command does: from a configuration to results on disk."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, Literal

from tendonrepro.config.ensemble import LoadedEnsemble
from tendonrepro.config.kinds import checked
from tendonrepro.config.load import ExperimentName, LoadedConfig
from tendonrepro.config.request import Request
from tendonrepro.config.shipped import shipped_folder
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.experiments.linear import growing
from tendonrepro.experiments.loops import all_loops
from tendonrepro.experiments.run import PRECISE, simulate_all, trace_file
from tendonrepro.experiments.user_law import UserLaw, with_user_law
from tendonrepro.files import to_json, write_atomically
from tendonrepro.parallel import each
from tendonrepro.results.figures import NUMBERS
from tendonrepro.results.folder import (
    LOCK,
    MANIFEST,
    TRACES,
    claimed,
    foretell_refusal,
    guarded,
    read_manifest,
    refuse_foreign,
    stored_traces,
)
from tendonrepro.results.manifest import make_manifest, with_outputs
from tendonrepro.results.paper_tables import write_tables
from tendonrepro.results.records import TraceFile
from tendonrepro.results.summary import table_data_compare, table_data_decouple
from tendonrepro.results.traces import write_traces
from tendonrepro.simulation.resolution import COMPILED_STEPPER

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Order:
    """One of the paper's experiments as a user wants it.

    Attributes
    ----------
    experiment : {'compare', 'decouple'}
    request : Request
    law : str or None
        ``FILE:NAME`` of a law to run beside the controllers.
    solver : {'scipy', 'compiled'}
        Stepper: the reference, or the one of ensembles.
    """

    experiment: ExperimentName
    request: Request = field(default_factory=Request)
    law: str | None = None
    solver: Literal["scipy", "compiled"] = "scipy"

    @property
    def folder(self) -> Path:
        """Results folder."""
        return self.request.folder(self.experiment)


def run_experiments(orders: Sequence[Order], talk: Talk) -> dict[ExperimentName, dict[str, Any]]:
    """Simulate experiments and write traces, figures, tables and manifest of each.

    Their runs share the processors, and then their figures do. Everything is checked before the first run.

    Parameters
    ----------
    orders : sequence of Order
        Of different experiments and folders, with one stepper; all or none a dry run.
    talk : Talk

    Returns
    -------
    dict
        What ``--json`` prints of each experiment; of a dry run what would be done.

    Raises
    ------
    TendonreproError
        If a configuration cannot be used or results cannot be written.
    """
    asked = [_load(order) for order in orders]
    for loaded, _ in asked:
        _name_shipped(loaded, talk)
    if orders[0].request.dry_run:
        return {order.experiment: _plan(order, *one, talk) for order, one in zip(orders, asked, strict=True)}
    with ExitStack() as stack:
        folders = [
            stack.enter_context(claimed(order.folder, loaded.sha256, force=order.request.force))
            for order, (loaded, _) in zip(orders, asked, strict=True)
        ]
        simulated = simulate_all(asked, talk, orders[0].solver)
        manifests, files = [], {}
        for order, (loaded, _), traces, held in zip(orders, asked, simulated, folders, strict=True):
            manifest = make_manifest(loaded, held.seconds)
            if order.solver == "compiled":
                manifest["solver"] = {"name": COMPILED_STEPPER, "tolerance": PRECISE}
            manifests.append(manifest)
            files[held.path] = trace_file(loaded, traces, manifest)
            held.clear()
            write_traces(held.path / TRACES, files[held.path])
            held.files.append(held.path / TRACES)
        drawn = _draw({path: (file, NUMBERS[file.experiment]) for path, file in files.items()})
        for manifest, held in zip(manifests, folders, strict=True):
            held.files += [*drawn[held.path], *write_tables(files[held.path], held.path / "tables")]
            held.finish(manifest, talk)
    return {
        order.experiment: _results(files[order.folder], loaded, order.folder)
        for order, (loaded, _) in zip(orders, asked, strict=True)
    }


def diverged(found: dict[str, Any]) -> bool:
    """Whether a run of an experiment diverged."""
    return "diverged" in found.get("status", {}).values()


def both_orders(configs: Path | None, request: Request) -> list[Order]:
    """Orders for the two experiments of the paper.

    Parameters
    ----------
    configs : Path or None
        Folder with ``decouple.yaml`` and ``compare.yaml``; None is the shipped ones.
    request : Request
        For both; its results folder is the one above theirs.
    """
    names: tuple[ExperimentName, ...] = ("decouple", "compare")
    above = request.out or Path("reports")
    files = {name: None if configs is None else str(configs / f"{name}.yaml") for name in names}
    return [Order(name, replace(request, config=files[name], out=above / name)) for name in names]


def _plan(order: Order, loaded: LoadedConfig, law: UserLaw | None, talk: Talk) -> dict[str, Any]:
    """Runs with their number of samples, digest of the configuration, and results folder."""
    foretell_refusal(order.folder, loaded.sha256, talk, force=order.request.force)
    return {
        "schema_version": SCHEMA_VERSION,
        "experiment": order.experiment,
        "dry_run": True,
        "config": loaded.origin,
        "config_sha256": loaded.sha256,
        "samples": {name: loop.reference.time.size for name, loop in all_loops(loaded, law).items()},
        "out": str(order.folder),
    }


def check(config: str, overrides: Sequence[str], talk: Talk) -> dict[str, Any]:
    """Check a configuration as thoroughly as running it would.

    Parameters
    ----------
    config : str
        File, ``-``, or a shipped name.
    overrides : sequence of str
        ``dotted.key=VALUE``.
    talk : Talk
        Told of a shipped file that stands in for one beside the configuration.

    Returns
    -------
    dict
        Its kind; of an experiment also its digest and runs.

    Raises
    ------
    ConfigError
        With every mistake found.
    """
    held = checked(config, overrides)
    found = {"schema_version": SCHEMA_VERSION, "config": config}
    if isinstance(held, LoadedEnsemble):
        return found | {"kind": "ensemble", "config_sha256": held.sha256}
    if not isinstance(held, LoadedConfig):
        return found | {"kind": "manipulator"}
    _name_shipped(held, talk)
    runs = list(all_loops(held, None))
    return found | {"kind": held.config.experiment, "config_sha256": held.sha256, "runs": runs}


def _name_shipped(loaded: LoadedConfig, talk: Talk) -> None:
    """Say which shipped file a configuration that is not shipped itself was completed by."""
    for path in loaded.inputs:
        if path.parent == shipped_folder() != loaded.folder:
            talk.note(f"no {path.name} in {loaded.folder}, so the shipped one is taken: {path}")


def redraw(out: Path, numbers: Sequence[int] | None, *, force: bool = False) -> list[Path]:
    """Draw figures from stored traces again.

    Parameters
    ----------
    out : Path
        Results folder, or the folder above several.
    numbers : sequence of int, optional
        The paper's figure numbers; all that the traces allow if not given.
    force : bool
        Overwrite files that the manifest does not list, or that were changed since.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    DataMissingError
        If no stored traces hold what one of the figures shows.
    UsageError
        If something would be overwritten.
    """
    from tendonrepro.results.figures.catalogue import FIGURES, available

    unknown = [number for number in numbers or () if number not in FIGURES]
    if unknown:
        message = f"the paper's results have no Figure {unknown[0]}"
        raise UsageError(message, hint=f"figures: {', '.join(map(str, FIGURES))}")
    files = _stored(out)
    drawable = {folder: available(file) for folder, file in files.items()}
    for number in numbers or ():
        if not any(number in found for found in drawable.values()):
            message = f"no stored traces hold what Figure {number} shows"
            have = ", ".join(str(k) for k in sorted(set().union(*drawable.values()))) or "none"
            raise DataMissingError(message, where=str(out), hint=f"figures that can be drawn: {have}")
    with ExitStack() as stack:
        wanted = {
            folder: (file, [number for number in drawable[folder] if numbers is None or number in numbers])
            for folder, file in files.items()
        }
        written = {
            folder: stack.enter_context(
                _rewritten(folder, file, [f"figures/fig{number:02d}.*" for number in chosen], force=force)
            )
            for folder, (file, chosen) in wanted.items()
        }
        for folder, paths in _draw(wanted).items():
            written[folder] += paths
    return [path for paths in written.values() for path in paths]


def rewrite_tables(out: Path, *, force: bool = False) -> list[Path]:
    """Make the tables from stored traces again.

    Parameters
    ----------
    out : Path
        Results folder, or the folder above several.
    force : bool
        Overwrite files that the manifest does not list, or that were changed since.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    UsageError
        If something would be overwritten.
    """
    found: list[Path] = []
    for folder, file in _stored(out).items():
        with _rewritten(folder, file, ["tables/[!.]*"], force=force) as written:
            written.extend(write_tables(file, folder / "tables"))
        found += written
    return found


def _stored(out: Path) -> dict[Path, TraceFile]:
    """Traces in the given folder, or in those directly below it."""
    folders = [out] if (out / TRACES).exists() else sorted(path.parent for path in out.glob(f"*/{TRACES}"))
    if not folders:
        message, hint = (
            f"holds no {TRACES}, nor does a folder in it",
            "run tendonrepro reproduce, or name another --out",
        )
        raise DataMissingError(message, where=str(out), hint=hint)
    return {folder: stored_traces(folder) for folder in folders}


@contextmanager
def _rewritten(
    folder: Path, file: TraceFile, patterns: Sequence[str], *, force: bool
) -> Iterator[list[Path]]:
    """Hold a result while files of it are written again; its manifest gets the digests of those listed."""
    with claimed(folder, file.config_sha256, force=True):
        manifest = read_manifest(folder) if (folder / MANIFEST).exists() else None
        held = manifest or {}
        made = held.get("created", file.created), held.get("config", {}).get("sha256", file.config_sha256)
        if made != (file.created, file.config_sha256):
            message = "was written anew while its traces were read"
            raise UsageError(message, where=str(folder), hint="run it again")
        if not force:
            listed = ({} if manifest is None else manifest.get("outputs", {})).items()
            ours = {name: sha for name, sha in listed if any(map(PurePath(name).match, patterns))}
            refuse_foreign(folder, patterns, ours)
        paths: list[Path] = []
        yield paths
        if manifest is not None:
            fresh = with_outputs(manifest, folder, paths)["outputs"]
            updated = manifest | {"outputs": manifest.get("outputs", {}) | fresh}
            write_atomically(folder / MANIFEST, to_json(updated))


def _draw(wanted: Mapping[Path, tuple[TraceFile, Sequence[int]]]) -> dict[Path, list[Path]]:
    """Draw figures, by the paper's numbers, of the traces of each results folder, as far as these allow."""
    # One pool for all folders: to start its processes takes as long as to draw two figures. The later ones
    # have more panels: begun first, they keep no processor waiting at the end.
    pieces = [
        (file, folder / "figures", number, (folder / LOCK).stat())
        for folder, (file, numbers) in reversed(list(wanted.items()))
        for number in reversed(numbers)
    ]
    drawn: dict[Path, list[Path]] = {folder: [] for folder in wanted}
    for (_, folder, _, _), paths in reversed(list(zip(pieces, each(_drawn, pieces), strict=True))):
        drawn[folder.parent] += paths
    return drawn


def _drawn(piece: tuple[TraceFile, Path, int, os.stat_result]) -> list[Path]:
    """Draw one figure of a file into a folder, by the paper's number, if its traces allow it."""
    from tendonrepro.results.figures.catalogue import FIGURES, redrawn

    file, folder, number, lock = piece
    with guarded(folder.parent, lock):
        return redrawn(file, folder, number) if FIGURES[number].traces(file) else []


def _load(order: Order) -> tuple[LoadedConfig, UserLaw | None]:
    """Configuration and law; stepper and law are part of the digest."""
    loaded = order.request.load(order.experiment)
    if order.solver == "compiled":
        if order.law is not None:
            message = "only the paper's own control laws run by the compiled stepper"
            raise UsageError(message, where="--law", hint="use --solver scipy")
        digest = hashlib.sha256(f"{loaded.sha256} compiled".encode()).hexdigest()
        loaded = replace(loaded, sha256=digest, overrides=(*loaded.overrides, "solver=compiled"))
    return with_user_law(loaded, order.law)


def _results(file: TraceFile, loaded: LoadedConfig, folder: Path) -> dict[str, Any]:
    """Results stored in a folder as plain numbers, with the keys of ``--json``."""
    joints = list(next(iter(file.runs.values())).joint)
    head = {"schema_version": SCHEMA_VERSION, "experiment": file.experiment, "joints": joints}
    end = {"out": str(folder), "manifest": str(folder / MANIFEST)}
    if file.experiment == "decouple":
        return head | table_data_decouple(file) | end
    return head | table_data_compare(file) | end | {"growing_hz": growing(loaded)}
