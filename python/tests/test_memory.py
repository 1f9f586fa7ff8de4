"""What builds of arrays take of memory beside the arrays, as Linux counts it."""

import subprocess
import sys
import tempfile
import unittest

# As much as a file of twice as many particles is built in (tests/processor/out_of_core.rs).
ALLOWED = 160 << 20

# In a process of its own, whose peak is nobody else's. The columns that are not kept are one array, each of which a copy would be made of.
BUILD = """
import sys
import numpy as np
import deepfield

folder, allowed = sys.argv[1], int(sys.argv[2])
random = np.random.default_rng(4)

def most():
    with open("/proc/self/status") as status:
        return next(1024 * int(line.split()[1]) for line in status if line.startswith("VmHWM:"))

def arrays(count):
    spare = random.random((count, 3))
    of_each = {name: random.random(count) for name in ("mass", "density", "temperature")}
    return {"positions": random.random((count, 3)), "smoothing_length": 0.01, **of_each, **{f"spare_{k}": spare for k in range(10)}}

def build(given):
    deepfield.build(given, f"{folder}/box.df", memory=allowed, threads=2, attributes=["temperature"])

# What is loaded for any build is not the next one's.
build(arrays(2000))
given = arrays(1_000_000)
before = most()
build(given)
print(most() - before, sum(np.asarray(values).nbytes for values in given.values()))
"""


@unittest.skipUnless(sys.platform == "linux", "memory is counted in other ways")
class Builds(unittest.TestCase):
    def test_arrays_are_read_in_place_and_a_build_keeps_to_its_memory(self):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-W", "ignore", "-c", BUILD, folder, str(ALLOWED)]
            said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        taken, given = map(int, said.split())
        # Copies would not fit.
        self.assertGreater(given, 1.5 * ALLOWED)
        self.assertLessEqual(taken, ALLOWED)
        # Sorted particles alone are more: something was measured.
        self.assertGreater(taken, 16 << 20)


if __name__ == "__main__":
    unittest.main()
