"""deepfield: pictures of huge point data, volumes and height fields, with an error that is guaranteed.

>>> import deepfield
>>> data = deepfield.open("box.df")
>>> picture = data.render(size=(120, 80), mode="column-density")
>>> picture.save("box.png")

docs/python.md in the project has a worked example.
"""

import atexit
import os

from ._deepfield import Error, after_fork_in_child, after_fork_in_parent, before_fork, wait_for_writers
from .building import build
from .camera import Camera
from .catalogues import catalogue
from .colors import color_map, color_maps, modes, transfer_functions
from .dataset import Data, Family, Field
from .notes import Note
from .objects import Scene, Tour, TransferFunction
from .opening import open
from .picture import Picture
from .questions import Histogram, PhaseDiagram, Probe
from .table import Table

# A script that ends right after Ctrl-C leaves nothing half-written.
atexit.register(wait_for_writers)
# A process that is forked while other threads draw would wait for ever for locks that they hold.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=before_fork, after_in_parent=after_fork_in_parent, after_in_child=after_fork_in_child)


def __getattr__(name):
    """Its version, when it is asked for: what looks it up takes a sixth of the time that importing takes."""
    if name != "__version__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("deepfield")
    except PackageNotFoundError:
        # A library in a folder of its own, without a wheel.
        return "0"


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
