import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from . import Data

__all__ = ["build", "cancel", "plan", "run", "status"]

def build(
    sources: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    client: Any = None,
    job: str | os.PathLike[str] | None = None,
    *,
    attributes: str | Iterable[str] | None = None,
    families: str | Iterable[str] | None = None,
    derive: str | Iterable[str] | None = None,
    hierarchy: str | Iterable[str] | None = None,
    smoothing: str | None = None,
    tasks: int | None = None,
    memory: int | str | None = None,
    threads: int | None = None,
    progress: Callable[[str, int, int], object] | bool | None = None,
    retries: int = 2,
    resources: Mapping[str, float] | None = None,
    keep: bool = False,
) -> Data: ...
def plan(
    sources: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    job: str | os.PathLike[str] | None = None,
    *,
    attributes: str | Iterable[str] | None = None,
    families: str | Iterable[str] | None = None,
    derive: str | Iterable[str] | None = None,
    hierarchy: str | Iterable[str] | None = None,
    smoothing: str | None = None,
    tasks: int | None = None,
) -> dict[str, Any]: ...
def run(
    job: str | os.PathLike[str], stage: str, task: int, *, memory: int | str | None = None, threads: int | None = None
) -> None: ...
def cancel(job: str | os.PathLike[str]) -> None: ...
def status(job: str | os.PathLike[str]) -> dict[str, Any]: ...
