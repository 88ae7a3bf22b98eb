"""A control law of the user's own, on the same plants and reference."""

from __future__ import annotations

import copy
import hashlib
import runpy
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import TypeAlias, cast

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.control import PAYLOAD, unloaded_run
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.rig import build_actuator, build_arm, coupling
from tendonrepro.files import sha256_of
from tendonrepro.physics.arm import gravity_torque, mass_matrix
from tendonrepro.physics.control import Law, Memory, estimator_weights
from tendonrepro.simulation.codegen.symbols import UnknownValueError
from tendonrepro.simulation.loop import CommandFunction, Loop, TimeDelayController


def model_of(config: CompareConfig) -> SimpleNamespace:
    """The plant without payload, as a law may know it, SI; see docs/python.md."""
    links, n, arm = config.manipulator.links, len(config.joints), build_arm(config, 0.0)
    S, S_inv = coupling(config)
    return SimpleNamespace(
        joints=tuple(config.joints),
        mass=links.mass.si[-n:],
        length=links.length.si[-n:],
        com=links.com.si[-n:],
        S=S,
        S_inv=S_inv,
        torque_limit=build_actuator(config).limit,
        L=config.sampling_period.si,
        gravity=partial(gravity_torque, arm=arm),
        inertia=partial(mass_matrix, arm=arm),
    )


UserFunction: TypeAlias = Callable[..., object]
"""What a user gives as a law: whether it is one shows when it is called."""

Signals: TypeAlias = tuple[Array, Array, Array, Array]
"""What a law answers: torque, estimate, sliding variable and error rate."""


@dataclass(frozen=True)
class UserLaw:
    """A callable with the signature of :func:`tendonrepro.physics.control.command`; its name is the run's.

    It is in the Python file `path`, or `given`.
    """

    name: str
    path: Path | None = None
    given: UserFunction | None = None

    @property
    def spec(self) -> str:
        """``FILE:NAME``, or the name alone."""
        return f"{self.path}:{self.name}" if self.path else self.name

    @property
    def content(self) -> str:
        """Digest of its file as it is now, or what stands for a given one."""
        return sha256_of(self.path) if self.path else repr(self.given)

    def load(self) -> tuple[UserFunction, Callable[[SimpleNamespace], object] | None]:
        """A fresh copy of the law, so that runs share no memory, and its `setup`, if it has one."""
        if self.path:
            with self.explained():
                module = runpy.run_path(str(self.path), run_name=self.path.stem)
        else:
            module = {self.name: copy.deepcopy(self.given)}
        law = module.get(self.name)
        if not callable(law) or isinstance(law, type):
            message = f"there is no function {self.name!r}, nor an object of that name that can be called"
            raise UsageError(message, where=self.spec)
        return law, getattr(law, "setup", module.get("setup"))

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Name the law and the line where an error arose; what a law prints is no result."""
        try:
            with redirect_stdout(sys.stderr):
                yield
        except (Exception, SystemExit) as error:
            calls = traceback.extract_tb(error.__traceback__)
            own = [call.lineno for call in calls if call.filename == str(self.path)]
            message = f"the law {self.name} failed: {type(error).__name__}: {error}"
            where = f"{self.path}:{own[-1]}" if own else self.spec
            called = "a law is called with memory, q, q_d, dq_d, ddq_d, law"
            hint = called if isinstance(error, TypeError) else None
            raise TendonreproError(message, where=where, hint=hint) from error


def laws_of(given: Sequence[str] | Mapping[str, UserFunction] | None) -> list[UserLaw]:
    """Laws named as ``FILE:NAME``, or given by name."""
    if isinstance(given, Mapping):
        laws = [UserLaw(name, given=law) for name, law in given.items()]
    else:
        laws = [_law_of(spec) for spec in given or ()]
    for law in laws:
        if "/" in law.name or unloaded_run(law.name):
            message = f"a law cannot be called {law.name!r}"
            raise UsageError(message, where="laws", hint=f"without a slash, and not ending in {PAYLOAD}")
    return laws


def _law_of(spec: str) -> UserLaw:
    file, _, name = spec.rpartition(":")
    if not file or not name.isidentifier():
        message = f"must be FILE:NAME, a Python file and a function in it, found {spec!r}"
        raise UsageError(message, where="--law")
    if not Path(file).is_file():
        raise UsageError(
            "there is no such file", where=file, hint="paths of --law begin in the current folder"
        )
    return UserLaw(name, Path(file))


def with_user_laws(loaded: LoadedConfig, laws: Sequence[UserLaw]) -> LoadedConfig:
    """Configuration whose digest and inputs know of the laws."""
    for law in laws:
        loaded = replace(
            loaded,
            sha256=hashlib.sha256(f"{loaded.sha256} {law.content} {law.name}".encode()).hexdigest(),
            overrides=(*loaded.overrides, f"law={law.spec}"),
            inputs=(*loaded.inputs, *([law.path] if law.path else [])),
        )
    return loaded


def runs_of(law: UserLaw, config: CompareConfig) -> dict[str, str]:
    """A law's runs, and whose plants they have: the first run's, and one with payload."""
    first, *rest = config.runs
    payload = next((run for run in rest if config.runs[run].payload.si > config.runs[first].payload.si), None)
    return {law.name: first} | ({f"{law.name}{PAYLOAD}": payload} if payload else {})


def own_loops(
    law: UserLaw, config: CompareConfig, loops: Mapping[str, Loop], on_lanes: CommandFunction | None = None
) -> dict[str, Loop]:
    """Runs of a law on the plants of configured ones, with the gains of the first and plain estimation.

    The weights of Eq. (15) are the paper's controllers' own: a law that wants them says so. Each run has a
    fresh copy of the law, or all have the same function, as `lane_function` makes it, `on_lanes`.
    """
    first = cast("TimeDelayController", next(iter(loops.values())).controller)
    gains = first.law._replace(weights=estimator_weights(np.zeros(len(config.joints))))
    own = {}
    for name, plant in runs_of(law, config).items():
        command = on_lanes or checked(law, model_of(config))
        controller = replace(first, law=gains, command=command, on_lanes=on_lanes is not None)
        own[name] = replace(loops[plant], controller=controller)
    return own


def lane_function(law: UserLaw) -> CommandFunction:
    """The law as one function for many plants together, the same while its file is.

    Raises
    ------
    UsageError
        If it is told of its plant.
    """
    return _lane_function(law, law.content)


@cache
def _lane_function(law: UserLaw, _content: str) -> CommandFunction:
    function, setup = law.load()
    if setup is not None:
        message = f"the law {law.name} is told of its plant, and cannot run on many plants together"
        raise UsageError(message, where="--law", hint="leave out setup; knowledge comes through ddq_d")

    def command(memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, law: Law) -> Signals:
        answer = function(memory, q, q_d, dq_d, ddq_d, law)
        blank = np.full(q.shape, np.nan)
        return (answer, blank, blank, blank) if isinstance(answer, np.ndarray) else cast("Signals", answer)

    return command


def refuse_memory(law: UserLaw, loop: Loop) -> None:
    """Raise a UsageError for a law whose last answer in a run depends on those before.

    Many plants together are one record of what it does with its arguments, so such a law cannot run on them.
    """
    # Where nothing is run, whoever imports this needs no compiler.
    from tendonrepro.simulation.stepper import simulate

    asked, fresh = checked(law, SimpleNamespace()), checked(law, SimpleNamespace())
    sample: tuple[Memory, Array, Array, Array, Array, Law]
    answer: Signals

    def command(memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, gains: Law) -> Signals:
        nonlocal sample, answer
        sample = memory, q, q_d, dq_d, ddq_d, gains
        answer = asked(*sample)
        return answer

    controller = cast("TimeDelayController", loop.controller)
    simulate(replace(loop, controller=replace(controller, command=command, on_lanes=False)))
    if not np.array_equal(answer, fresh(*sample), equal_nan=True):
        message = f"the law {law.name} remembers earlier calls, and cannot run on many plants together"
        raise UsageError(message, where="--law", hint="memory has the torques, angles and rates before")


def refused_on_lanes(name: str, error: Exception) -> UsageError:
    """Why a law cannot run on many plants together, and what to write instead."""
    message = f"the law {name} cannot run on many plants together: {type(error).__name__}: {error}"
    hint = "return tau, H_hat, s and de, each an array with a number per joint"
    if isinstance(error, UnknownValueError):
        calls = traceback.extract_tb(error.__traceback__)
        lines = [call.lineno for call in calls if call.name == name]
        at = f" in its line {lines[-1]}" if lines else ""
        message = f"the law {name} branches{at} on a number, which differs from plant to plant"
        hint = "write np.where(e[i] > 0.0, then, otherwise) for each joint i in place of if"
    return UsageError(message, where="--law", hint=hint)


def checked(law: UserLaw, model: SimpleNamespace) -> CommandFunction:
    """A law that was told of its plant, and answers in the shapes that a run needs."""
    function, setup = law.load()
    if setup:
        with law.explained():
            setup(model)

    def command(memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, gains: Law) -> Signals:
        with law.explained():
            # What a law does to its arguments must not reach the run.
            own = Memory(*(x.copy() for x in memory))
            answer = function(own, q.copy(), q_d.copy(), dq_d.copy(), ddq_d.copy(), gains)
            answer = answer if isinstance(answer, tuple | list) else (answer, None, None, None)
            # What the law does not have is NaN, and is left out of the trace.
            parts = [np.full(q.shape, np.nan) if part is None else np.array(part) for part in answer]
        shapes = {(part.shape, part.dtype.kind in "biuf") for part in parts}
        if len(parts) != 4 or answer[0] is None or shapes != {(q.shape, True)}:
            message = f"must return tau, or tau, H_hat, s and de, each real numbers of shape {q.shape}"
            raise TendonreproError(message, where=law.spec)
        tau, H_hat, s, de = (part.astype(float) for part in parts)
        if np.isnan(tau).any() and np.isfinite(q).all():
            message = f"the law {law.name} gave a torque that is not a number, {tau}, at the angles {q} rad"
            hint = "look for 0/0, or the root or a fractional power of a negative number"
            raise TendonreproError(message, where=law.spec, hint=hint)
        return tau, H_hat, s, de

    return command
