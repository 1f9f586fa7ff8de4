"""A picture in a notebook that is turned, dragged and asked."""

import dataclasses
import math
import pathlib
import threading
import time as clock

from . import asked as asking
from ._deepfield import Error
from .camera import Camera
from .colors import color_maps
from .orbit import Orbit


class Pace:
    """How coarse pictures are while the view moves, so that one takes about ``budget`` seconds: by how long those before it took.

    Its effort is the share of a finished picture's: fewer pixels first, then a larger error.

    >>> pace = Pace(budget=0.1)
    >>> pace.effort = 1 / 16
    >>> pace.plan((800, 600), 0.8)
    ((200, 150), 0.8)
    >>> pace.took(0.2)
    >>> pace.effort
    0.03125
    """

    # Of the sides of a finished picture.
    SMALLEST = 1.0 / 6.0
    # Of its error.
    COARSEST = 8.0

    def __init__(self, budget):
        self.budget = budget
        self.effort = 1.0 / 16.0

    def plan(self, size, error_px):
        """Size and error of the next picture."""
        side = math.sqrt(self.effort)
        scale = max(side, self.SMALLEST)
        return tuple(max(1, round(scale * pixels)) for pixels in size), error_px * (scale / side)

    def took(self, seconds):
        """Learns how long a picture of that plan took."""
        ratio = min(max(self.budget / max(seconds, 1e-6), 0.25), 2.0)
        least = (self.SMALLEST / self.COARSEST) ** 2
        self.effort = min(max(self.effort * ratio, least), 1.0)


class _Superseded(Exception):
    """The view has changed while a picture of it was drawn."""


@dataclasses.dataclass
class _Look:
    """What is drawn, but for the camera."""

    mode: str | None
    attribute: str | None
    color_map: str | None
    color_scale: str | None
    time: float | str | None


class Viewer:
    """Pictures for somebody who moves the view: what the widget does, without a browser.

    ``send`` is called with messages and their buffers, from a thread that lives while there is something to draw; :meth:`receive` takes
    those of the browser. While the view moves pictures are as coarse as :class:`Pace` says; ``rest`` seconds after that one is drawn of
    ``size`` pixels with ``error_px``.
    """

    def __init__(
        self,
        data,
        send,
        *,
        mode=None,
        attribute=None,
        color_map=None,
        color_scale=None,
        size=(720, 480),
        camera=None,
        time=None,
        error_px=0.8,
        budget=0.1,
        rest=0.25,
        **asked,
    ):
        self._data, self._send = data, send
        self._look = _Look(mode, attribute, color_map, color_scale, time)
        self._asked = asked
        self.size = tuple(asking.size(size))
        if min(self.size) < 1:
            raise Error(f"size: found {size!r}, expected width and height, pixels")
        self._error_px, self._rest = error_px, rest
        self._pace = Pace(budget)
        self._camera = Camera.of(camera)
        self._orbit = None
        self.picture = None
        # What follows is what the two threads share.
        self._changed = threading.Condition()
        self._version, self._since = 0, 0.0
        self._coarse = self._finished = -1
        self._picks = []
        self._worker = None

    @property
    def camera(self):
        """The camera as it stands: what ``data.render(camera=...)`` takes."""
        with self._changed:
            return self._camera if self._orbit is None else self._orbit.camera()

    def about(self):
        """What the browser has to know before there is a picture."""
        data = self._data
        modes = list(data.modes)
        if self._look.mode is not None and self._look.mode not in modes:
            modes.insert(0, self._look.mode)
        return {
            "size": list(self.size),
            "modes": modes,
            "attributes": data.attributes,
            "mode": self._look.mode,
            "attribute": self._look.attribute,
            "color_maps": list(color_maps()),
            # Colours of one's own have no name.
            "color_map": self._look.color_map if isinstance(self._look.color_map, str) else None,
            "color_scale": self._look.color_scale,
            "times": [] if data.steps is None else [float(time) for time in data.steps],
            "time": self._look.time if isinstance(self._look.time, (int, float)) else None,
            "flat": data.kind == "image",
            "unit": data.unit,
        }

    def receive(self, message):
        """Does what a message of the browser says; what makes no sense is answered with an error."""
        try:
            asked = message.get("do") if isinstance(message, dict) else None
            work = _MESSAGES.get(asked) if isinstance(asked, str) else None
            if work is None:
                raise Error(f"widget: do: found {asked!r:.60}, expected one of {', '.join(_MESSAGES)}")
            with self._changed:
                work(self, message)
                if self._worker is None:
                    self._worker = threading.Thread(target=self._work, name="deepfield widget")
                    self._worker.start()
                self._changed.notify_all()
        except Error as error:
            self._tell(error)

    def wait(self, seconds=None):
        """Waits until everything that was asked for is drawn; whether it is."""
        with self._changed:
            return self._changed.wait_for(lambda: self._worker is None, seconds)

    def _tell(self, error):
        self._send({"kind": "error", "text": str(error)}, [])

    # Messages. Each is called with the lock held.

    def _move(self, change):
        # Before the first picture there is nothing to be dragged.
        if self._orbit is not None:
            change(self._orbit)
            self._renew()

    def _renew(self):
        self._version += 1
        self._since = clock.monotonic()

    def _begin(self, message):
        self._coarse = self._finished = -1
        self._renew()

    def _home(self, message):
        self._orbit = None
        self._renew()

    def _turn(self, message):
        x, y = _numbers(message, "x", "y")
        self._move(lambda orbit: orbit.turn(x, y))

    def _pan(self, message):
        x, y = _numbers(message, "x", "y")
        self._move(lambda orbit: orbit.pan(x, y))

    def _zoom(self, message):
        factor, x, y = _numbers(message, "factor", "x", "y")
        if not factor > 0.0:
            raise Error(f"widget: zoom: factor: found {factor}, expected a number greater than 0")
        self._move(lambda orbit: orbit.zoom(factor, x, y))

    def _choose(self, message):
        known = {"mode": str, "attribute": str, "color_map": str, "color_scale": str, "time": (int, float, str)}
        for name, kind in known.items():
            if name in message:
                value = message[name]
                if value is not None and (not isinstance(value, kind) or isinstance(value, bool)):
                    raise Error(f"widget: {name}: found {value!r:.60}, expected a name, a time or nothing")
                setattr(self._look, name, value)
        self._renew()

    def _pick(self, message):
        self._picks.append(_numbers(message, "x", "y"))

    # The thread.

    def _work(self):
        """Does what is asked for, newest first, and ends when all is done."""
        try:
            while self._does_next():
                pass
        except BaseException:
            with self._changed:
                self._end()
            raise

    def _end(self):
        self._worker = None
        self._changed.notify_all()

    def _does_next(self):
        """Draws a picture, or answers what was asked of one; whether there may be more to do."""
        with self._changed:
            is_moving, version = self._coarse != self._version, self._version
            if not is_moving and not self._picks:
                remaining = self._since + self._rest - clock.monotonic()
                if self._finished == version:
                    # With the lock held: what is asked for from now on starts another thread.
                    self._end()
                    return False
                if remaining > 0.0:
                    self._changed.wait(remaining)
                    return True
            pick = self._picks.pop(0) if self._picks and not is_moving else None
            orbit, look = self._orbit, dataclasses.replace(self._look)
            camera = None if orbit is None else orbit.camera()
            place = None if pick is None or orbit is None else (orbit.place(*pick), orbit.pixel())
        try:
            if pick is not None:
                self._answer(pick, place, look)
            else:
                self._draw(version, camera, look, is_moving)
        except _Superseded:
            pass
        except Exception as error:
            # Whatever it is, the next view may be drawn; and this one would fail again.
            self._tell(error)
            if pick is None:
                with self._changed:
                    self._coarse = self._finished = version
        return True

    def _draw(self, version, camera, look, is_moving):
        size, error_px = self._pace.plan(self.size, self._error_px) if is_moving else (self.size, self._error_px)
        is_finished = size == self.size and error_px == self._error_px

        def go_on(*_):
            # Coarse pictures are shown even when they are late: the view would stand still while it moves.
            if not is_moving and self._version != version:
                raise _Superseded

        begun = clock.perf_counter()
        picture = self._data.render(
            camera or self._camera,
            size,
            look.mode,
            look.attribute,
            color_map=look.color_map,
            color_scale=look.color_scale,
            error_px=error_px,
            time=look.time,
            progress=go_on,
            **self._asked,
        )
        seconds = clock.perf_counter() - begun
        if is_moving:
            self._pace.took(seconds)
        with self._changed:
            self.picture = picture
            # A view from where the camera began: it is known from the picture.
            if camera is None and self._orbit is None:
                usual_up = (0.0, 0.0, 1.0) if self._data.kind == "heights" else (0.0, 1.0, 0.0)
                bounds = self._data.bounds
                fov = picture.about["fov"]
                self._orbit = Orbit.of(picture.view, fov, picture.extent, self._camera, bounds, usual_up, self.size)
            span = None if self._orbit is None else self._orbit.span()
            self._coarse = version
            if is_finished:
                self._finished = version
        message = {
            "kind": "frame",
            "size": list(size),
            "finished": is_finished,
            "mode": picture.mode,
            "attribute": picture.attribute,
            "span": span,
            "unit": picture.unit or self._data.unit,
            "milliseconds": round(1000.0 * seconds, 1),
        }
        self._send(message, [picture.png()])

    def _answer(self, pick, place, look):
        """What is at a pixel: the numbers of the picture, and of particles what is in a sphere around it at the target's distance."""
        picture = self.picture
        if picture is None or place is None:
            return
        row, column = (min(max(int(at / side * count), 0), count - 1)
                       for at, side, count in zip(reversed(pick), reversed(self.size), picture.rgba.shape))
        (x, y, z), pixel = place
        answer = {
            "kind": "picked",
            "pixel": list(pick),
            "place": [x, y, z],
            "unit": self._data.unit,
            "values": {name: float(values[row, column]) for name, values in picture.channels.items()},
            "units": picture.units,
        }
        if self._data.kind in ("particles", "run") and len(self._data.paths) == 1:
            radius = _PICKED * pixel
            answer["radius"] = radius
            answer["probe"] = self._data.probe(sphere=(x, y, z, radius), time=look.time)
        self._send(_told(answer), [])


# What the browser asks for.
_MESSAGES = {
    "begin": Viewer._begin,
    "home": Viewer._home,
    "turn": Viewer._turn,
    "pan": Viewer._pan,
    "zoom": Viewer._zoom,
    "choose": Viewer._choose,
    "pick": Viewer._pick,
}

# The radius of what is asked about at the cursor, pixels.
_PICKED = 6.0


def _numbers(message, *names):
    """Numbers of a message."""
    found = [message.get(name) for name in names]
    for name, value in zip(names, found):
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= 1e6:
            raise Error(f"widget: {name}: found {value!r:.60}, expected a number")
    return found


def _told(value):
    """What JSON can say: numbers that are not finite are nothing."""
    if isinstance(value, dict):
        return {name: _told(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_told(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def widget(data, **asked):
    """The widget of :meth:`deepfield.Data.widget`.

    # Raises
    ``deepfield.Error`` where anywidget is not installed.
    """
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        lacking = error.name or "anywidget"
        raise Error(f"widget: found no {lacking}, expected anywidget to be installed: pip install anywidget") from None

    class Widget(anywidget.AnyWidget):
        """``camera`` is the camera as it stands, ``picture`` what is shown."""

        _esm = pathlib.Path(__file__).with_name("widget.js").read_text(encoding="utf-8")
        about = traitlets.Dict().tag(sync=True)

        def __init__(self):
            self.viewer = Viewer(data, self.send, **asked)
            super().__init__(about=self.viewer.about())
            self.on_msg(lambda _, message, buffers: self.viewer.receive(message))

        @property
        def camera(self):
            return self.viewer.camera

        @property
        def picture(self):
            return self.viewer.picture

    return Widget()
