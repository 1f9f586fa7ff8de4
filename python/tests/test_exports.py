"""Tables that the program writes, as the libraries read them that users of these formats have.

DEEPFIELD_PROGRAM names the program; without it, and for each library that is not installed, tests are skipped.
"""

import os
import subprocess
import unittest

import numpy as np

from test_deepfield import WithFolder, particles
from test_tables import has

PROGRAM = os.environ.get("DEEPFIELD_PROGRAM")


@unittest.skipUnless(PROGRAM, "DEEPFIELD_PROGRAM names no program")
class Exports(WithFolder):
    def setUp(self):
        super().setUp()
        made = particles(500)
        velocities = np.random.default_rng(8).normal(0.0, 1e3, (500, 3))
        # Between those that double precision holds.
        self.ids = np.arange(500, dtype=np.uint64) * np.uint64(3) + np.uint64(2**60 + 1)
        self.columns = dict(zip(["x", "y", "z"], made["positions"].T)) | dict(zip(["vx", "vy", "vz"], velocities.T))
        self.columns |= {name: made[name].astype(float) for name in ("mass", "smoothing_length", "temperature")}
        units = {"x": "kpc", "y": "kpc", "z": "kpc", "vx": "km/s", "vy": "km/s", "vz": "km/s", "mass": "Msun", "temperature": "K"}
        self.source = self.folder / "box.csv"
        names = ["id", *(f"{name} [{units[name]}]" if name in units else name for name in self.columns)]
        rows = zip(self.ids.tolist(), *(values.tolist() for values in self.columns.values()))
        lines = [",".join(names), *(",".join(map(repr, row)) for row in rows)]
        self.source.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def written(self, name):
        out = self.folder / name
        subprocess.run([PROGRAM, "select", self.source, "-o", out], check=True, stdout=subprocess.DEVNULL)
        return out

    def compare(self, ids, column):
        """Ids and numbers are the source's, to the last bit; `column` gives one by its name."""
        np.testing.assert_array_equal(np.asarray(ids, np.uint64), self.ids)
        for name, expected in self.columns.items():
            found = np.asarray(column(name))
            self.assertEqual(found.dtype.itemsize, 8, name)
            np.testing.assert_array_equal(found, expected, name)

    @has("pyarrow")
    def test_pyarrow_reads_parquet(self):
        import pyarrow.parquet

        file = pyarrow.parquet.ParquetFile(self.written("box.parquet"))
        table = file.read()
        self.assertEqual((table["id"].type, table["x"].type), (pyarrow.uint64(), pyarrow.float64()))
        self.compare(table["id"].to_numpy(), lambda name: table[name.replace("_", "-")].to_numpy())
        self.assertEqual(set(table["family"].to_pylist()), {"dark"})
        about = file.metadata.metadata
        self.assertEqual([about[key] for key in (b"unit.x", b"unit.mass", b"deepfield.exact")], [b"kpc", b"Msun", b"true"])

    @has("h5py")
    def test_h5py_reads_a_snapshot(self):
        import h5py

        names = {"mass": "Masses", "smoothing_length": "SmoothingLength", "temperature": "Temperature"}
        with h5py.File(self.written("box.hdf5")) as file:
            group = file["PartType1"]
            vectors = {"x": group["Coordinates"][:], "vx": group["Velocities"][:]}

            def column(name):
                if name in names:
                    return group[names[name]][:]
                return vectors["v" * (len(name) - 1) + "x"][:, "xyz".index(name[-1])]

            self.compare(group["ParticleIDs"][:], column)
            self.assertEqual(group["ParticleIDs"].dtype, np.uint64)
            self.assertEqual(group["Coordinates"].shape, (500, 3))
            said = file["Header"].attrs
            for name in ("NumPart_ThisFile", "NumPart_Total"):
                self.assertEqual(list(said[name]), [0, 500, 0, 0, 0, 0], name)
            self.assertEqual((list(said["MassTable"]), said["BoxSize"]), ([0.0] * 6, 0.0))
            np.testing.assert_allclose(group["Coordinates"].attrs["to_cgs"], 3.0857e21, 1e-4)

    @has("astropy")
    def test_astropy_reads_fits(self):
        from astropy.io import fits

        with fits.open(self.written("box.fits")) as file:
            file.verify("exception")
            table = file[1]
            self.compare(table.data["id"], lambda name: table.data[name])
            units = {column.name: column.unit for column in table.columns}
            self.assertEqual([units[name] for name in ("x", "vx", "mass", "temperature")], ["kpc", "km/s", "Msun", "K"])
            self.assertEqual(set(table.data["family"]), {1})

    @has("plyfile")
    def test_plyfile_reads_points(self):
        import plyfile

        file = plyfile.PlyData.read(self.written("box.ply"))
        points = file["vertex"]
        low, high = (points[name].astype(np.uint64) for name in ("id_low", "id_high"))
        self.compare(low | high << np.uint64(32), lambda name: points[name.replace("_", "-")])
        self.assertEqual(set(points["family"]), {1})

    @has("vtk")
    def test_vtk_reads_points(self):
        from vtkmodules.util.numpy_support import vtk_to_numpy  # type: ignore
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader  # type: ignore

        reader = vtkXMLPolyDataReader()
        reader.SetFileName(str(self.written("box.vtp")))
        reader.Update()
        self.assertEqual(reader.GetErrorCode(), 0)
        points = reader.GetOutput()
        self.assertEqual((points.GetNumberOfPoints(), points.GetNumberOfVerts()), (500, 500))
        arrays = points.GetPointData()
        vectors = {"x": vtk_to_numpy(points.GetPoints().GetData()), "vx": vtk_to_numpy(arrays.GetArray("velocity"))}

        def column(name):
            if name[-1] in "xyz":
                return vectors["v" * (len(name) - 1) + "x"][:, "xyz".index(name[-1])]
            return vtk_to_numpy(arrays.GetArray(name.replace("_", "-")))

        self.compare(vtk_to_numpy(arrays.GetArray("id")), column)
        self.assertEqual(set(vtk_to_numpy(arrays.GetArray("family"))), {1})
        units = {name: arrays.GetArray(name).GetInformation() for name in ("velocity", "mass", "temperature")}
        label = arrays.GetArray("mass").UNITS_LABEL()
        self.assertEqual({name: unit.Get(label) for name, unit in units.items()}, {"velocity": "km/s", "mass": "Msun", "temperature": "K"})


if __name__ == "__main__":
    unittest.main()
