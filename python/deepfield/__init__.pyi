import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path: TypeAlias = str | os.PathLike[str]
_Place: TypeAlias = Sequence[float]
_Progress: TypeAlias = Callable[[str, int, int], object]
_Setting: TypeAlias = bool | float | str | Sequence[float] | Sequence[str]

__version__: str

class Error(Exception): ...
class Note(UserWarning): ...

@dataclass
class Camera:
    eye: _Place | None = None
    target: _Place | None = None
    up: _Place | None = None
    fov: float | None = None
    ortho: float | None = None
    @staticmethod
    def of(camera: Camera | Mapping[str, Any] | None) -> Camera: ...
    def asked(self) -> dict[str, Any]: ...
    def to_ron(self) -> str: ...
    @staticmethod
    def from_ron(text: str) -> Camera: ...
    def write(self, path: _Path) -> None: ...
    @staticmethod
    def read(path: _Path) -> Camera: ...

@dataclass(frozen=True, eq=False)
class Histogram:
    counts: NDArray[np.uint64]
    edges: NDArray[np.float64]
    logarithmic: bool

@dataclass(frozen=True, eq=False)
class Field:
    name: str
    unit: str
    min: float | None
    max: float | None
    mean: float | None
    missing: int
    histogram: Histogram | None

@dataclass(frozen=True, eq=False)
class Family:
    name: str
    count: int
    mass: float | None
    bounds: NDArray[np.float64] | None
    fields: dict[str, Field]

class Picture:
    notes: list[str]
    about: dict[str, Any]
    mode: str
    attribute: str | None
    unit: str
    units: dict[str, str]
    extent: tuple[float, float, float, float] | None
    view: dict[str, NDArray[np.float64]]
    converged: bool
    @property
    def rgba(self) -> NDArray[np.uint8]: ...
    @property
    def channels(self) -> dict[str, NDArray[np.float32] | NDArray[np.float64]]: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def pixel_area(self) -> float | None: ...
    def png(self) -> bytes: ...
    def save(self, path: _Path) -> None: ...
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]: ...

class Data:
    paths: list[str]
    kind: str
    unit: str
    mass_unit: str
    count: int | None
    shape: tuple[int, ...]
    bounds: NDArray[np.float64] | None
    time: float | None
    redshift: float | None
    box_size: float | None
    steps: NDArray[np.float64] | None
    notes: list[str]
    families: dict[str, Family]
    def render(
        self,
        camera: Camera | Mapping[str, Any] | None = None,
        size: tuple[int, int] | None = None,
        mode: str | None = None,
        attribute: str | None = None,
        exact: bool = False,
        error_px: float | None = None,
        *,
        family: str | None = None,
        transfer: _Path | None = None,
        background: str | None = None,
        time: float | str | None = None,
        memory: int | str | None = None,
        config: _Path | None = None,
        progress: _Progress | None = None,
        **settings: _Setting,
    ) -> Picture: ...
    def probe(
        self,
        sphere: Sequence[float] | None = None,
        box: Sequence[float] | None = None,
        where: Mapping[str, tuple[float | None, float | None]] | None = None,
        families: Iterable[str] | None = None,
        *,
        fields: Iterable[str] | None = None,
        shells: int | None = None,
        shell_field: str | None = None,
        exact: bool = False,
        wrap: bool = True,
        time: float | str | None = None,
        progress: _Progress | None = None,
    ) -> dict[str, Any]: ...

def open(path: _Path | Iterable[_Path], progress: _Progress | None = None) -> Data: ...
def build(
    source: _Path | Iterable[_Path] | Mapping[str, ArrayLike] | Mapping[str, Mapping[str, ArrayLike]],
    out: _Path,
    memory: int | str | None = None,
    progress: _Progress | None = None,
    *,
    attributes: Iterable[str] | None = None,
    families: Iterable[str] | None = None,
    units: Mapping[str, str] | None = None,
    family: str = "gas",
    box_size: float | None = None,
    time: float | None = None,
    redshift: float | None = None,
) -> Data: ...
