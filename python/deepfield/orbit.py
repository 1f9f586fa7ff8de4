"""How a camera moves when a picture is dragged."""

import math

import numpy as np

from ._deepfield import Error
from .camera import Camera

# The nearest that the line of sight comes to the axis that it turns about.
_POLE = math.radians(1.0)
# The smallest and the largest height of the picture, in the first one's.
_SPAN = (1e-7, 1e4)


class Orbit:
    """A camera that turns about a target, moves along the picture, and comes nearer to what is under the cursor.

    Places in the picture are pixels from its upper left corner, of a picture of ``size``; what is under the cursor lies in the plane through
    the target across the line of sight. ``up`` is the axis that dragging to the side turns about.

    >>> from deepfield.orbit import Orbit
    >>> orbit = Orbit(eye=(0, 0, 10), target=(0, 0, 0), up=(0, 1, 0), fov=None, ortho=4.0, size=(200, 100))
    >>> orbit.zoom(0.5, 150, 50)
    >>> orbit.camera().ortho, orbit.camera().target
    (2.0, (1.0, 0.0, 0.0))
    """

    def __init__(self, eye, target, up, fov, ortho, size):
        self.eye, self.target, self.up = (np.array(place, dtype=float) for place in (eye, target, up))
        self.fov, self.ortho, self.size = fov, ortho, size
        self._first = self.span()

    @staticmethod
    def of(view, fov, extent, camera, bounds, usual_up, size):
        """The camera that a picture of ``view`` and either ``fov`` or ``extent`` was drawn with, about the target of ``camera`` or the middle of
        the data.

        The axis is ``camera.up`` or ``usual_up``, unless the picture has another one upright.
        """
        eye, forward, upright = (view[name] for name in ("eye", "forward", "up"))
        center = camera.target if camera.target is not None else None if bounds is None else bounds.mean(axis=0)
        if center is None:
            raise Error("widget: camera: target: found none, expected one: the data has no bounds of its own")
        away = (np.array(center) - eye) @ forward
        if not away > 0:
            away = np.linalg.norm(np.ptp(bounds, axis=0)) if bounds is not None else 1.0
        up = np.array(camera.up if camera.up is not None else usual_up, dtype=float)
        across = up - (up @ forward) * forward
        length = np.linalg.norm(across)
        if length < math.sin(_POLE) * np.linalg.norm(up) or across @ upright < 0.999 * length:
            up = upright
        ortho = None if extent is None else extent[3] - extent[2]
        return Orbit(eye, eye + away * forward, up, fov if ortho is None else None, ortho, size)

    def camera(self):
        """The camera as it stands."""
        places = {name: tuple(getattr(self, name).tolist()) for name in ("eye", "target", "up")}
        return Camera(**places, fov=self.fov, ortho=self.ortho)

    def axes(self):
        """What is right, up and forward in the picture: unit vectors."""
        forward = _unit(self.target - self.eye)
        right = _unit(np.cross(forward, self.up))
        return right, np.cross(right, forward), forward

    def span(self):
        """The height of the picture at the target, in the data's unit."""
        if self.ortho is not None:
            return self.ortho
        return 2.0 * np.linalg.norm(self.target - self.eye) * math.tan(math.radians(self.fov) / 2.0)

    def pixel(self):
        """The edge of a pixel at the target, in the data's unit."""
        return self.span() / self.size[1]

    def place(self, x, y):
        """What is under the cursor."""
        right, up, _ = self.axes()
        width, height = self.size
        return self.target + self.pixel() * ((x - width / 2.0) * right + (height / 2.0 - y) * up)

    def turn(self, x, y):
        """Turns about the target by a drag of so many pixels: the picture's height is half a turn."""
        right, _, _ = self.axes()
        offset, axis = self.eye - self.target, _unit(self.up)
        distance = np.linalg.norm(offset)
        pole = math.acos(np.clip(offset @ axis / distance, -1.0, 1.0))
        least = min(_POLE, pole, math.pi - pole)
        lifted = np.clip(pole - y * math.pi / self.size[1], least, math.pi - least) - pole
        offset = _turned(_turned(offset, right, lifted), axis, -x * math.pi / self.size[1])
        # Rounding adds up over a thousand drags.
        self.eye = self.target + distance * _unit(offset)

    def pan(self, x, y):
        """Moves what is under the cursor by so many pixels, and all that is as far with it."""
        right, up, _ = self.axes()
        moved = self.pixel() * (y * up - x * right)
        self.eye, self.target = self.eye + moved, self.target + moved

    def zoom(self, factor, x, y):
        """Scales the height of the picture, and leaves what is under the cursor where it is."""
        factor = np.clip(factor, _SPAN[0] * self._first / self.span(), _SPAN[1] * self._first / self.span())
        fixed = self.place(x, y)
        self.eye, self.target = (fixed + factor * (place - fixed) for place in (self.eye, self.target))
        if self.ortho is not None:
            self.ortho = float(self.ortho * factor)


def _unit(vector):
    return vector / np.linalg.norm(vector)


def _turned(vector, axis, angle):
    """Rodrigues' rotation about a unit vector."""
    along = (axis @ vector) * axis
    return along + math.cos(angle) * (vector - along) + math.sin(angle) * np.cross(axis, vector)
