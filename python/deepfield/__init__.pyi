import os
import subprocess
from collections.abc import Callable, Iterable, Iterator, KeysView, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NoReturn, Self, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path: TypeAlias = str | os.PathLike[str]
_Place: TypeAlias = Sequence[float]
_Progress: TypeAlias = Callable[[str, int, int], object] | bool
_Where: TypeAlias = Mapping[str, tuple[float | None, float | None]]
_Part: TypeAlias = slice | tuple[int, int]
_Setting: TypeAlias = bool | float | str | Sequence[float] | Sequence[str]

__all__ = [
    "Camera",
    "Data",
    "Error",
    "Family",
    "Field",
    "Histogram",
    "Note",
    "PhaseDiagram",
    "Picture",
    "Probe",
    "Scene",
    "Table",
    "Tour",
    "TransferFunction",
    "build",
    "catalogue",
    "color_map",
    "color_maps",
    "modes",
    "open",
    "transfer_functions",
]

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
    weights: NDArray[np.float64] | None = None
    field: str = ""
    unit: str = ""
    weight: str = "count"
    weight_unit: str = ""
    about: dict[str, Any] = ...

@dataclass(frozen=True, eq=False)
class PhaseDiagram:
    counts: NDArray[np.uint64]
    weights: NDArray[np.float64]
    x_edges: NDArray[np.float64]
    y_edges: NDArray[np.float64]
    fields: tuple[str, str]
    units: tuple[str, str]
    logarithmic: tuple[bool, bool]
    weight: str
    weight_unit: str
    about: dict[str, Any]

class Table:
    units: dict[str, str]
    about: dict[str, Any]
    def __init__(
        self,
        columns: Mapping[str, ArrayLike],
        units: Mapping[str, str] | None = None,
        words: Mapping[str, Sequence[str]] | None = None,
        about: Mapping[str, Any] | None = None,
    ) -> None: ...
    @property
    def columns(self) -> list[str]: ...
    def keys(self) -> KeysView[str]: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> Iterator[str]: ...
    def __contains__(self, name: object) -> bool: ...
    @overload
    def __getitem__(self, which: str) -> NDArray[Any]: ...
    @overload
    def __getitem__(self, which: int | slice | list[str] | list[int] | NDArray[Any]) -> Table: ...
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NoReturn: ...
    def to_pandas(self) -> Any: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...

class Probe(dict[str, Any]):
    @property
    def table(self) -> Table: ...

class _Text:
    path: str | None
    @classmethod
    def from_ron(cls, text: str, name: str | None = None) -> Self: ...
    def to_ron(self) -> str: ...
    @classmethod
    def read(cls, path: _Path) -> Self: ...
    def write(self, path: _Path) -> None: ...
    @property
    def fields(self) -> dict[str, Any]: ...
    def asked(self) -> dict[str, Any]: ...
    def replace(self, **changes: Any) -> Self: ...
    def __getattr__(self, name: str) -> Any: ...
    def __eq__(self, other: object) -> bool: ...
    __hash__: ClassVar[None]  # type: ignore[assignment]

class TransferFunction(_Text):
    def __init__(self, **fields: Any) -> None: ...
    @classmethod
    def named(cls, name: _Path) -> Self: ...

class Scene(_Text):
    def __init__(self, data: Data | _Path | Iterable[_Path] | None = None, **fields: Any) -> None: ...
    def open(self, progress: _Progress | None = None, *, threads: int | None = None, memory: int | str | None = None) -> Data: ...
    def render(
        self,
        camera: Camera | Mapping[str, Any] | None = None,
        size: tuple[int, int] | None = None,
        **settings: Any,
    ) -> Picture: ...

class Tour(_Text):
    def __init__(self, **fields: Any) -> None: ...
    @classmethod
    def around(cls, seconds: float = 10.0) -> Self: ...
    def render(
        self,
        data: Data,
        out: _Path,
        size: tuple[int, int] | None = None,
        fps: float | None = None,
        *,
        start: float | None = None,
        end: float | None = None,
        pattern: str | None = None,
        error_px: float | None = None,
        memory: int | str | None = None,
        threads: int | None = None,
        progress: _Progress | None = None,
    ) -> list[str]: ...
    def scene(
        self, data: Data, time: float, size: tuple[int, int] | None = None, progress: _Progress | None = None
    ) -> Scene: ...
    def picture(
        self,
        data: Data,
        time: float,
        size: tuple[int, int] | None = None,
        progress: _Progress | None = None,
        **settings: Any,
    ) -> Picture: ...

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
    def imshow(self, ax: Any = None, channel: str | None = None, colorbar: bool = True, **settings: Any) -> Any: ...
    def show(self, ax: Any = None, **settings: Any) -> Any: ...
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
    modes: list[str]
    attributes: list[str]
    families: dict[str, Family]
    scene: Scene | None
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
        families: str | Iterable[str] | None = None,
        transfer: TransferFunction | Mapping[str, Any] | _Path | None = None,
        color_map: str | Sequence[tuple[float, str]] | None = None,
        color_scale: Literal["log", "linear"] | None = None,
        background: str | None = None,
        time: float | str | None = None,
        interpolation: str | None = None,
        annotations: bool | Mapping[str, Any] | None = None,
        cut: Mapping[str, Any] | None = None,
        selections: Sequence[Mapping[str, Any]] | None = None,
        paths: Mapping[str, Any] | None = None,
        projection: str | Mapping[str, Any] | None = None,
        stereo: Mapping[str, Any] | None = None,
        catalogue: _Path | None = None,
        exposure: str | Mapping[str, Any] | None = None,
        bloom: Mapping[str, Any] | None = None,
        memory: int | str | None = None,
        threads: int | None = None,
        config: _Path | None = None,
        scene: Scene | Mapping[str, Any] | _Path | None = None,
        progress: _Progress | None = None,
        **settings: _Setting,
    ) -> Picture: ...
    def widget(
        self,
        mode: str | None = None,
        attribute: str | None = None,
        size: tuple[int, int] = (720, 480),
        camera: Camera | Mapping[str, Any] | None = None,
        time: float | str | None = None,
        *,
        error_px: float = 0.8,
        budget: float = 0.1,
        **asked: Any,
    ) -> Any: ...
    def view(self, **fields: Any) -> subprocess.Popen[bytes]: ...
    def probe(
        self,
        sphere: Sequence[float] | None = None,
        box: Sequence[float] | None = None,
        where: _Where | None = None,
        families: str | Iterable[str] | None = None,
        *,
        at: str | None = None,
        radius: float | None = None,
        fields: str | Iterable[str] | None = None,
        shells: int | None = None,
        shell_field: str | None = None,
        exact: bool = False,
        wrap: bool = True,
        time: float | str | None = None,
        threads: int | None = None,
        progress: _Progress | None = None,
    ) -> Probe: ...
    def select(
        self,
        sphere: Sequence[float] | None = None,
        box: Sequence[float] | None = None,
        ids: ArrayLike | None = None,
        where: _Where | None = None,
        families: str | Iterable[str] | None = None,
        fields: str | Iterable[str] | None = None,
        *,
        at: str | None = None,
        radius: float | None = None,
        exact: bool = False,
        wrap: bool = True,
        time: float | str | None = None,
        memory: int | str | None = None,
        threads: int | None = None,
        progress: _Progress | None = None,
    ) -> Table: ...
    def export(
        self,
        path: _Path,
        sphere: Sequence[float] | None = None,
        box: Sequence[float] | None = None,
        ids: ArrayLike | None = None,
        where: _Where | None = None,
        families: str | Iterable[str] | None = None,
        *,
        at: str | None = None,
        radius: float | None = None,
        frame: Literal["comoving", "physical"] | None = None,
        exact: bool = False,
        wrap: bool = True,
        time: float | str | None = None,
        threads: int | None = None,
        progress: _Progress | None = None,
    ) -> int: ...
    def tracks(
        self,
        sphere: Sequence[float] | None = None,
        box: Sequence[float] | None = None,
        ids: ArrayLike | None = None,
        where: _Where | None = None,
        families: str | Iterable[str] | None = None,
        fields: str | Iterable[str] | None = None,
        *,
        at: str | None = None,
        radius: float | None = None,
        start: float | str | None = None,
        end: float | str | None = None,
        memory: int | str | None = None,
        threads: int | None = None,
        progress: _Progress | None = None,
    ) -> Table: ...
    def histogram(
        self,
        field: str,
        bins: int = 100,
        weight: str = "mass",
        range: Sequence[float] | None = None,
        log: bool | None = None,
        *,
        at: str | None = None,
        radius: float | None = None,
        sphere: Sequence[float] | None = None,
        box: Sequence[float] | None = None,
        where: _Where | None = None,
        families: str | Iterable[str] | None = None,
        exact: bool = False,
        wrap: bool = True,
        time: float | str | None = None,
        error: float | None = None,
        threads: int | None = None,
        progress: _Progress | None = None,
    ) -> Histogram: ...
    def phase(
        self,
        x: str,
        y: str,
        bins: int | tuple[int, int] = (256, 256),
        weight: str = "mass",
        ranges: Sequence[Sequence[float] | None] = (None, None),
        log: bool | tuple[bool | None, bool | None] | None = None,
        *,
        at: str | None = None,
        radius: float | None = None,
        sphere: Sequence[float] | None = None,
        box: Sequence[float] | None = None,
        where: _Where | None = None,
        families: str | Iterable[str] | None = None,
        exact: bool = False,
        wrap: bool = True,
        time: float | str | None = None,
        error: float | None = None,
        threads: int | None = None,
        progress: _Progress | None = None,
    ) -> PhaseDiagram: ...
    def profile(
        self,
        sphere: Sequence[float] | None = None,
        shells: int = 50,
        fields: str | Iterable[str] = (),
        log: bool = True,
        *,
        at: str | None = None,
        radius: float | None = None,
        box: Sequence[float] | None = None,
        where: _Where | None = None,
        families: str | Iterable[str] | None = None,
        exact: bool = False,
        wrap: bool = True,
        time: float | str | None = None,
        error: float | None = None,
        threads: int | None = None,
        progress: _Progress | None = None,
    ) -> Table: ...
    def array(
        self, level: int = 0, stored: bool = False, *, memory: int | str | None = None, progress: _Progress | None = None
    ) -> NDArray[Any]: ...
    @overload
    def heights(
        self,
        rows: _Part | None = None,
        columns: _Part | None = None,
        coordinates: Literal[False] = False,
        *,
        memory: int | str | None = None,
        progress: _Progress | None = None,
    ) -> NDArray[np.float64]: ...
    @overload
    def heights(
        self,
        rows: _Part | None = None,
        columns: _Part | None = None,
        *,
        coordinates: Literal[True],
        memory: int | str | None = None,
        progress: _Progress | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...

def catalogue(
    path: _Path,
    fields: str | Iterable[str] | None = None,
    *,
    time: float | str | None = None,
    memory: int | str | None = None,
    progress: _Progress | None = None,
) -> Table: ...
def color_map(name: str, count: int = 256) -> NDArray[np.float32]: ...
def color_maps() -> dict[str, str]: ...
def modes() -> list[str]: ...
def transfer_functions() -> list[str]: ...
def open(
    path: _Path | Mapping[str, Any] | Iterable[_Path | Mapping[str, Any]],
    progress: _Progress | None = None,
    *,
    kind: Literal["heights", "image", "particles"] | None = None,
    nodata: float | None = None,
    spacing: Sequence[float] | None = None,
    xy_unit: str | None = None,
    height_unit: str | None = None,
    texture: _Path | None = None,
    texture_at: Sequence[float] | None = None,
    before: _Path | None = None,
    derive: str | Iterable[str] | None = None,
    threads: int | None = None,
    memory: int | str | None = None,
) -> Data: ...
def build(
    source: _Path | Iterable[_Path] | Mapping[str, ArrayLike] | Mapping[str, Mapping[str, ArrayLike]] | Any,
    out: _Path,
    memory: int | str | None = None,
    progress: _Progress | None = None,
    *,
    attributes: str | Iterable[str] | None = None,
    families: str | Iterable[str] | None = None,
    derive: str | Iterable[str] | None = None,
    hierarchy: str | Iterable[str] | None = None,
    smoothing: str | None = None,
    height_error: float | None = None,
    kind: Literal["heights", "image", "particles"] | None = None,
    nodata: float | None = None,
    spacing: Sequence[float] | None = None,
    xy_unit: str | None = None,
    height_unit: str | None = None,
    texture: _Path | None = None,
    texture_at: Sequence[float] | None = None,
    shape: Sequence[int] | None = None,
    type: str | None = None,
    big_endian: bool = False,
    channels: int = 1,
    skip: int = 0,
    times: str | Iterable[float] | None = None,
    every: int | None = None,
    skip_damaged: bool = False,
    threads: int | None = None,
    units: Mapping[str, str] | None = None,
    family: str = "gas",
    box_size: float | None = None,
    time: float | None = None,
    redshift: float | None = None,
) -> Data: ...
