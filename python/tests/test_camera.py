"""Cameras and what is asked, without a picture."""

import pathlib
import random
import tempfile
import unittest

import numpy as np

import deepfield
from deepfield import asked, columns


class Cameras(unittest.TestCase):
    def test_text_comes_back_as_it_was(self):
        chance = random.Random(4)
        for _ in range(200):
            place = lambda: tuple(chance.choice([0.0, -1.5e-9, 3e20, chance.gauss(0, 10)]) for _ in range(3))
            some = {name: place() for name in ("eye", "target", "up") if chance.random() < 0.7}
            some |= chance.choice([{}, {"fov": chance.uniform(1, 90)}, {"ortho": chance.expovariate(1)}])
            camera = deepfield.Camera(**some)
            self.assertEqual(deepfield.Camera.from_ron(camera.to_ron()), camera)
            self.assertEqual(deepfield.Camera.of(camera.asked()), camera)

    def test_cameras_of_scenes_are_read(self):
        scene = """(
            eye: (1.0, -2, 3e1), // where
            target: (0.0, 0.0, 0.0),
            up: (0.0, 1.0, 0.0),
            fov: 33.0,
            ortho: Some(5.0),
        )"""
        expected = deepfield.Camera(eye=(1, -2, 30), target=(0, 0, 0), up=(0, 1, 0), ortho=5.0)
        self.assertEqual(deepfield.Camera.from_ron(scene), expected)
        self.assertEqual(deepfield.Camera.from_ron(scene.replace("Some(5.0)", "None")).fov, 33.0)
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "camera.ron"
            expected.write(path)
            self.assertEqual(deepfield.Camera.read(path), expected)
        for wrong in ["", "eye: (0, 0, 0)", "(eye: 1.0)", "(ey: (0, 0, 0))", "(eye: (0, 0))", "(fov: wide)", "(fov: 3 ortho: 4)"]:
            with self.assertRaises(deepfield.Error, msg=wrong):
                deepfield.Camera.from_ron(wrong)


class Asked(unittest.TestCase):
    def test_amounts_of_memory(self):
        self.assertEqual([asked.memory(amount) for amount in (None, 5000, "2GiB", "1.5 MB")], [None, 5000, 2 << 30, 1_500_000])
        for wrong in ("", "GiB", "-1GiB", "2 apples", 0, "1.2.3GB"):
            with self.assertRaises(deepfield.Error, msg=wrong):
                asked.memory(wrong)

    def test_numbers_of_numpy_are_numbers(self):
        text = asked.text({"a": np.float32(0.5), "b": np.arange(3), "c": None, "d": True})
        self.assertEqual(text, '{"a": 0.5, "b": [0, 1, 2], "d": true}')
        for wrong in (float("nan"), {1, 2}):
            with self.assertRaises(deepfield.Error):
                asked.text({"a": wrong})

    def test_floats_are_not_copied(self):
        for kind in (np.float32, np.float64):
            array = np.ones((4, 6), dtype=kind)[:, ::2]
            self.assertTrue(np.shares_memory(columns.floats("a", array), array))
        for other in (np.arange(3), np.ones(3, dtype=">f8"), np.ones(3, dtype=np.float16), [1, 2.5, 3], np.ma.masked_less([1.0, -1.0], 0)):
            found = columns.floats("a", other)
            self.assertTrue(found.dtype in (np.float32, np.float64) and found.dtype.isnative)
        self.assertTrue(np.isnan(found[1]))
        with self.assertRaises(deepfield.Error):
            columns.floats("a", np.array(["one"]))


if __name__ == "__main__":
    unittest.main()
