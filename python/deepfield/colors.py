"""Colour maps, presets and modes by name."""

from . import _deepfield, asked


def color_maps():
    """Colour maps with a line about each, the perceptually uniform ones first."""
    return dict(_deepfield.color_maps())


def color_map(name, count=256):
    """Colours of a map at evenly spaced places from 0 to 1: float32 (count, 3), gamma-encoded.

    >>> deepfield.color_map("viridis", 5).shape
    (5, 3)
    """
    return _deepfield.color_map(name, asked.whole("count", count, 1 << 20))


def transfer_functions():
    """Names of presets."""
    return _deepfield.transfer_functions()


def modes():
    """Names of visualization modes."""
    return _deepfield.modes()
