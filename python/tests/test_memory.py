"""What builds of arrays take of memory beside the arrays, as Linux counts it."""

import subprocess
import sys
import tempfile
import unittest

# In a process of its own, whose peak is nobody else's.
BUILD = """
import sys
import numpy as np
import deepfield

folder, kind, count, allowed = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
random = np.random.default_rng(4)

def most():
    with open("/proc/self/status") as status:
        return next(1024 * int(line.split()[1]) for line in status if line.startswith("VmHWM:"))

def arrays(count):
    if kind == "points":
        return {"positions": random.random((count, 3), dtype=np.float32)}
    # The columns that are not kept are one array, each of which a copy would be made of.
    spare = random.random((count, 3))
    of_each = {name: random.random(count) for name in ("mass", "density", "temperature")}
    return {"positions": random.random((count, 3)), "smoothing_length": 0.01, **of_each, **{f"spare_{k}": spare for k in range(10)}}

def build(given):
    kept = ["temperature"] if "temperature" in given else None
    deepfield.build(given, f"{folder}/box.df", memory=allowed, threads=2, attributes=kept)

# What is loaded for any build is not the next one's.
build(arrays(2000))
given = arrays(count)
before = most()
build(given)
print(most() - before, sum(np.asarray(values).nbytes for values in given.values()))
"""


@unittest.skipUnless(sys.platform == "linux", "memory is counted in other ways")
class Builds(unittest.TestCase):
    def built(self, kind, count, allowed):
        """Builds so many particles in so much memory, and holds the build to it; how much their arrays take."""
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-W", "ignore", "-c", BUILD, folder, kind, str(count), str(allowed)]
            said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        taken, given = map(int, said.split())
        self.assertLessEqual(taken, allowed)
        # Sorted particles alone are more: something was measured.
        self.assertGreater(taken, 16 << 20)
        return given

    def test_arrays_are_read_in_place_and_a_build_keeps_to_its_memory(self):
        # As much as a file of twice as many particles is built in (tests/processor/out_of_core.rs). Copies would not fit.
        allowed = 160 << 20
        given = self.built("columns", 1_000_000, allowed)
        self.assertGreater(given, 1.5 * allowed)

    def test_a_build_of_places_alone_keeps_to_its_memory(self):
        # Densities and smoothing lengths are found, from neighbours.
        given = self.built("points", 2_000_000, 256 << 20)
        self.assertEqual(given, 24_000_000)


if __name__ == "__main__":
    unittest.main()
