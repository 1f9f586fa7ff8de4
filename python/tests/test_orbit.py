"""How the camera of the widget moves."""

import math
import random
import unittest

import numpy as np

from deepfield.camera import Camera
from deepfield.orbit import Orbit

SIZE = (300, 200)


def some(chance):
    """An orbit somewhere, of either projection, that does not look along its axis."""
    while True:
        eye, target, up = (np.array([chance.gauss(0, 5) for _ in range(3)]) for _ in range(3))
        along = (target - eye) @ up / np.linalg.norm(target - eye) / np.linalg.norm(up)
        if abs(along) < 0.98:
            break
    fov, ortho = chance.choice([(chance.uniform(5, 100), None), (None, chance.uniform(0.1, 9))])
    return Orbit(eye, target, up, fov, ortho, SIZE)


def pixel_of(orbit, place):
    """Where a picture of the orbit's camera has a place (docs/pictures.md), by the camera alone."""
    camera = orbit.camera()
    eye, target, up = (np.array(getattr(camera, name)) for name in ("eye", "target", "up"))
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    relative = np.array(place) - eye
    height = camera.ortho or 2.0 * (relative @ forward) * math.tan(math.radians(camera.fov / 2.0))
    across, upward = relative @ right, relative @ np.cross(right, forward)
    return np.array([SIZE[0] / 2 + across * SIZE[1] / height, SIZE[1] / 2 - upward * SIZE[1] / height])


class Orbits(unittest.TestCase):
    def setUp(self):
        chance = random.Random(11)
        self.cases = [(some(chance), *(chance.uniform(-150, 350) for _ in range(2)), *(chance.gauss(0, 80) for _ in range(2)))
                      for _ in range(200)]

    def test_what_is_under_the_cursor_goes_where_it_is_dragged_to_and_stays_where_it_is_zoomed(self):
        for orbit, x, y, right, down in self.cases:
            place = orbit.place(x, y)
            np.testing.assert_allclose(pixel_of(orbit, place), (x, y), atol=1e-6)
            orbit.pan(right, down)
            np.testing.assert_allclose(pixel_of(orbit, place), (x + right, y + down), atol=1e-6)
            factor, span = math.exp(down / 50.0), orbit.span()
            orbit.zoom(factor, x + right, y + down)
            np.testing.assert_allclose(pixel_of(orbit, place), (x + right, y + down), atol=1e-6)
            self.assertAlmostEqual(orbit.span() / span / factor, 1.0)

    def test_turning_keeps_distance_target_and_horizon(self):
        for orbit, x, y, *_ in self.cases:
            target, distance, eye = orbit.target.copy(), np.linalg.norm(orbit.eye - orbit.target), orbit.eye.copy()
            self.assertGreater(orbit.axes()[1] @ orbit.up, 0.0)
            # Half a turn and back, and once around.
            orbit.turn(SIZE[1], 0.0)
            orbit.turn(-SIZE[1], 0.0)
            orbit.turn(2 * SIZE[1], 0.0)
            np.testing.assert_allclose(orbit.eye, eye, atol=1e-9 * (1 + distance))
            for step in range(5):
                before = orbit.eye @ orbit.up
                orbit.turn(x, y * 10 ** (step - 2))
                # Dragged down, the camera rises.
                self.assertGreaterEqual((orbit.eye @ orbit.up - before) * y, -1e-9 * abs(y) * (1 + distance))
            np.testing.assert_array_equal(orbit.target, target)
            self.assertAlmostEqual(np.linalg.norm(orbit.eye - target) / distance, 1.0, places=12)
            self.assertGreater(orbit.axes()[1] @ orbit.up, 0.0)
            np.testing.assert_allclose(pixel_of(orbit, target), (SIZE[0] / 2, SIZE[1] / 2), atol=1e-6)

    def test_near_things_turn_with_the_drag(self):
        orbit = Orbit((0, 0, 10), (0, 0, 0), (0, 1, 0), 40.0, None, SIZE)
        near = np.array([0.0, 0.0, 1.0])
        orbit.turn(10.0, 0.0)
        self.assertGreater(pixel_of(orbit, near)[0], SIZE[0] / 2)
        orbit.turn(0.0, 10.0)
        self.assertGreater(pixel_of(orbit, near)[1], SIZE[1] / 2)

    def test_zooming_ends_before_numbers_do(self):
        for factor in (1e-6, 1e6):
            for orbit, *_ in self.cases[:20]:
                for _ in range(50):
                    orbit.zoom(factor, 10.0, 10.0)
                self.assertTrue(np.isfinite(orbit.eye).all() and 0.0 < orbit.span() < math.inf)
                self.assertGreater(np.linalg.norm(orbit.eye - orbit.target), 0.0)

    def test_a_picture_tells_its_camera(self):
        for orbit, *_ in self.cases:
            right, up, forward = orbit.axes()
            view = {"eye": orbit.eye, "right": right, "up": up, "forward": forward}
            extent = None if orbit.ortho is None else (-1.0, 1.0, -orbit.ortho / 2, orbit.ortho / 2)
            bounds = np.array([orbit.target - 1.0, orbit.target + 1.0])
            for camera in (Camera(up=orbit.up), Camera()):
                found = Orbit.of(view, orbit.fov, extent, camera, bounds, orbit.up, SIZE)
                self.assertEqual((found.fov, found.ortho), (orbit.fov, orbit.ortho))
                for name in ("eye", "target", "up"):
                    np.testing.assert_allclose(getattr(found, name), getattr(orbit, name), atol=1e-9)
            # Another axis than the picture's is not taken.
            other = Orbit.of(view, orbit.fov, extent, Camera(), bounds, right, SIZE)
            np.testing.assert_array_equal(other.up, up)


if __name__ == "__main__":
    unittest.main()
