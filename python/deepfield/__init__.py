"""deepfield: pictures of huge point data, volumes and height fields, with an error that is guaranteed.

>>> import deepfield
>>> data = deepfield.open("box.df")
>>> picture = data.render(size=(120, 80), mode="column-density")
>>> picture.save("box.png")

docs/python.md in the project has a worked example.
"""

from importlib.metadata import PackageNotFoundError, version as _version

from ._deepfield import Error
from .building import build
from .camera import Camera
from .colors import color_map, color_maps, modes, transfer_functions
from .dataset import Data, Family, Field, open
from .notes import Note
from .objects import Scene, Tour, TransferFunction
from .picture import Picture
from .questions import Histogram, PhaseDiagram
from .table import Table

try:
    __version__ = _version("deepfield")
except PackageNotFoundError:
    # A library in a folder of its own, without a wheel.
    __version__ = "0"

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
    "Scene",
    "Table",
    "Tour",
    "TransferFunction",
    "build",
    "color_map",
    "color_maps",
    "modes",
    "open",
    "transfer_functions",
]
