"""Samples of open images, volumes and height fields as arrays."""

import json

import numpy as np

from . import _deepfield, asked, progress as progresses


class Samples:
    """Samples of open data as arrays."""

    def array(self, level=0, stored=False, *, memory=None, progress=None):
        """The samples of an image or a volume: shape (y, x) or (z, y, x), and of several channels one axis more, the last.

        ``level`` leaves every 2^level-th sample along each axis. Values are as they are stored, in the type of the file, unless that scales
        them or marks missing ones: then they are float64 with NaN, or as stored with ``stored=True``. ``memory`` is what they may take.

        >>> np.save("cube.npy", np.arange(210, dtype=np.int16).reshape(6, 5, 7))
        >>> volume = deepfield.open("cube.npy")
        >>> volume.shape, volume.array().shape, volume.array(level=1).shape
        ((7, 5, 6), (6, 5, 7), (3, 3, 4))
        """
        wanted = {"level": asked.count("level", level), "stored": bool(stored), "memory": asked.memory(memory)}
        with progresses.teller(progress) as tell:
            content, about = self._native.samples(asked.text(wanted), tell)
        about = json.loads(about)
        samples = content.view(about["dtype"]).reshape(about["shape"])
        channels = about["channels"]
        plain = all((one["slope"], one["intercept"], one["no_data"]) == (1.0, 0.0, None) for one in channels)
        if stored or plain:
            return samples
        values = samples.astype(np.float64)
        each = values[..., np.newaxis] if len(channels) == 1 else values
        for index, one in enumerate(channels):
            channel = each[..., index]
            missing = None if one["no_data"] is None else channel == one["no_data"]
            channel *= one["slope"]
            channel += one["intercept"]
            if missing is not None:
                channel[missing] = np.nan
        return values

    def heights(self, rows=None, columns=None, coordinates=False, *, memory=None, progress=None):
        """Measured heights: float64 (rows, columns), NaN where nothing was measured.

        ``rows`` and ``columns`` are slices or pairs of the first one and the one after the last. With ``coordinates`` come x of the columns and
        y of the rows, too: (heights, x, y).

        >>> np.save("slope.npy", np.add.outer(np.arange(6.0), np.arange(9.0)))
        >>> deepfield.open("slope.npy").heights(rows=(4, 6), columns=slice(0, 3))
        array([[4., 5., 6.],
               [5., 6., 7.]])
        """
        if self.kind in ("particles", "run", "volume"):
            raise _deepfield.Error(f"{self.paths[0]}: heights: found {self.kind}, expected measured heights")
        width, height = self.shape if self.kind == "heights" else (0, 0)
        wanted = {
            "rows": _part("rows", rows, height),
            "columns": _part("columns", columns, width),
            "memory": asked.memory(memory),
        }
        with progresses.teller(progress) as tell:
            found, about = self._native.heights(asked.text(wanted), tell)
        if not coordinates:
            return found
        about = json.loads(about)
        x, y = (
            origin + step * np.arange(count)
            for origin, step, count in zip(about["origin"], about["step"], found.shape[::-1])
        )
        return found, x, y


def _part(name, part, count):
    if part is None:
        return None
    if isinstance(part, slice):
        start, stop, step = part.indices(count)
        part = (start, stop) if step == 1 else ()
    if not isinstance(part, (tuple, list, np.ndarray)) or len(part) != 2:
        raise _deepfield.Error(f"{name}: found {part!r}, expected a slice without a step, or the first one and the one after the last")
    return [asked.count(name, end) for end in part]
