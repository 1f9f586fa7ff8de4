"""Selections, probes, profiles, histograms and phase diagrams, beside what NumPy finds, and tables as other packages read them."""

import importlib.util
import unittest

import numpy as np

import deepfield
from test_deepfield import WithFolder, particles


def has(package):
    return unittest.skipUnless(importlib.util.find_spec(package), f"{package} is not installed")


class OfFiles(WithFolder):
    """A page file of a source that is still there: rows are the source's own."""

    def setUp(self):
        super().setUp()
        arrays = particles()
        self.arrays = {**arrays, "ids": np.arange(3000) * 7 + 2**40}
        source = self.folder / "box.csv"
        names = "id,x [kpc],y [kpc],z [kpc],mass,smoothing_length,temperature [K]"
        with source.open("w") as file:
            file.write(names + "\n")
            columns = [arrays[name] for name in ("mass", "smoothing_length", "temperature")]
            for row in zip(self.arrays["ids"], *arrays["positions"].T, *columns):
                file.write(",".join(repr(value.item()) for value in row) + "\n")
        self.data = deepfield.build(source, self.folder / "box.df")
        self.center, self.radius = np.array([0.4, 0.5, 0.6]), 0.3
        self.sphere = (*self.center, self.radius)
        self.inside = np.linalg.norm(arrays["positions"] - self.center, axis=1) <= self.radius

    def test_a_selection_is_the_source_rows(self):
        found = self.data.select(sphere=self.sphere)
        self.assertTrue(found.about["exact"])
        self.assertEqual(len(found), self.inside.sum())
        np.testing.assert_array_equal(found["id"], self.arrays["ids"][self.inside])
        for axis, name in enumerate("xyz"):
            np.testing.assert_array_equal(found[name], self.arrays["positions"][self.inside, axis])
        np.testing.assert_array_equal(found["temperature"], self.arrays["temperature"][self.inside])
        self.assertEqual((found.units["x"], found.units["temperature"]), ("kpc", "K"))
        self.assertEqual(set(found["family"]), set(self.data.families))
        cold = self.data.select(self.sphere, where={"temperature": (None, 3000.0)}, fields=["temperature", "position"])
        self.assertEqual(cold.columns, ["family", "temperature", "x", "y", "z"])
        some = found[found["temperature"] <= 3000.0]
        for name in cold:
            np.testing.assert_array_equal(cold[name], some[name])
        # In any order and twice, ids name each once.
        ids = self.arrays["ids"][[5, 3, 3, 2999]]
        again = self.data.select(ids=ids, fields=["id", "mass"])
        self.assertEqual(sorted(again["id"]), sorted(set(ids)))
        self.assertEqual(len(self.data.select(ids=[])), 0)
        box = self.data.select(box=(0.0, 0.0, 0.0, 0.5, 1.0, 1.0), fields=["x"])
        np.testing.assert_array_equal(box["x"], self.arrays["positions"][self.arrays["positions"][:, 0] <= 0.5, 0])

    def test_mistakes_are_told(self):
        select = self.data.select
        self.refused("sphere: found .*, expected x, y, z, radius", select, sphere=(1.0, 2.0))
        self.refused("field temperatur: not there, expected one of id, x", select, fields=["temperatur"])
        self.refused("expected at most 100 bytes", select, memory=100)
        self.refused("ids: found a region, too", select, self.sphere, ids=[1])
        self.refused("ids: found an array of float64", select, ids=[0.5])
        self.refused("bins is 0", self.data.histogram, "temperature", 0)
        self.refused("range is", self.data.histogram, "temperature", range=(2.0, 1.0))
        self.refused("paths: found .*, expected a run", self.data.tracks)

    def test_profiles_and_histograms_are_what_numpy_finds(self):
        settings = {"exact": True}
        mass, temperature = self.arrays["mass"], self.arrays["temperature"]
        found = self.data.histogram("temperature", 20, range=(100.0, 1e5), log=True, **settings)
        np.testing.assert_allclose(found.edges[[0, -1]], [100.0, 1e5])
        weights, _ = np.histogram(temperature, found.edges, weights=mass)
        counts, _ = np.histogram(temperature, found.edges)
        # A value on an edge may fall to either side of it.
        self.assertLessEqual(np.abs(found.counts.astype(int) - counts).sum(), 2)
        np.testing.assert_allclose(found.weights, weights, atol=4.0)
        self.assertEqual((found.unit, found.weight, found.about["exact"]), ("K", "mass", True))
        phase = self.data.phase("temperature", "mass", (8, 5), "count", ((100.0, 1e5), None), (True, False), **settings)
        self.assertEqual(phase.counts.shape, (5, 8))
        expected, _, _ = np.histogram2d(mass, temperature, (phase.y_edges, phase.x_edges))
        self.assertLessEqual(np.abs(phase.counts.astype(int) - expected).sum(), 4)
        profile = self.data.profile(self.sphere, 6, ["temperature", "mass"], log=False, **settings)
        self.assertEqual((len(profile), profile["count"].sum()), (6, self.inside.sum()))
        radius = np.linalg.norm(self.arrays["positions"] - self.center, axis=1)
        for row in range(6):
            shell = (radius > profile["radius_from"][row]) & (radius <= profile["radius_to"][row])
            np.testing.assert_allclose(profile["mass"][row], mass[shell].sum())
            np.testing.assert_allclose(profile["mean_temperature"][row], temperature[shell].mean())
            np.testing.assert_allclose(profile["mean_mass"][row], mass[shell].mean())
        self.assertEqual(profile.units["mean_temperature"], "K")
        self.assertEqual(list(profile.about["fields"]), ["temperature", "mass"])

    @has("pyarrow")
    def test_arrow_reads_tables_without_a_copy(self):
        import pyarrow

        found = self.data.select(self.sphere)
        read = pyarrow.table(found)
        self.assertEqual(read.num_rows, len(found))
        self.assertEqual(read.column_names, found.columns)
        for name in found:
            self.assertEqual(read[name].to_pylist(), found[name].tolist(), name)
        self.assertEqual(read.schema.field("x").metadata, {b"unit": b"kpc"})
        numbers = {"id": pyarrow.uint64(), "x": pyarrow.float64(), "temperature": pyarrow.float64()}
        self.assertEqual(read.schema.field("family").type, pyarrow.large_string())
        for name, kind in numbers.items():
            address = read[name].chunk(0).buffers()[1].address
            self.assertEqual((read.schema.field(name).type, address), (kind, found[name].__array_interface__["data"][0]), name)
        # Columns outlive the table, and what nobody takes is given up.
        x, expected = read["x"], found["x"].tolist()
        del found, read
        self.assertEqual(x.to_pylist(), expected)
        table = deepfield.Table({"a": np.arange(5, dtype=np.float32)[::2], "b": np.array([1, -2, 3], np.int16)}, {"a": "K"})
        for _ in range(100):
            table.__arrow_c_stream__()
        self.assertEqual(pyarrow.table(table).to_pydict(), {"a": [0.0, 2.0, 4.0], "b": [1, -2, 3]})
        self.assertEqual(pyarrow.table(table).schema.types, [pyarrow.float32(), pyarrow.int64()])
        self.assertEqual(pyarrow.table(self.data.select(ids=[])).num_rows, 0)
        probed = self.data.probe(self.sphere, exact=True).table
        self.assertEqual(pyarrow.table(probed).column_names, probed.columns)
        self.refused("found 3 rows, expected 2", deepfield._deepfield.arrow_stream, [("a", "", np.zeros(2)), ("b", "", np.zeros(3))])

    def test_a_probe_is_a_table_of_families(self):
        found = self.data.probe(self.sphere, fields=["temperature", "mass"], exact=True)
        table = found.table
        mass, temperature = (self.arrays[name][self.inside] for name in ("mass", "temperature"))
        self.assertEqual((list(table["family"]), table["count"].tolist()), (list(self.data.families), [self.inside.sum()]))
        near = lambda name, value: np.testing.assert_allclose(table[name], [value], rtol=1e-6, err_msg=name)
        near("mass", mass.sum())
        for axis, name in enumerate("xyz"):
            near(f"center_{name}", np.average(self.arrays["positions"][self.inside, axis], weights=mass))
        near("mean_temperature", temperature.mean())
        near("dispersion_temperature", temperature.std())
        near("mass_weighted_mean_temperature", np.average(temperature, weights=mass))
        near("min_temperature", temperature.min())
        near("max_mass", mass.max())
        self.assertEqual([table.units[name] for name in ("center_x", "max_temperature")], ["kpc", "K"])
        self.assertTrue(table.about["exact"])
        self.assertEqual(len(self.data.probe((9.0, 9.0, 9.0, 0.1)).table), 0)

    @has("pandas")
    def test_pandas_has_units_and_families(self):
        found = self.data.select(self.sphere)
        frame = found.to_pandas()
        self.assertEqual((list(frame), len(frame), frame.attrs["units"]), (found.columns, self.inside.sum(), found.units))
        for name in found:
            self.assertEqual(frame[name].tolist(), found[name].tolist(), name)


class OfArrays(WithFolder):
    def test_rows_of_a_page_file_are_within_its_rounding(self):
        arrays = particles(500)
        data = deepfield.build(arrays, self.folder / "box.df")
        with self.assertWarnsRegex(deepfield.Note, "values are those of the page file"):
            found = data.select(fields=["x", "temperature"])
        self.assertFalse(found.about["exact"])
        np.testing.assert_allclose(np.sort(found["x"]), np.sort(arrays["positions"][:, 0]), atol=1e-4)
        fields = ["temperature", "mass"]
        told = data.profile((0.0, 0.0, 0.0, 1e3), 3, fields).about["fields"]
        alone = [data.profile((0.0, 0.0, 0.0, 1e3), 3, field).about["error"]["values"] for field in fields]
        np.testing.assert_allclose([told[field]["error"]["values"] for field in fields], alone)
        self.refused("arrays|source", data.select, exact=True)
        self.refused("arrays|source", data.select, ids=[1])


if __name__ == "__main__":
    unittest.main()
