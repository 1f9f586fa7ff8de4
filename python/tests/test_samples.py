"""Images, volumes and heights as arrays; pictures in figures; work that is given up."""

import contextlib
import importlib.util
import io
import os
import signal
import sys
import threading
import time
import types
import unittest
import unittest.mock

import numpy as np

import deepfield
from deepfield import progress
from test_deepfield import WithFolder, particles


class Samples(WithFolder):
    def test_grids_come_back_at_every_level(self):
        random = np.random.default_rng(5)
        for shape, kind in [((9, 14), np.uint8), ((7, 10, 13), np.float32), ((5, 6, 7), np.int16)]:
            samples = (random.random(shape) * 100).astype(kind)
            source = self.folder / f"{len(shape)}-{np.dtype(kind)}.npy"
            np.save(source, samples)
            for data in (deepfield.open(source), deepfield.build(source, source.with_suffix(".df"))):
                found = data.array()
                self.assertEqual(found.dtype, kind)
                np.testing.assert_array_equal(found, samples)
                self.assertEqual((data.shape, data.attributes), (shape[::-1], ["value", "gradient"]))
                for level in (1, 2, 5):
                    every = (slice(None, None, 2**level),) * len(shape)
                    np.testing.assert_array_equal(data.array(level), samples[every])
                self.refused("expected at most 10 bytes", data.array, memory=10)
                self.refused("level: found 63", data.array, 63)
                self.refused("level: found 0.5", data.array, 0.5)
        data = deepfield.build(particles(20), self.folder / "box.df")
        self.refused("expected an image or a volume", data.array)

    def test_heights_come_back_with_holes(self):
        samples = np.add.outer(np.arange(6.0), np.arange(9.0) / 4).round(2)
        samples[2, 3] = np.nan
        source = self.folder / "dem.asc"
        head = "ncols 9\nnrows 6\nxllcenter 10\nyllcenter 20\ncellsize 2\nNODATA_value -9999\n"
        rows = "\n".join(" ".join(f"{value:.2f}" for value in row) for row in np.nan_to_num(samples, nan=-9999))
        source.write_text(head + rows + "\n")
        for data in (deepfield.open(source), deepfield.build(source, self.folder / "dem.df")):
            np.testing.assert_allclose(data.heights(), samples, atol=1e-6)
            np.testing.assert_allclose(data.heights(slice(1, -1), (2, 5)), samples[1:-1, 2:5], atol=1e-6)
            heights, x, y = data.heights((4, 6), coordinates=True)
            np.testing.assert_allclose(heights, samples[4:], atol=1e-6)
            np.testing.assert_allclose(x, 10 + 2 * np.arange(9.0))
            np.testing.assert_allclose(np.sort(y), [20, 22])
            self.refused("rows: found 4 to 7, expected a part of 0 to 6", data.heights, (4, 7))
            self.refused("expected at most 10 bytes", data.heights, memory=10)
        self.assertEqual(data.attributes, ["height", "slope", "aspect", "curvature", "residual", "level", "primitive"])
        for attribute in data.attributes:
            self.assertEqual(data.render(size=(8, 6), attribute=attribute).attribute, attribute)
        rounded = deepfield.build(source, self.folder / "rounded.df", height_error=0.25).heights()
        np.testing.assert_array_equal(np.isnan(rounded), np.isnan(samples))
        self.assertLessEqual(np.nanmax(abs(rounded - samples)), 0.25)
        self.refused("--height-error: found 0, expected a number above 0", deepfield.build, source, self.folder / "a.df", height_error=0)
        self.refused("found arrays, expected a file of heights", deepfield.build, particles(20), self.folder / "a.df", height_error=1)


class Shown(WithFolder):
    def setUp(self):
        super().setUp()
        self.data = deepfield.build(particles(500), self.folder / "box.df", units={"positions": "kpc", "mass": "Msun"})
        camera = {"eye": (0.5, 0.5, 9.0), "target": (0.5, 0.5, 0.5), "ortho": 1.5}
        self.picture = self.data.render(camera, (40, 30), "column-density")

    def test_a_picture_knows_what_its_colours_mean(self):
        brightness = self.picture.about["legend"]["brightness"]
        self.assertEqual(len(brightness["colors"]), 256)
        self.assertLess(*brightness["range"])

    @unittest.skipUnless(importlib.util.find_spec("matplotlib"), "matplotlib is not installed")
    def test_a_figure_has_its_extent_and_a_bar(self):
        import matplotlib

        matplotlib.use("agg")
        from matplotlib import pyplot

        for channel, settings in [(None, {}), ("P", {"norm": "log"})]:
            figure, ax = pyplot.subplots()
            image = self.picture.imshow(ax, channel, **settings)
            np.testing.assert_allclose(image.get_extent(), self.picture.extent)
            self.assertEqual((len(figure.axes), ax.get_xlabel()), (2, "x [kpc]"))
            self.assertIn("Msun", figure.axes[1].get_ylabel())
            figure.canvas.draw()
            pyplot.close(figure)
        self.refused("channel: found Q, expected one of P", self.picture.imshow, None, "Q")
        pyplot.close("all")

    def test_progress_is_a_bar_or_a_line(self):
        self.data.histogram("mass", progress=True)
        with unittest.mock.patch.dict(sys.modules, {"tqdm": None, "tqdm.auto": None}):
            self.data.histogram("mass", progress=True)
            line = io.StringIO()
            with contextlib.redirect_stderr(line), progress.teller(True) as tell:
                tell("reading", 1, 4)
                tell("drawing", 3, 0)
            self.assertIn("reading: 25 %", line.getvalue())
            self.assertTrue(line.getvalue().endswith("\r"))

    def test_progress_is_a_bar_of_tqdm_for_each_stage(self):
        bars = []

        class Bar:
            """What is used of tqdm."""

            def __init__(self, total=None, desc=None, leave=True):
                self.total, self.desc, self.leave, self.n, self.shown, self.is_closed = total, desc, leave, 0, [], False
                bars.append(self)

            def refresh(self):
                self.shown.append((self.n, self.total))

            def close(self):
                self.is_closed = True

        auto = types.ModuleType("tqdm.auto")
        auto.tqdm = Bar
        with unittest.mock.patch.dict(sys.modules, {"tqdm": types.ModuleType("tqdm"), "tqdm.auto": auto}):
            with progress.teller(True) as tell:
                for told in [("reading", 0, 0), ("reading", 1, 4), ("reading", 4, 4), ("drawing", 3, 0)]:
                    tell(*told)
                self.assertEqual([bar.is_closed for bar in bars], [True, False])
            self.assertEqual([(bar.desc, bar.leave) for bar in bars], [("reading", False), ("drawing", False)])
            self.assertEqual([bar.shown for bar in bars], [[(0, None), (1, 4), (4, 4)], [(3, None)]])
            self.data.histogram("mass", progress=True)
            with self.assertRaises(deepfield.Error):
                self.data.histogram("nothing", progress=True)
        self.assertTrue(all(bar.is_closed for bar in bars))

    @unittest.skipUnless(hasattr(signal, "SIGALRM"), "signals end pictures elsewhere in other ways")
    def test_a_picture_is_given_up_at_once(self):
        data = deepfield.build(particles(20_000), self.folder / "many.df")
        raised = []

        def interrupt():
            raised.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

        # A shell has its background jobs ignore it.
        self.addCleanup(signal.signal, signal.SIGINT, signal.signal(signal.SIGINT, signal.default_int_handler))
        threading.Timer(0.3, interrupt).start()
        with self.assertRaises(KeyboardInterrupt):
            # A machine may be fast.
            while time.sleep(0) is None:
                data.render(size=(2000, 2000), mode="column-density")
        # Within the twentieth of a second at which signals are looked for, on a machine that has other things to do.
        self.assertLess(time.monotonic() - raised[0], 0.5)
        self.assertTrue(self.data.render(size=(20, 20), mode="points").converged)


if __name__ == "__main__":
    unittest.main()
