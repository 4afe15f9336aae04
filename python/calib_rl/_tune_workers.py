"""Processes of `calib_rl.tune`. Each runs one unit after the other."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ._acting import ActionModel

if TYPE_CHECKING:
    from ._tune_unit import Unit


def _packer() -> Callable[[Any], bytes]:
    """Returns a function that pickles values. If possible it packs functions of the program itself, and of notebooks, by value."""
    try:
        import cloudpickle
    except ImportError:
        return pickle.dumps
    packer: Callable[[Any], bytes] = cloudpickle.dumps
    return packer


def message_for(make_agent: Callable[..., Any], model: ActionModel, environment: Mapping[str, Any]) -> str:
    """Returns the first message to a process."""
    if _packer() is pickle.dumps and getattr(make_agent, "__module__", None) == "__main__":
        raise TypeError(
            "make_agent is defined in the program itself, and other processes cannot import that; install cloudpickle, define it in a module "
            "that can be imported, or take processes=1"
        )
    try:
        packed = _packer()((make_agent, str(model.path), dict(environment)))
    except Exception as error:
        raise TypeError(f"make_agent cannot be given to other processes ({error}); see that what it refers to can be pickled, or take processes=1") from error
    text = packed.hex()
    return f"{json.dumps(sys.path)}\n{len(text)}\n{text}\n"


class Worker:
    """A process that runs one unit after the other."""

    def __init__(self, message: str) -> None:
        # Each unit runs on one processor, so that its sums do not depend on other work.
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"), "1")
        # Ctrl-C reaches every process of a terminal. The parent ends this one, and alone tells of it.
        # The imports take a second, after which the parent may be gone.
        begin = "import os, signal; signal.signal(signal.SIGINT, signal.SIG_IGN); parent = os.getppid(); from calib_rl._tune_unit import main; main(parent)"
        command = [sys.executable, "-c", begin]
        path = os.pathsep.join(folder for folder in sys.path if folder)
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8", env={**os.environ, **threads, "PYTHONPATH": path}
        )
        self._send(message)

    def _send(self, text: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(text)
            self._process.stdin.flush()
        except OSError:
            pass  # it has ended, which its answer tells

    def run(self, unit: Unit) -> dict[str, Any] | None:
        """Returns the result of a unit. ``None`` if the process ended."""
        try:
            text = _packer()(vars(unit)).hex()
        except Exception as error:
            return {"place": "make_agent", "error": f"a value of the setting cannot be given to other processes: {error}", "trace": ""}
        self._send(text + "\n")
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        came: dict[str, Any] | None = json.loads(line) if line.endswith("\n") else None
        return came

    def ended(self) -> str:
        """Returns how the process ended."""
        self.close()
        code = self._process.returncode
        return f"signal {-code}, as where memory runs out" if code < 0 else f"exit code {code}"

    def close(self) -> None:
        """Let the process end."""
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.close()
        except OSError:
            pass
        self._process.wait()
        self._process.stdout.close()

    def kill(self) -> None:
        """Kill the process now. The caller that waits for its answer closes it."""
        self._process.kill()
