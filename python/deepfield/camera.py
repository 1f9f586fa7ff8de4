"""Where a camera stands."""

import dataclasses
import math
import re
from collections.abc import Mapping

from . import files
from ._deepfield import Error

_FIELDS = ("eye", "target", "up", "fov", "ortho")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclasses.dataclass
class Camera:
    """A camera, in the data's length unit. What is None is chosen so that all of the data is in view.

    ``fov`` is the vertical field of view of a perspective camera, degrees [45]; ``ortho`` the height of a picture with parallel lines of
    sight. The text of :meth:`to_ron` is that of the field ``camera`` in scenes and configurations.

    >>> camera = deepfield.Camera(eye=(0, 0, 9), target=(0, 0, 0), ortho=2)
    >>> camera.to_ron()
    '(eye: (0.0, 0.0, 9.0), target: (0.0, 0.0, 0.0), ortho: Some(2.0))'
    >>> deepfield.Camera.from_ron(camera.to_ron()) == camera
    True
    """

    eye: tuple | None = None
    target: tuple | None = None
    up: tuple | None = None
    fov: float | None = None
    ortho: float | None = None

    def __post_init__(self):
        for name in ("eye", "target", "up"):
            value = getattr(self, name)
            if value is None:
                continue
            try:
                place = tuple(float(number) for number in value)
            except (TypeError, ValueError):
                place = ()
            if len(place) != 3 or not all(map(math.isfinite, place)):
                raise Error(f"camera: {name}: found {value!r}, expected three numbers")
            setattr(self, name, place)
        for name in ("fov", "ortho"):
            value = getattr(self, name)
            if value is not None:
                try:
                    number = float(value)
                except (TypeError, ValueError):
                    number = math.nan
                if not math.isfinite(number):
                    raise Error(f"camera: {name}: found {value!r}, expected a number")
                setattr(self, name, number)
        if self.fov is not None and self.ortho is not None:
            raise Error("camera: found fov and ortho, expected one of them")

    @staticmethod
    def of(camera):
        """A camera of a Camera, a mapping of its fields, or None."""
        if camera is None:
            return Camera()
        if isinstance(camera, Camera):
            return camera
        if not isinstance(camera, Mapping):
            raise Error(f"camera: found {camera!r:.60}, expected a Camera, or a mapping of some of {', '.join(_FIELDS)}")
        unknown = [name for name in camera if name not in _FIELDS]
        if unknown:
            raise Error(f"camera: found {unknown[0]}, expected one of {', '.join(_FIELDS)}")
        return Camera(**camera)

    def asked(self):
        """What it says."""
        return {name: getattr(self, name) for name in _FIELDS if getattr(self, name) is not None}

    def to_ron(self):
        """Its text in RON."""
        place = lambda numbers: "(" + ", ".join(repr(number) for number in numbers) + ")"
        parts = [f"{name}: {place(getattr(self, name))}" for name in _FIELDS[:3] if getattr(self, name) is not None]
        parts += [f"fov: {self.fov!r}"] if self.fov is not None else []
        parts += [f"ortho: Some({self.ortho!r})"] if self.ortho is not None else []
        return "(" + ", ".join(parts) + ")"

    @staticmethod
    def from_ron(text):
        """The camera of such a text. Where a scene says both, the parallel lines of sight hold."""
        bare = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL).strip()
        value = rf"\(?\s*{_NUMBER}\s*(?:,\s*{_NUMBER}\s*)*,?\s*\)?"
        field = rf"(\w+)\s*:\s*(?:Some\(\s*({value})\s*\)|({value})|(None))\s*(?:,|$)\s*"
        inner = bare[1:-1].strip() if bare.startswith("(") and bare.endswith(")") else None
        found, at = {}, 0
        while inner is not None and at < len(inner):
            part = re.compile(field).match(inner, at)
            if part is None or part[1] not in _FIELDS:
                what = inner[at : at + 24].splitlines()[0]
                raise Error(f"camera: found {what!r}, expected fields of ({', '.join(_FIELDS)})")
            numbers = tuple(float(number) for number in re.findall(_NUMBER, part[2] or part[3] or ""))
            if numbers:
                found[part[1]] = numbers if part[1] in _FIELDS[:3] else numbers[0]
            at = part.end()
        if inner is None:
            raise Error("camera: expected RON such as (eye: (0.0, 0.0, 50.0), target: (0.0, 0.0, 0.0), fov: 45.0)")
        if "ortho" in found:
            found.pop("fov", None)
        return Camera(**found)

    def write(self, path):
        """Writes its text to a file, over none but one in RON."""
        files.write(path, self.to_ron())

    @staticmethod
    def read(path):
        """Reads such a file."""
        return Camera.from_ron(files.read(path))
