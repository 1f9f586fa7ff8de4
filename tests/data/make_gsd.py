"""Writes `trajectory.gsd`: three frames of a few particles of two types in an inclined cell, by the format's own library. Needs gsd. What is in
it, `crates/data/src/import/trajectory/gsd/tests.rs` says again."""

import gsd.hoomd
import numpy as np


def frame(k):
    count = [5, 5, 3][k]
    row = np.arange(count)
    made = gsd.hoomd.Frame()
    made.configuration.step = 100 * k
    made.configuration.box = [4, 5, 6, 0.25, 0.5, -0.5]
    made.particles.N = count
    made.particles.types = ["A", "Big_one"]
    made.particles.typeid = row % 2
    made.particles.position = np.stack([0.25 * row - 0.5, 0.5 * row - 1, 0.125 * k + 0 * row], axis=1)
    made.particles.image = np.stack([row - 2, 0 * row, k + 0 * row], axis=1)
    made.particles.velocity = np.stack([row, -row, k + 0 * row], axis=1)
    # The same in every frame: it is stored once for as many particles.
    made.particles.diameter = 0.5 * (row + 1)
    if k == 1:
        made.particles.charge = 0.5 - row
    made.log["particles/pair/energies"] = 2.0 * row + k
    made.log["value/total"] = [1.5 * k]
    return made


with gsd.hoomd.open("trajectory.gsd", "w") as file:
    file.extend(frame(k) for k in range(3))
