"""Copies of objects, those that other processes get, and data that is looked at from another folder."""

import copy
import multiprocessing
import os
import pickle
import signal
import threading
import time
import unittest

import numpy as np

import deepfield
from test_deepfield import ABOVE, WithFolder, particles


def drawn(data):
    return data.render(ABOVE, (60, 40)).png()


class Copies(WithFolder):
    def setUp(self):
        super().setUp()
        self.data = deepfield.build(particles(300), self.folder / "box.df")

    def copies(self, whole):
        return copy.copy(whole), copy.deepcopy(whole), pickle.loads(pickle.dumps(whole))

    def test_data_is_opened_again(self):
        for again in self.copies(self.data):
            self.assertEqual((again.count, again.paths), (300, self.data.paths))
            self.assertEqual(again.probe(sphere=(0.5, 0.5, 0.5, 0.3)), self.data.probe(sphere=(0.5, 0.5, 0.5, 0.3)))

    @unittest.skipUnless(hasattr(os, "fork"), "this system has no fork")
    def test_processes_that_are_forked_draw_too(self):
        expected = drawn(self.data)
        with multiprocessing.get_context("fork").Pool(1) as pool:
            # Threads that only the first process has would never answer.
            self.assertEqual(pool.map_async(drawn, [self.data]).get(60.0), [expected])

    @unittest.skipUnless(hasattr(os, "fork"), "this system has no fork")
    def test_a_fork_waits_for_calls_of_other_threads(self):
        expected, begun, told = drawn(self.data), threading.Event(), []

        def tell(*_):
            if not told:
                told.append("begun")
                begun.set()
                time.sleep(0.3)
                told.append("on the way to its end")

        def look():
            os._exit(len(told) != 2 or drawn(self.data) != expected)

        building = threading.Thread(target=deepfield.build, args=(particles(100_000), self.folder / "large.df", None, tell))
        building.start()
        self.addCleanup(building.join)
        self.assertTrue(begun.wait(60.0))
        child = multiprocessing.get_context("fork").Process(target=look)
        child.start()
        self.addCleanup(child.kill)
        child.join(60.0)
        self.assertEqual(child.exitcode, 0)
        # And calls go on.
        self.assertEqual(drawn(self.data), expected)

    @unittest.skipUnless(hasattr(os, "fork"), "this system has no fork")
    def test_a_process_that_is_forked_within_a_call_does_not_wait_for_its_work(self):
        here, forked = os.getpid(), []

        def tell(*_):
            if not forked:
                forked.append(os.fork())
                if not forked[0]:
                    # Rather than wait for ever.
                    signal.alarm(60)

        try:
            deepfield.build(particles(100_000), self.folder / "large.df", None, tell)
        except deepfield.Error as error:
            if os.getpid() == here:
                raise
            os._exit("was forked within the call" not in str(error))
        finally:
            if os.getpid() != here:
                os._exit(2)
        self.assertEqual(os.waitpid(forked[0], 0)[1], 0)

    def test_data_is_the_same_from_another_folder(self):
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        data = deepfield.open("box.df")
        (self.folder / "other").mkdir()
        os.chdir("other")
        self.assertEqual(data.probe()["count"], 300)
        self.assertEqual(pickle.loads(pickle.dumps(data)).count, 300)

    def test_pictures_keep_numbers_and_files(self):
        picture = self.data.render(ABOVE, (60, 40), "column-density", attribute="temperature")
        for again in self.copies(picture):
            self.assertEqual((again.png(), again.about, again.units), (picture.png(), picture.about, picture.units))
            np.testing.assert_array_equal(again.channels["S"], picture.channels["S"])
        apart = pickle.loads(pickle.dumps(picture))
        before = picture.png()
        # Its arrays are its own, and still those that files are made of.
        apart.rgba[...] = 255
        self.assertEqual(picture.png(), before)
        self.assertNotEqual(apart.png(), before)

    def test_tables_questions_and_texts(self):
        table = self.data.select(fields=["x", "temperature"])
        for again in self.copies(table):
            self.assertEqual((again.columns, again.units), (table.columns, table.units))
            np.testing.assert_array_equal(again["x"], table["x"])
        scene = deepfield.Scene(self.data, mode="points")
        for again in self.copies(scene):
            self.assertEqual(again, scene)
        probe = pickle.loads(pickle.dumps(self.data.probe()))
        self.assertEqual(probe.table["count"].tolist(), [300])
