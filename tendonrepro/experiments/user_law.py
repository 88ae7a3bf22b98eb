"""A control law of the user's own, run beside the paper's on the same plant and reference."""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.files import sha256_of
from tendonrepro.physics.control import Law, Memory
from tendonrepro.simulation.controllers import CommandFunction, TimeDelayController
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
            found.loader.exec_module(module)
        except (Exception, SystemExit) as error:
            message = f"{self.path} cannot be run: {type(error).__name__}: {error}"
            raise UsageError(message, where="--law") from error
        function = getattr(module, self.name, None)
        if not callable(function):
            message = f"{self.path} has no function {self.name!r}"
            raise UsageError(message, where="--law")
        return cast(Callable[..., Any], function)


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


def add_user_law(law: UserLaw, loop: Loop) -> Loop:
    """Put a law into a run of the comparison in place of its own, whose gains it receives."""
    if not isinstance(loop.controller, TimeDelayController):
        message = "only the experiment compare takes a law"
        raise UsageError(message, where="--law")
    return replace(loop, controller=replace(loop.controller, command=_checked(law)))


def _checked(law: UserLaw) -> CommandFunction:
    """Explain what is wrong with a law instead of failing somewhere else."""
    function = law.load()

    def command(
        memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, gains: Law
    ) -> tuple[Array, Array, Array, Array]:
        where = f"{law.path}:{law.name}"
        try:
            parts = tuple(np.asarray(part, float) for part in function(memory, q, q_d, dq_d, ddq_d, gains))
        except (Exception, SystemExit) as error:
            message = f"the law failed: {type(error).__name__}: {error}"
            raise TendonreproError(message, where=where) from error
        if len(parts) != 4 or any(part.shape != q.shape for part in parts):
            message = f"the law must return tau, H_hat, s and de, each of shape {q.shape}"
            raise TendonreproError(message, where=where)
        return parts

    return command
