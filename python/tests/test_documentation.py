"""Every example of docs/python.md, one after the other, with small files of the names that they have, and small pictures."""

import os
import pathlib
import re
import shutil
import unittest
import unittest.mock

import numpy as np

import deepfield
from test_deepfield import WithFolder
from test_tables import has

ROOT = pathlib.Path(__file__).resolve().parents[2]
CHANCE = np.random.default_rng(1)


def columns(count=500):
    return {
        "positions": CHANCE.random((count, 3)) * 50.0,
        "mass": CHANCE.random(count),
        "smoothing_length": 1.0 + CHANCE.random(count),
        "temperature": CHANCE.random(count),
    }


def write_snapshot(path, time):
    """A snapshot of Gadget's layout, in a box of 50, with particles where the examples have a halo."""
    import h5py

    halo = np.array((21.9, 39.0, 33.1)) + CHANCE.normal(0.0, 0.5, (300, 3))
    with h5py.File(path, "w") as file:
        header = file.create_group("Header").attrs
        header["NumPart_ThisFile"] = header["NumPart_Total"] = [500, 300, 0, 0, 0, 0]
        header["NumPart_Total_HighWord"], header["MassTable"] = [0] * 6, [0.0] * 6
        header["NumFilesPerSnapshot"], header["BoxSize"], header["Time"], header["Redshift"] = 1, 50.0, time, 0.0
        for family, places in ((0, np.concatenate([halo, CHANCE.random((200, 3)) * 50.0])), (1, halo)):
            group = file.create_group(f"PartType{family}")
            group["Coordinates"], group["Velocities"] = places, CHANCE.normal(0.0, 1.0, places.shape)
            group["Masses"], group["ParticleIDs"] = np.ones(len(places)), np.arange(len(places)) + 1000 * family
            if family == 0:
                group["Density"], group["SmoothingLength"] = np.ones(len(places)), np.full(len(places), 1.0)
                group["Temperature"] = CHANCE.random(len(places))


def write_groups(path):
    """Two groups of Gadget-4 with 13 subhaloes."""
    import h5py

    with h5py.File(path, "w") as file:
        header = file.create_group("Header").attrs
        header["Ngroups_ThisFile"] = header["Ngroups_Total"] = 2
        header["Nsubhalos_ThisFile"] = header["Nsubhalos_Total"] = 13
        header["NumFiles"], header["BoxSize"], header["Time"], header["Redshift"] = 1, 50.0, 1.0, 0.0
        for kind, count in (("Group", 2), ("Subhalo", 13)):
            group = file.create_group(kind)
            group[f"{kind}Pos"] = np.tile((21.9, 39.0, 33.1), (count, 1))
            group[f"{kind}Mass"] = np.arange(count, 0, -1.0) + 20.0 * (kind == "Group")
        file["Group/Group_R_Crit200"], file["Subhalo/SubhaloHalfmassRad"] = np.full(2, 2.0), np.full(13, 1.0)


class Documentation(WithFolder):
    @has("h5py")
    @has("pandas")
    @has("anywidget")
    def test_examples_run(self):
        text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
        examples = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
        self.assertGreater(len(examples), 5)
        caches = unittest.mock.patch.dict(os.environ, {name: str(self.folder / "cache") for name in ("XDG_CACHE_HOME", "LOCALAPPDATA")})
        caches.start()
        self.addCleanup(caches.stop)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        self.write_files()
        known = {"np": np, "x": CHANCE.random((500, 3)), "columns": columns}
        known |= {"m": np.ones(500), "h": np.full(500, 0.1), "t": CHANCE.random(500)}
        for example in examples:
            smaller = re.sub(r"(?<=size=\()(\d+), (\d+)", lambda of: f"{int(of[1]) // 20}, {int(of[2]) // 20}", example)
            for large, small in (("(256, 256, 128)", "(16, 16, 8)"), ("fps=30", "fps=0.2"), ("{...}", "columns()")):
                smaller = smaller.replace(large, small)
            with self.subTest(example):
                exec(compile(smaller, "docs/python.md", "exec"), known)

    def write_files(self):
        write_snapshot("snapshot_099.hdf5", 1.0)
        pathlib.Path("output").mkdir()
        for step in range(6):
            write_snapshot(f"output/snapshot_{step:03}.hdf5", 0.04 * step)
        write_groups("groups.hdf5")
        for name, family in (("galaxy.df", "gas"), ("other.df", "stars")):
            deepfield.build({family: columns()}, name)
        np.save("scan.npy", CHANCE.random((30, 40)))
        CHANCE.integers(0, 1000, (8, 16, 16), dtype=np.uint16).tofile("head.raw")
        for name in ("dem.tif", "before.tif", "after.tif"):
            shutil.copy(ROOT / "tests" / "data" / "geo.tif", name)
        shutil.copy(ROOT / "assets" / "earth" / "blue_marble.jpg", "photo.jpg")
        shutil.copy(ROOT / "tests" / "data" / "finders" / "out_0.list", "out_99.list")
        deepfield.Tour.around(seconds=20.0).write("show.ron")


if __name__ == "__main__":
    unittest.main()
