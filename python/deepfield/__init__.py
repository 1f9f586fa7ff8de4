"""deepfield: pictures of huge point data, volumes and height fields, with an error that is guaranteed.

>>> import deepfield
>>> data = deepfield.open("snapshot_099.hdf5")          # doctest: +SKIP
>>> picture = data.render(mode="column-density")        # doctest: +SKIP
>>> picture.save("box.png")                             # doctest: +SKIP

docs/python.md in the project has a worked example.
"""

from importlib.metadata import PackageNotFoundError, version as _version

from ._deepfield import Error
from .building import build
from .camera import Camera
from .dataset import Data, Family, Field, Histogram, open
from .notes import Note
from .picture import Picture

try:
    __version__ = _version("deepfield")
except PackageNotFoundError:
    # A library in a folder of its own, without a wheel.
    __version__ = "0"

__all__ = ["Camera", "Data", "Error", "Family", "Field", "Histogram", "Note", "Picture", "build", "open"]
