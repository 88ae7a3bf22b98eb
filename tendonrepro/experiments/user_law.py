"""A control law of the user's own, run beside the paper's on the same plant and reference."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
import traceback
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.files import sha256_of
from tendonrepro.physics.control import Law, Memory
from tendonrepro.simulation.controllers import TimeDelayController
from tendonrepro.simulation.sampled import CommandFunction
from tendonrepro.simulation.stepper import Loop


@dataclass(frozen=True)
class UserLaw:
    """A function with the signature of :func:`tendonrepro.physics.control.command` in a Python file.

    Its name becomes that of the run.
    """

    path: Path
    name: str

    def digest_with(self, config_sha256: str) -> str:
        """Digest of a configuration together with this law."""
        return hashlib.sha256(f"{config_sha256} {sha256_of(self.path)} {self.name}".encode()).hexdigest()

    def load(self) -> Callable[..., Any]:
        """Run the file and return the function."""
        found = importlib.util.spec_from_file_location(self.path.stem, self.path)
        if found is None or found.loader is None:
            message = f"{self.path} is not a Python file"
            raise UsageError(message, where="--law")
        module = importlib.util.module_from_spec(found)
        try:
            # What a law prints is no result.
            with redirect_stdout(sys.stderr):
                found.loader.exec_module(module)
        except BaseException as error:
            message = f"cannot be run: {_described(error)}"
            raise UsageError(message, where=self.place_of(error)) from error
        function = getattr(module, self.name, None)
        if not callable(function):
            message = f"{self.path} has no function {self.name!r}"
            raise UsageError(message, where="--law")
        return cast(Callable[..., Any], function)

    def place_of(self, cause: BaseException | Callable[..., Any]) -> str:
        """``FILE:line`` of a function, or where an error arose; without the line where that is elsewhere."""
        if isinstance(cause, BaseException):
            lines = [(call.filename, call.lineno) for call in traceback.extract_tb(cause.__traceback__)]
            if isinstance(cause, SyntaxError):
                lines.append((cause.filename or "", cause.lineno))
        else:
            code = getattr(cause, "__code__", None)
            lines = [(code.co_filename, code.co_firstlineno)] if code else []
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
    return UserLaw(path, name)


def with_user_law(loaded: LoadedConfig, spec: str | None) -> tuple[LoadedConfig, UserLaw | None]:
    """Configuration whose digest and inputs know of the law that is asked for, if any, and that law."""
    if spec is None:
        return loaded, None
    law = find_user_law(spec)
    changed = replace(
        loaded,
        sha256=law.digest_with(loaded.sha256),
        overrides=(*loaded.overrides, f"law={spec}"),
        inputs=(*loaded.inputs, law.path),
    )
    return changed, law


def add_user_law(law: UserLaw, loop: Loop) -> Loop:
    """Put a law into a run of the comparison in place of its own, whose gains it receives."""
    if not isinstance(loop.controller, TimeDelayController):
        message = "only the experiment compare takes a law"
        raise UsageError(message, where="--law")
    return replace(loop, controller=replace(loop.controller, command=_checked(law)))


def _described(error: BaseException) -> str:
    """Kind and text of an error; an interrupt is the user's own and goes on."""
    if isinstance(error, KeyboardInterrupt):
        raise error
    return "".join(traceback.format_exception_only(error)[-1:]).strip()


def _checked(law: UserLaw) -> CommandFunction:
    """Explain what is wrong with a law instead of failing somewhere else."""
    function = law.load()

    def command(
        memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, gains: Law
    ) -> tuple[Array, Array, Array, Array]:
        # What a law does to its arguments must not reach the run.
        own = Memory(*(part.copy() for part in memory)), *(x.copy() for x in (q, q_d, dq_d, ddq_d)), gains
        try:
            with redirect_stdout(sys.stderr):
                parts = tuple(np.array(part) for part in function(*own))
        except BaseException as error:
            message = f"the law {law.name} failed: {_described(error)}"
            raise TendonreproError(message, where=law.place_of(error)) from error
        if len(parts) != 4 or any(part.shape != q.shape or part.dtype.kind not in "biuf" for part in parts):
            message = (
                f"the law {law.name} must return tau, H_hat, s and de, each real numbers of shape {q.shape}"
            )
            raise TendonreproError(message, where=law.place_of(function))
        tau, H_hat, s, de = (part.astype(float) for part in parts)
        return tau, H_hat, s, de

    return command
