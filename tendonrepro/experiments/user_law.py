"""A control law of the user's own, run beside the paper's on the same plant and reference."""

from __future__ import annotations

import copy
import hashlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.rig import build_actuator, build_arm, coupling
from tendonrepro.files import sha256_of
from tendonrepro.physics.arm import Arm, gravity_torque, mass_matrix
from tendonrepro.physics.control import Law, Memory
from tendonrepro.results.summary import PAYLOAD
from tendonrepro.simulation.controllers import TimeDelayController
from tendonrepro.simulation.sampled import CommandFunction
from tendonrepro.simulation.stepper import Loop

CALLED = "a law is called with memory, q, q_d, dq_d, ddq_d, law"


@dataclass(frozen=True)
class Model:
    """The plant of a configuration without payload, as a law may know it; n moving joints, SI units.

    Attributes
    ----------
    joints : tuple of int
        The paper's numbers.
    mass, length, com : array (n,)
        Of the links, kg and m.
    S, S_inv : array (n, n)
        Coupling of Eq. (2).
    torque_limit : array (n,)
        Of the winches, N m; ``S_inv.T`` maps torques of winches to joint coordinates.
    L : float
        Sampling period, s.
    arm : Arm
    """

    joints: tuple[int, ...]
    mass: Array
    length: Array
    com: Array
    S: Array
    S_inv: Array
    torque_limit: Array
    L: float
    arm: Arm

    def gravity(self, q: Array) -> Array:
        """Torque of the weight of the links at joint angles (n,), N m, (n,)."""
        return gravity_torque(q, self.arm)

    def inertia(self, q: Array) -> Array:
        """Mass matrix of the links at joint angles (n,), kg m², (n, n)."""
        return mass_matrix(q, self.arm)


def model_of(config: CompareConfig) -> Model:
    """What a law is told of its plant."""
    links, n = config.manipulator.links, len(config.joints)
    S, S_inv = coupling(config)
    return Model(
        joints=tuple(config.joints),
        mass=links.mass.si[-n:],
        length=links.length.si[-n:],
        com=links.com.si[-n:],
        S=S,
        S_inv=S_inv,
        torque_limit=build_actuator(config).limit,
        L=config.sampling_period.si,
        arm=build_arm(config, 0.0),
    )


@dataclass(frozen=True)
class UserLaw:
    """A callable with the signature of :func:`tendonrepro.physics.control.command`; its name is the run's.

    It is the one of that name in a Python file, or `given`.
    """

    name: str
    path: Path | None = None
    given: Callable[..., Any] | None = None

    @property
    def spec(self) -> str:
        """``FILE:NAME``, or the name alone."""
        return f"{self.path}:{self.name}" if self.path else self.name

    def digest(self) -> str:
        """Digest of the file, or of the source of what is given as far as it is known."""
        if self.path:
            return sha256_of(self.path)
        source = self.given if inspect.isroutine(self.given) else type(self.given)
        try:
            text = inspect.getsource(source)
        except (OSError, TypeError):
            text = ""
        return hashlib.sha256(f"{text} {self.given!r}".encode()).hexdigest()

    def load(self) -> tuple[Callable[..., Any], Callable[[Model], Any] | None]:
        """A fresh copy of the law, so that runs share no memory, and its `setup`, if it has one."""
        if self.path is None:
            given = copy.deepcopy(cast("Callable[..., Any]", self.given))
            return given, getattr(given, "setup", None)
        module = self._module(self.path)
        law: Callable[..., Any] | None = getattr(module, self.name, None)
        if not callable(law):
            message = f"{self.path} has no function {self.name!r}"
            raise UsageError(message, where="--law")
        return law, getattr(law, "setup", getattr(module, "setup", None))

    def _module(self, path: Path) -> ModuleType:
        """Run the file."""
        found = importlib.util.spec_from_file_location(path.stem, path)
        if found is None or found.loader is None:
            message = f"{path} is not a Python file"
            raise UsageError(message, where="--law")
        module = importlib.util.module_from_spec(found)
        try:
            # What a law prints is no result.
            with redirect_stdout(sys.stderr):
                found.loader.exec_module(module)
        except BaseException as error:
            message = f"cannot be run: {_described(error)}"
            raise UsageError(message, where=self.place_of(error)) from error
        return module

    def place_of(self, cause: BaseException | Callable[..., Any]) -> str:
        """``FILE:line`` of a function, or where an error arose; without the line where that is elsewhere."""
        if isinstance(cause, BaseException):
            lines = [(call.filename, call.lineno) for call in traceback.extract_tb(cause.__traceback__)]
            if isinstance(cause, SyntaxError):
                lines.append((cause.filename or "", cause.lineno))
        else:
            code = getattr(cause, "__code__", None)
            lines = [(code.co_filename, code.co_firstlineno)] if code else []
        if self.path is None:
            return ":".join(map(str, lines[-1])) if lines else self.name
        own = [line for name, line in lines if line and Path(name).absolute() == self.path.absolute()]
        return f"{self.path}:{own[-1]}" if own else str(self.path)


def find_user_law(spec: str) -> UserLaw:
    """Law named as ``FILE:NAME`` on the command line."""
    file, _, name = spec.rpartition(":")
    path = Path(file)
    if not file or not name.isidentifier():
        message = f"must be FILE:NAME, a Python file and a function in it, found {spec!r}"
        raise UsageError(message, where="--law")
    if not path.is_file():
        message = f"no such file: {path}"
        raise UsageError(message, where="--law")
    return UserLaw(name, path)


def laws_of(specs: Sequence[str], given: Mapping[str, Callable[..., Any]] | None = None) -> list[UserLaw]:
    """Laws named as ``FILE:NAME``, and then those given by name."""
    laws = [find_user_law(spec) for spec in specs]
    laws += [UserLaw(name, given=law) for name, law in (given or {}).items()]
    for law in laws:
        if law.given is not None and not callable(law.given):
            message = f"the law {law.name} is neither a function nor an object that can be called"
            raise UsageError(message, where="laws")
        if "/" in law.name or law.name.endswith(PAYLOAD):
            message = f"a law cannot be called {law.name!r}"
            raise UsageError(message, where="laws", hint=f"without a slash, and not ending in {PAYLOAD}")
    return laws


def with_user_laws(loaded: LoadedConfig, laws: Sequence[UserLaw]) -> LoadedConfig:
    """Configuration whose digest and inputs know of the laws that run beside it."""
    for law in laws:
        loaded = replace(
            loaded,
            sha256=hashlib.sha256(f"{loaded.sha256} {law.digest()} {law.name}".encode()).hexdigest(),
            overrides=(*loaded.overrides, f"law={law.spec}"),
            inputs=(*loaded.inputs, *([law.path] if law.path else [])),
        )
    return loaded


def runs_of(law: UserLaw, config: CompareConfig) -> dict[str, str]:
    """A law's runs, each with the configured run whose plant it has: the first one, and one with payload."""
    first, *rest = config.runs
    payload = next((run for run in rest if config.runs[run].payload.si > config.runs[first].payload.si), None)
    return {law.name: first} | ({f"{law.name}{PAYLOAD}": payload} if payload else {})


def own_loops(law: UserLaw, config: CompareConfig, loops: Mapping[str, Loop]) -> dict[str, Loop]:
    """Runs of a law on the plants of configured ones; it is told the gains of the first of these."""
    controller = cast("TimeDelayController", next(iter(loops.values())).controller)
    return {
        name: replace(
            loops[plant], controller=replace(controller, command=_checked(law, partial(model_of, config)))
        )
        for name, plant in runs_of(law, config).items()
    }


def _described(error: BaseException) -> str:
    """Kind and text of an error; an interrupt is the user's own and goes on."""
    if isinstance(error, KeyboardInterrupt):
        raise error
    return "".join(traceback.format_exception_only(error)[-1:]).strip()


def _checked(law: UserLaw, model: Callable[[], Model]) -> CommandFunction:
    """Explain what is wrong with a law instead of failing somewhere else."""
    function, setup = law.load()
    waiting = [setup] if setup else []

    def command(
        memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, gains: Law
    ) -> tuple[Array, Array, Array, Array]:
        # What a law does to its arguments must not reach the run.
        own = Memory(*(part.copy() for part in memory)), *(x.copy() for x in (q, q_d, dq_d, ddq_d)), gains
        try:
            with redirect_stdout(sys.stderr):
                while waiting:
                    waiting.pop()(model())
                found = function(*own)
                found = found if isinstance(found, tuple | list) else (found, None, None, None)
                # What the law does not have is NaN, and is left out of the trace.
                absent = np.full(q.shape, np.nan)
                parts = tuple(absent if part is None else np.array(part) for part in found)
        except BaseException as error:
            message = f"the law {law.name} failed: {_described(error)}"
            hint = CALLED if isinstance(error, TypeError) else None
            raise TendonreproError(message, where=law.place_of(error), hint=hint) from error
        if (
            len(parts) != 4
            or found[0] is None
            or any(part.shape != q.shape or part.dtype.kind not in "biuf" for part in parts)
        ):
            message = (
                f"the law {law.name} must return tau, or tau, H_hat, s and de, "
                f"each real numbers of shape {q.shape}"
            )
            raise TendonreproError(message, where=law.place_of(function))
        tau, H_hat, s, de = (part.astype(float) for part in parts)
        return tau, H_hat, s, de

    return command
