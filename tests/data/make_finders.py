"""Writes `particles.txt`, as Rockstar reads it, and `particles.gadget`, Gadget's binary format: four clumps in a box of 20 Mpc/h, of particles of 1e11
Msun/h each. What finders of haloes wrote of them is in `finders`; where clumps are, `tests/processor/explore/halo_catalogues.rs` says again.

    rockstar -c rockstar.cfg particles.txt    # FILE_FORMAT "ASCII", PARTICLE_MASS 1e11, h0 0.7, Ol 0.7, Om 0.3, FORCE_RES 0.01, BOX_SIZE 20
    rockstar -c server.cfg                    # the same and PARALLEL_IO 1, NUM_BLOCKS 1, NUM_WRITERS 1, PERIODIC 0: `out_0.list`
    AHF AHF.input dvir.list                   # ic_filetype 60, LgridDomain 64, NperDomCell and NperRefCell 5, NminPerHalo 20, GADGET_MUNIT 1e10; 200
    stf -C vr.cfg -i particles.gadget -s 1 -I 1 -o clumps    # its `sample_dmcosmological_3dfof.cfg` for Binary_output 0, from 20 particles on
"""

import struct

import numpy as np

# Where clumps are and their scale, Mpc/h, and how many particles they have.
CLUMPS = [((4.0, 5.0, 6.0), 400, 0.15), ((12.0, 3.0, 15.0), 200, 0.12), ((16.5, 14.0, 8.0), 100, 0.08), ((4.55, 5.3, 6.2), 60, 0.03)]


def particles():
    """Places and velocities of spheres of Plummer, which move together."""
    random = np.random.default_rng(7)
    places, velocities = [], []
    for centre, count, scale in CLUMPS:
        radius = scale / np.sqrt(random.uniform(0.001, 0.93, count) ** (-2 / 3) - 1)
        direction = random.normal(size=(count, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        places.append(np.array(centre) + radius[:, None] * direction)
        dispersion = np.sqrt(4.30091e-9 * 1e11 * count / (6 * np.sqrt(radius**2 + scale**2)))
        velocities.append(dispersion[:, None] * random.normal(size=(count, 3)) * 0.8 + np.array([100.0, -50.0, 25.0]))
    return np.vstack(places), np.vstack(velocities)


places, velocities = particles()
count = len(places)
ids = np.arange(1, count + 1, dtype="<u4")
with open("particles.txt", "w") as file:
    for place, velocity, number in zip(places, velocities, ids):
        print(*place, *velocity, number, file=file)
counts, none = (0, count, 0, 0, 0, 0), [0] * 6
masses = (0, 10.0, 0, 0, 0, 0)
header = struct.pack("<6i6ddd2i6i2i4d2i6i", *counts, *masses, 1.0, 0.0, 0, 0, *counts, 0, 1, 20.0, 0.3, 0.7, 0.7, 0, 0, *none).ljust(256, b"\0")
with open("particles.gadget", "wb") as file:
    for block in (header, places.astype("<f4").tobytes(), velocities.astype("<f4").tobytes(), ids.tobytes()):
        file.write(struct.pack("<I", len(block)) + block + struct.pack("<I", len(block)))
