"""The widget, without a browser: messages go in, frames come out."""

import importlib.util
import json
import math
import pathlib
import queue
import random
import shutil
import struct
import subprocess
import tempfile
import threading
import unittest
import warnings

import numpy as np

import deepfield
from deepfield.widget import Pace, Viewer
from test_deepfield import ABOVE, write_movie

# How long anything may take that is waited for.
LONG = 20.0


def size_of(png):
    """Width and height of a PNG (its header, section 11.2.2 of the standard)."""
    assert png[:8] == b"\x89PNG\r\n\x1a\n" and png[12:16] == b"IHDR"
    return struct.unpack(">II", png[16:24])


class Frames(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        chance = np.random.default_rng(2)
        gas = {"positions": chance.random((500, 3)), "mass": 1.0, "smoothing_length": 0.1, "temperature": chance.random(500)}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", deepfield.Note)
            cls.data = deepfield.build(gas, f"{folder.name}/box.df")

    def setUp(self):
        self.sent = queue.Queue()

    def viewer(self, data=None, **asked):
        def send(message, buffers):
            # As Jupyter does.
            json.dumps(message, allow_nan=False)
            self.sent.put((message, buffers))

        return Viewer(data or self.data, send, size=(96, 64), rest=0.0, **asked)

    def answers(self, viewer, *messages):
        """What was sent after the messages, when all is drawn."""
        for message in messages:
            viewer.receive(message)
        self.assertTrue(viewer.wait(LONG))
        return [self.sent.get_nowait() for _ in range(self.sent.qsize())]

    def test_a_view_that_moves_is_drawn_coarser_and_then_finished(self):
        viewer = self.viewer(camera=ABOVE, mode="column-density")
        frames = self.answers(viewer, {"do": "begin"})
        self.assertEqual({frame["kind"] for frame, _ in frames}, {"frame"}, frames)
        self.assertLess(frames[0][0]["size"][0], 96)
        for frame, (png,) in frames:
            self.assertEqual(list(size_of(png)), frame["size"])
        last, (png,) = frames[-1]
        self.assertTrue(last["finished"] and not frames[0][0]["finished"])
        self.assertEqual(png, self.data.render(ABOVE, (96, 64), "column-density").png())
        self.assertEqual((last["mode"], last["unit"], last["span"]), ("column-density", self.data.unit, 1.5))
        moves = [{"do": "turn", "x": 12, "y": 5}, {"do": "pan", "x": -3, "y": 4.5}, {"do": "zoom", "factor": 0.5, "x": 30, "y": 20}]
        last, (png,) = self.answers(viewer, *moves)[-1]
        self.assertEqual((last["finished"], last["span"]), (True, 0.75))
        camera = viewer.camera
        self.assertAlmostEqual(np.linalg.norm(np.subtract(camera.eye, camera.target)), 8.5 / 2)
        self.assertEqual(png, self.data.render(camera, (96, 64), "column-density").png())
        self.answers(viewer, {"do": "home"})
        np.testing.assert_allclose(viewer.camera.eye, ABOVE["eye"])

    def test_where_the_camera_begins_is_where_a_picture_has_it(self):
        viewer = self.viewer(mode="column-density")
        self.answers(viewer, {"do": "begin"})
        begun = self.data.render(size=(96, 64), mode="column-density")
        for name, axis in begun.view.items():
            np.testing.assert_allclose(viewer.picture.view[name], axis, atol=1e-9)
        # Its last digits are of a coarser picture's size.
        self.assertLess(np.abs(viewer.picture.rgba.astype(int) - begun.rgba).mean(), 0.5)

    def test_mode_and_attribute_are_chosen(self):
        viewer = self.viewer(camera=ABOVE)
        about = viewer.about()
        self.assertIn("temperature", about["attributes"])
        self.assertIn("points", about["modes"])
        self.assertEqual((about["times"], about["flat"]), ([], False))
        frames = self.answers(viewer, {"do": "begin"}, {"do": "choose", "mode": "points", "attribute": "temperature"})
        self.assertEqual((frames[-1][0]["mode"], frames[-1][0]["attribute"]), ("points", "temperature"))
        # What cannot be drawn is told, once, and the view goes on.
        ((error, _),) = self.answers(viewer, {"do": "choose", "mode": "pionts"})
        self.assertEqual(error["kind"], "error")
        self.assertIn("pionts", error["text"])
        self.assertTrue(self.answers(viewer, {"do": "choose", "mode": None})[-1][0]["finished"])

    def test_colours_are_chosen(self):
        viewer = self.viewer(camera=ABOVE, mode="column-density")
        self.assertIn("viridis", viewer.about()["color_maps"])
        drawn = {}
        for chosen in ({}, {"color_map": "grey"}, {"color_scale": "linear"}, {"color_map": "viridis", "color_scale": "log"}):
            last, (png,) = self.answers(viewer, {"do": "begin"}, {"do": "choose", **chosen})[-1]
            self.assertTrue(last["finished"], last)
            drawn[tuple(chosen.values())] = png
        self.assertEqual(len(set(drawn.values())), 4)
        expected = self.data.render(ABOVE, (96, 64), "column-density", color_map="viridis", color_scale="log")
        self.assertEqual(drawn["viridis", "log"], expected.png())
        # The usual ones again.
        usual = self.answers(viewer, {"do": "choose", "color_map": None, "color_scale": None})[-1][1][0]
        self.assertEqual(usual, drawn[()])
        ((error, _),) = self.answers(viewer, {"do": "choose", "color_map": "infern"})
        self.assertIn("no colour map `infern`", error["text"])

    def test_a_time_of_a_run_is_chosen(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        movie = pathlib.Path(folder.name, "movie.xyz")
        write_movie(movie, np.random.default_rng(3).random((60, 3)))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", deepfield.Note)
            data = deepfield.build(movie, movie.with_suffix(".df"))
        camera = {**ABOVE, "ortho": 6.0}
        viewer = self.viewer(data, camera=camera, mode="column-density")
        self.assertEqual(viewer.about()["times"], [0.0, 1.0, 2.0])
        self.answers(viewer, {"do": "begin"})
        drawn = {}
        for time in (None, 1.0):
            last, (drawn[time],) = self.answers(viewer, {"do": "choose", "time": time})[-1]
            self.assertTrue(last["finished"])
            self.assertEqual(drawn[time], data.render(camera, (96, 64), "column-density", time=time).png())
        self.assertNotEqual(drawn[None], drawn[1.0])

    def test_what_is_at_a_pixel_is_told(self):
        viewer = self.viewer(camera=ABOVE, mode="column-density")
        self.answers(viewer, {"do": "begin"})
        ((picked, _),) = self.answers(viewer, {"do": "pick", "x": 48, "y": 32})
        np.testing.assert_allclose(picked["place"], (0.5, 0.5, 0.5), atol=1e-12)
        self.assertEqual(picked["values"]["P"], float(viewer.picture.channels["P"][32, 48]))
        expected = self.data.probe(sphere=(*picked["place"], picked["radius"]))
        self.assertEqual(picked["probe"]["count"], expected["count"])
        # Beside the picture is its edge.
        ((picked, _),) = self.answers(viewer, {"do": "pick", "x": 1e5, "y": -1e5})
        self.assertEqual(picked["kind"], "picked")

    def test_messages_that_make_no_sense_are_answered(self):
        viewer = self.viewer()
        numbers = (None, "1", True, float("nan"), float("inf"), 1e300, [1], {})
        wrong = [None, 3, [], {}, {"do": None}, {"do": "fly"}, {"do": ["turn"]}, {"do": "choose", "mode": 3}, {"do": "choose", "time": [1]}]
        wrong += [{"do": do, "x": value, "y": 0, "factor": 1} for do in ("turn", "pan", "zoom", "pick") for value in numbers]
        wrong += [{"do": "zoom", "x": 0, "y": 0, "factor": value} for value in (*numbers, 0, -1)]
        for message in wrong:
            ((answer, _),) = self.answers(viewer, message)
            self.assertEqual(answer["kind"], "error", message)
            self.assertNotIn("\n", answer["text"])

    def test_a_finished_picture_of_an_old_view_is_given_up(self):
        data, begun, may_end, views = self.data, threading.Event(), threading.Event(), []

        class Slow:
            kind, bounds, unit = data.kind, data.bounds, data.unit

            def render(self, camera, size, *names, progress, **asked):
                views.append((camera.eye, size))
                if size == (96, 64) and not begun.is_set():
                    begun.set()
                    may_end.wait(LONG)
                    progress("drawing", 0, 1)
                    raise AssertionError("it goes on")
                return data.render(camera, size, *names, **asked)

        viewer = self.viewer(Slow(), camera=ABOVE)
        viewer.receive({"do": "begin"})
        self.assertTrue(begun.wait(LONG))
        viewer.receive({"do": "turn", "x": 10, "y": 0})
        may_end.set()
        frames = self.answers(viewer)
        self.assertEqual({frame["kind"] for frame, _ in frames}, {"frame"}, frames)
        self.assertEqual([frame["finished"] for frame, _ in frames].count(True), 1)
        self.assertEqual((views[-1][1], views[-1][0]), ((96, 64), viewer.camera.eye))
        self.assertNotEqual(views[-1][0], views[0][0])

    @unittest.skipUnless(shutil.which("node"), "Node is not installed")
    def test_what_hands_do_in_a_page_becomes_messages_that_are_understood(self):
        page = pathlib.Path(deepfield.__file__).with_name("widget.js")
        command = ["node", pathlib.Path(__file__).with_name("widget.mjs"), page]
        said = subprocess.run(command, check=True, capture_output=True, text=True, timeout=LONG).stdout
        messages = [json.loads(line) for line in said.splitlines()]
        factor = messages[4]["factor"]
        self.assertEqual(messages, [
            {"do": "begin"}, {"do": "turn", "x": -40, "y": 0}, {"do": "pan", "x": -20, "y": 0}, {"do": "turn", "x": 10, "y": 0},
            {"do": "zoom", "factor": factor, "x": 48, "y": 32}, {"do": "pick", "x": 48, "y": 32}, {"do": "choose", "mode": "points"},
            {"do": "choose", "color_map": "viridis"}, {"do": "choose", "color_scale": "linear"}, {"do": "choose", "color_map": None},
            {"do": "home"},
        ])  # fmt: skip
        self.assertAlmostEqual(factor, math.e)
        viewer = self.viewer(camera=ABOVE)
        answers = [answer["kind"] for message in messages for answer, _ in self.answers(viewer, message)]
        self.assertEqual((answers.count("picked"), answers.count("error")), (1, 0))
        self.assertEqual(viewer.picture.mode, "points")
        np.testing.assert_allclose(viewer.camera.eye, ABOVE["eye"])

    @unittest.skipUnless(importlib.util.find_spec("anywidget"), "no anywidget")
    def test_the_widget_of_a_notebook_takes_and_sends_messages(self):
        widget = self.data.widget(mode="points", size=(96, 64), camera=ABOVE)
        self.assertEqual(widget.get_state()["about"]["mode"], "points")
        self.assertIn("export default", widget._esm)
        sent = []
        widget.comm.publish_msg = lambda kind, data=None, metadata=None, buffers=None, **_: sent.append((kind, data, buffers))
        widget._handle_custom_msg({"do": "begin"}, [])
        self.assertTrue(widget.viewer.wait(LONG))
        kind, data, buffers = sent[-1]
        self.assertEqual((kind, data["method"], data["content"]["finished"]), ("comm_msg", "custom", True))
        self.assertEqual(size_of(bytes(buffers[0])), (96, 64))
        np.testing.assert_allclose(widget.camera.eye, ABOVE["eye"])
        self.assertEqual(widget.picture.size, (96, 64))

    @unittest.skipIf(importlib.util.find_spec("anywidget"), "anywidget is there")
    def test_without_anywidget_it_is_asked_for(self):
        with self.assertRaisesRegex(deepfield.Error, "pip install anywidget"):
            self.data.widget()


class Paces(unittest.TestCase):
    def test_frames_take_what_they_may(self):
        chance = random.Random(3)
        for _ in range(200):
            pace = Pace(budget=0.1)
            least, full = chance.uniform(0.0, 0.08), 10 ** chance.uniform(-3, 2)
            for _ in range(80):
                effort = pace.effort
                pace.took(least + full * effort)
                (width, height), error_px = pace.plan((900, 600), 0.8)
                # Pixels and error say the same as the effort.
                self.assertAlmostEqual((width / 900 * 0.8 / error_px) ** 2 / pace.effort, 1.0, delta=0.05)
                self.assertTrue(150 <= width <= 900 and 100 <= height <= 600 and 0.8 <= error_px <= 6.4001)
            seconds = least + full * pace.effort
            limits = (1.0, (Pace.SMALLEST / Pace.COARSEST) ** 2)
            self.assertTrue(0.08 < seconds < 0.12 or pace.effort in limits, (least, full, seconds))


if __name__ == "__main__":
    unittest.main()
