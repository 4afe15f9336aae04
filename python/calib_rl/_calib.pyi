"""What `python/src` compiles to. Users call `calib_rl`."""

from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._progress import Observer

__all__ = [
    "Job",
    "Model",
    "Score",
    "Streams",
    "Walkers",
    "__version__",
    "dtw",
    "evaluate_runs",
    "knn_join",
    "main",
    "set_threads",
    "simulate",
    "to_toml",
    "write_log",
]

__version__: str

_Seen = tuple[
    NDArray[np.float32],
    NDArray[np.float64],
    NDArray[np.bool_],
    NDArray[np.int64],
    NDArray[np.int64],
    NDArray[np.float32],
]

@final
class Job:
    def __new__(
        cls,
        path: str,
        text: str | None = None,
        *,
        set: list[str] = ...,
        profile: str | None = None,
        model: str | None = None,
        deployment: str | None = None,
        output: str | None = None,
        redo: bool = False,
    ) -> Job: ...
    def step(self, /, name: str, observer: Observer | None = None) -> str: ...
    def path(self, /, of: str) -> str: ...
    def json(self, /) -> str: ...
    def command(self, /, step: str) -> str: ...

@final
class Model:
    @staticmethod
    def open(directory: str) -> Model: ...
    @staticmethod
    def of_job(job: Job) -> Model: ...
    @staticmethod
    def build(
        states: ArrayLike, segments: list[int] | None, options: dict[str, Any], observer: Observer | None = None
    ) -> Model: ...
    @property
    def directory(self) -> str | None: ...
    @property
    def members(self) -> int: ...
    @property
    def k(self) -> int: ...
    @property
    def seed(self) -> int: ...
    @property
    def period(self) -> float | None: ...
    @property
    def columns(self) -> list[tuple[str, float, float]]: ...
    def states(self, /) -> NDArray[np.float32]: ...
    def times(self, /) -> NDArray[np.int64] | None: ...
    def segments(self, /) -> list[int]: ...
    def sources(self, /) -> NDArray[np.uint32]: ...
    def neighbors(self, /, member: int) -> NDArray[np.uint32]: ...
    def distances(self, /, member: int) -> NDArray[np.float32]: ...
    def transitions(self, /, member: int) -> NDArray[np.uint32]: ...
    def rollout(
        self,
        /,
        member: int,
        count: int,
        steps: int,
        rows: list[int] | None = None,
        seed: int | None = None,
        observer: Observer | None = None,
    ) -> NDArray[np.uint32]: ...
    def nearest(self, /, states: ArrayLike, k: int, member: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]: ...
    def walkers(
        self, /, members: list[int], columns: list[int], reward: int, steps: int, physical: bool
    ) -> Walkers: ...
    def extremes(self, /) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...

@final
class Walkers:
    def seed(self, /, seeds: list[int | None]) -> None: ...
    def reset(self, /, which: NDArray[np.bool_] | None = None) -> _Seen: ...
    def step(self, /) -> _Seen: ...
    def step_one(self, /) -> tuple[NDArray[np.float32], float, bool, int, int, float]: ...

@final
class Streams:
    @staticmethod
    def of_job(job: Job, observer: Observer | None = None) -> Streams: ...
    def runs(self, /) -> list[tuple[str, int, int, int, str, int]]: ...
    def sensors(self, /) -> list[tuple[str, int]]: ...
    @property
    def gamma(self) -> float: ...
    @property
    def part(self) -> str: ...
    def states(self, /, stream: int) -> tuple[NDArray[np.float32], list[tuple[int, int]]]: ...
    def score(
        self, /, stream: int, sensor: str, candidate: int, predictions: ArrayLike, updates: int
    ) -> Score: ...
    def write(self, /, path: str, candidates: list[tuple[str, bool]], scores: list[Score]) -> None: ...

@final
class Score:
    @property
    def nrmse(self) -> float: ...

def evaluate_runs(
    runs: str, job: Job | None = None, output: str | None = None, observer: Observer | None = None
) -> str: ...
def to_toml(of: Any) -> str: ...
def write_log(stream: Any, path: str) -> tuple[int, int]: ...
def knn_join(
    points: ArrayLike,
    k: int,
    queries: ArrayLike | None = None,
    exclude_self: bool = False,
    index: str = "auto",
    observer: Observer | None = None,
) -> tuple[NDArray[np.uint32], NDArray[np.float32]]: ...
def dtw(
    query: ArrayLike,
    reference: ArrayLike,
    step_pattern: str,
    local_distance: str,
    window: str,
    ends: str,
    path: bool,
) -> tuple[float, float | None, int, NDArray[np.int64] | None]: ...
def simulate(directory: str, options: dict[str, Any], force: bool = False, observer: Observer | None = None) -> str: ...
def set_threads(threads: int) -> None: ...
def main(arguments: list[str]) -> int: ...
