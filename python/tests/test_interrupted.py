"""Work that is given up, by Ctrl-C or by what progress raises: Python goes on soon, and nothing half-written stays."""

import _thread
import gc
import os
import signal
import subprocess
import sys
import threading
import time
import unittest
import unittest.mock
import weakref

import numpy as np

import deepfield
from test_deepfield import WithFolder, particles

# Seconds. The bar is a tenth, on a machine that does nothing else: beside compilers and other tests a thread may have to wait for longer until it is
# run at all.
SOON = 1.0

# A program that is ended in the middle of a build, while threads may be reading its arrays.
ENDS = """
import _thread, signal, sys, threading
import numpy as np
import deepfield

signal.signal(signal.SIGINT, signal.default_int_handler)
arrays = {"positions": np.random.default_rng(3).random((1_000_000, 3))}
try:
    threading.Timer(0.2, _thread.interrupt_main).start()
    deepfield.build(arrays, sys.argv[1])
except KeyboardInterrupt:
    print("interrupted")
"""

# A program that ends while a frame is being written, which takes longer than Ctrl-C waits.
WRITES = """
import _thread, pathlib, signal, sys, threading, time
import deepfield

frames = pathlib.Path(sys.argv[2])

def interrupt():
    while not any(frames.glob(".deepfield-*")):
        time.sleep(0.001)
    _thread.interrupt_main()

signal.signal(signal.SIGINT, signal.default_int_handler)
data = deepfield.open(sys.argv[1])
try:
    threading.Thread(target=interrupt, daemon=True).start()
    deepfield.Tour.around(seconds=60.0).render(data, frames, (2000, 2000), 30)
except KeyboardInterrupt:
    print("interrupted")
"""


# A program that ends while a picture's data, which the cache has lost, is built into it again.
BUILDS = """
import pathlib, sys
import deepfield

cache = pathlib.Path(sys.argv[2])

def files():
    return [path for path in cache.rglob("*") if path.is_file()]

def tell(*_):
    if files():
        raise KeyboardInterrupt

data = deepfield.open(sys.argv[1])
for path in files():
    path.unlink()
try:
    data.render(size=(60, 40), mode="points", progress=tell)
except KeyboardInterrupt:
    print("interrupted")
"""


def eventually(happened):
    """Whether something happens before long."""
    end = time.monotonic() + 30.0
    while not happened():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


class Interrupted(WithFolder):
    def setUp(self):
        super().setUp()
        self.out = self.folder / "out"
        self.out.mkdir()
        self.raised = []
        # A shell has its background jobs ignore it.
        self.addCleanup(signal.signal, signal.SIGINT, signal.signal(signal.SIGINT, signal.default_int_handler))

    def interrupt(self):
        """Ctrl-C, from whatever thread."""
        self.raised.append(time.monotonic())
        _thread.interrupt_main()

    def ends_soon(self, work, after=None):
        """How long work goes on that is interrupted after so many seconds, or interrupts itself."""
        with self.assertRaises(KeyboardInterrupt):
            if after is not None:
                timer = threading.Timer(after, self.interrupt)
                # Where work fails before, no other test is interrupted.
                self.addCleanup(timer.cancel)
                # That the timer's thread runs at all says that others do meanwhile.
                timer.start()
            # A machine may be fast.
            while True:
                work()
        waited = time.monotonic() - self.raised.pop()
        self.assertLess(waited, SOON)
        return waited

    def is_clean(self, folder):
        """As soon as its threads have heard of it nothing is left of work but whole files."""
        self.assertTrue(eventually(lambda: all(path.suffix == ".df" for path in folder.rglob("*") if path.is_file())))
        for path in folder.rglob("*.df"):
            self.assertGreater(deepfield.open(path).count, 0)

    def test_a_picture_is_told_of_and_ends_at_what_that_raises(self):
        class Enough(Exception):
            pass

        stages = []

        def enough(stage, done, total):
            stages.append(stage)
            raise Enough

        data = deepfield.build(particles(20_000), self.out / "box.df")
        with self.assertRaises(Enough):
            data.render(size=(3000, 3000), mode="column-density", progress=enough)
        self.assertEqual(stages, ["drawing"])

    def test_what_progress_raises_ends_a_build(self):
        class Enough(Exception):
            pass

        stages = []

        def enough(stage, done, total):
            stages.append(stage)
            self.assertTrue(0 <= done and (done <= total or total == 0))
            if not stage.startswith("reading"):
                raise Enough

        with self.assertRaises(Enough):
            deepfield.build(self.many(), self.out / "box.df", progress=enough)
        self.assertFalse(stages[-1].startswith("reading"))
        self.assertTrue(eventually(lambda: not list(self.out.iterdir())))

    def many(self):
        """So many that a build takes a while, most of which it does not read: nothing is estimated."""
        random = np.random.default_rng(3)
        count = 1_000_000
        return {"positions": random.random((count, 3)), "mass": 1.0, "density": random.random(count), "smoothing_length": 0.01}

    def test_ctrl_c_ends_a_build_of_arrays_which_lets_go_of_them(self):
        arrays, waits = self.many(), []
        # Neighbours are looked for in the second build, buckets merged and codes found in the others.
        for without, after in (((), 0.1), (("density", "smoothing_length"), 0.4), ((), 0.2)):
            given = {name: values for name, values in arrays.items() if name not in without}
            waits.append(self.ends_soon(lambda: deepfield.build(given, self.out / "box.df"), after))
            self.is_clean(self.out)
        # The shortest of several says most.
        self.assertLess(min(waits), 0.3, waits)
        # They are there as long as the build's threads may read them, and no longer.
        places = weakref.ref(arrays["positions"])
        del arrays, given
        self.assertTrue(eventually(lambda: gc.collect() is not None and places() is None))

    def table(self):
        """A file of text that is read for a while, and built for longer."""
        source = self.folder / "many.csv"
        rows = np.random.default_rng(4).integers(0, 10**6, (300_000, 3)).tolist()
        source.write_text("\n".join(["x,y,z", *("%d,%d,%d" % tuple(row) for row in rows), ""]))
        return source

    def caches(self):
        """While it is entered the cache is a folder of its own."""
        cache = str(self.out / "cache")
        return unittest.mock.patch.dict(os.environ, {"XDG_CACHE_HOME": cache, "LOCALAPPDATA": cache})

    def test_ctrl_c_ends_what_opens_and_builds_files(self):
        source = self.table()
        # While the text is read, and while neighbours are looked for.
        with self.caches():
            for after in (0.05, 0.4):
                self.ends_soon(lambda: deepfield.open(source), after)
                self.is_clean(self.out)
            # It was not spoilt by that.
            self.assertEqual(deepfield.open(source).count, 300_000)
        for after in (0.05, 0.4):
            self.ends_soon(lambda: deepfield.build(source, self.out / "box.df"), after)
            self.is_clean(self.out)

    def test_ctrl_c_ends_a_tour_and_finished_frames_stay(self):
        data = deepfield.build(particles(5000), self.folder / "box.df")
        tour, frames = deepfield.Tour.around(seconds=60.0), self.out / "frames"

        def tell(*_):
            if not self.raised and len(list(frames.glob("frame-*"))) >= 2:
                self.interrupt()

        self.ends_soon(lambda: tour.render(data, frames, (160, 120), 30, progress=tell))
        names = lambda: sorted(path.name for path in frames.iterdir())
        self.assertTrue(eventually(lambda: all(name.startswith("frame-") for name in names())))
        found = names()
        self.assertTrue(2 <= len(found) < 1800, len(found))
        for name in found:
            content = (frames / name).read_bytes()
            self.assertTrue(content.startswith(b"\x89PNG") and content.endswith(b"IEND\xaeB`\x82"), name)
        # Nobody draws on.
        time.sleep(0.3)
        self.assertLessEqual(len(names()), len(found) + 1)

    def test_a_program_that_is_interrupted_ends(self):
        self.is_interrupted(ENDS, self.out / "box.df")
        self.assertEqual(list(self.out.iterdir()), [])

    def test_a_program_that_is_interrupted_ends_what_it_writes(self):
        deepfield.build(particles(500), self.folder / "box.df")
        self.is_interrupted(WRITES, self.folder / "box.df", self.out)
        names = sorted(path.name for path in self.out.iterdir())
        self.assertTrue(all(name.startswith("frame-") for name in names), names)

    def test_a_program_that_is_interrupted_ends_what_it_builds_into_the_cache(self):
        with self.caches():
            self.is_interrupted(BUILDS, self.table(), self.out / "cache")
        names = [path.name for path in self.out.rglob("*") if path.is_file()]
        self.assertTrue(all(name.endswith(".df") and not name.endswith(".new.df") for name in names), names)

    def is_interrupted(self, program, *arguments):
        """Whether a program hears of Ctrl-C and ends by itself."""
        command = [sys.executable, "-W", "ignore", "-c", program, *arguments]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=60)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "interrupted\n", ""))


if __name__ == "__main__":
    unittest.main()
