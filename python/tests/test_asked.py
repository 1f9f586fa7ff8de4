"""What is asked in ways that people try: one name, open ends, structured arrays; and what is told of what cannot be asked."""

import warnings

import numpy as np

import deepfield
from test_deepfield import ABOVE, WithFolder, particles


class Asked(WithFolder):
    def setUp(self):
        super().setUp()
        self.arrays = particles(400)
        self.out = self.folder / "box.df"
        self.data = deepfield.build(self.arrays, self.out)

    def test_one_name_is_a_name_and_not_its_letters(self):
        data, sphere = self.data, (0.5, 0.5, 0.5, 0.3)
        self.assertEqual(data.select(sphere, fields="temperature", families="gas").columns, ["family", "temperature"])
        self.assertEqual(data.select(sphere, fields="x, temperature").columns, ["family", "x", "temperature"])
        probe = data.probe(sphere, fields="temperature")
        self.assertEqual([field["name"] for field in probe["families"][0]["fields"]], ["temperature"])
        others = {"gas": {**self.arrays, "speedy": self.arrays["mass"]}, "dark": self.arrays}
        built = deepfield.build(others, self.folder / "two.df", families="gas", attributes="temperature")
        self.assertEqual(list(built.families), ["gas"])
        self.assertIn("temperature", built.families["gas"].fields)
        self.assertNotIn("speedy", built.families["gas"].fields)

    def test_ends_of_ranges_may_be_open(self):
        warm = np.median(self.arrays["temperature"])
        for ends in [(warm, None), (warm, np.inf), np.array([warm, np.inf]), [np.float32(warm), None]]:
            found = len(self.data.select(where={"temperature": ends}, fields="x"))
            self.assertLessEqual(abs(found - 200), 1)
        probe = self.data.probe
        self.refused("where: temperature: found nan, expected a number or None", probe, where={"temperature": (np.nan, None)})
        self.refused("where: found list, expected a mapping", probe, where=["temperature"])

    def test_structured_arrays_are_columns_and_packed_ones_are_read(self):
        rows = np.zeros(400, dtype=[("positions", "f8", 3), ("temperature", ">f4")])
        rows["positions"], rows["temperature"] = self.arrays["positions"], self.arrays["temperature"]
        # Places are 28 bytes apart, which is no whole number of values.
        columns = {name: rows[name] for name in rows.dtype.names}
        for source in (rows, rows.view(np.recarray), {"gas": rows}, columns):
            built = deepfield.build(source, self.folder / "rows.df")
            self.assertEqual(built.count, 400)
            np.testing.assert_allclose(built.bounds, [rows["positions"].min(axis=0), rows["positions"].max(axis=0)])
            self.assertAlmostEqual(built.families["gas"].fields["temperature"].max / rows["temperature"].max(), 1.0, places=6)

    def test_columns_that_are_no_attributes_are_told(self):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            deepfield.build({**self.arrays, "metals": np.ones((400, 4))}, self.out)
        told = [str(one.message) for one in caught]
        self.assertEqual(told, ["gas: metals: left out: found shape (400, 4), expected (n,) or (n, 3)"])
        self.assertEqual(caught[0].filename, __file__)
        self.refused(r"B: found shape .*, expected \(n,\) or \(n, 3\)", deepfield.build, {**self.arrays, "B": np.ones((400, 3, 3))}, self.out)

    def test_a_field_without_finite_values_has_no_ends(self):
        built = deepfield.build({**self.arrays, "temperature": np.full(400, np.nan)}, self.out)
        field = built.families["gas"].fields["temperature"]
        self.assertEqual((field.missing, field.min, field.max, field.mean, field.histogram), (400, None, None, None, None))
        self.assertEqual(repr(field), "<temperature>")

    def test_means_are_between_the_ends_of_values(self):
        # Splats of many pixels are drawn into a pyramid, whose filters ring beside the edge.
        wide = {**self.arrays, "smoothing_length": np.full(400, 0.15)}
        data = deepfield.build(wide, self.out)
        picture = data.render({**ABOVE, "ortho": 2.0}, (300, 300), "column-density", attribute="temperature")
        means, ends = picture.channels["S"], data.families["gas"].fields["temperature"]
        self.assertGreater(np.isnan(means).sum(), 0)
        self.assertGreaterEqual(np.nanmin(means), np.float32(ends.min))
        self.assertLessEqual(np.nanmax(means), np.float32(ends.max))

    def test_mistakes_have_names(self):
        build, render, data, arrays = deepfield.build, self.data.render, self.data, self.arrays
        self.refused("units: found temprature, expected one of positions", build, arrays, self.out, units={"temprature": "K"})
        self.refused("units: found gas", build, {"gas": arrays}, self.out, units={"gas": {"positions": "kpc"}})
        self.refused("box_size: found -1, expected a number greater than 0", build, arrays, self.out, box_size=-1)
        self.refused("redshift: found nan", build, arrays, self.out, redshift=float("nan"))
        for source in (arrays["positions"], None, 5):
            self.refused("source: found .*, expected a path, a list of paths, or a mapping", build, source, self.out)
        self.refused("source: found NoneType, expected a path", deepfield.open, None)
        self.refused("error_px: .*expected", render, error_px="fine")
        self.refused("size: .*expected", render, size=(-1, 10))
        self.refused("size: found .*whole numbers", render, size=(10.5, 10))
        self.refused("radius: found nan, expected finite numbers", render, mode="points", radius=float("nan"))
        self.refused("camera: eye: found .*, expected three numbers", render, camera={"eye": (0.0, float("nan"), 1.0)})
        self.refused("camera: found 'home', expected a Camera", render, camera="home")
        self.refused("config: found dict, expected", render, config={"annotations": {}})
        self.refused("range: found 'auto', expected", data.histogram, "temperature", range="auto")
        self.refused("ranges: found .*, expected one of x and one of y", data.phase, "mass", "temperature", ranges=((0.0, 1.0),))
        self.refused("heights: found particles, expected measured heights", data.heights)
        self.refused("shells: found 2.5", data.probe, (0.5, 0.5, 0.5, 0.2), shells=2.5)
        self.refused("count: found -1", deepfield.color_map, "viridis", -1)
        tour = deepfield.Tour.around(seconds=2.0)
        self.refused("fps: found 0, expected", tour.render, data, self.folder / "frames", (20, 10), 0)
        self.refused("pattern: found \"x\", expected", tour.render, data, self.folder / "frames", (20, 10), 1, pattern="x")
        self.assertEqual(deepfield.open(self.out).count, 400)

    def test_tables_are_asked_for_columns_and_are_no_arrays(self):
        table = self.data.select(fields=["x", "y", "temperature"])
        self.assertEqual((table[["x", "y"]].columns, len(table[["x"]])), (["x", "y"], 400))
        self.assertEqual(len(table[[0, 5]]), 2)
        with self.assertRaisesRegex(KeyError, "found z"):
            table[["x", "z"]]
        with self.assertRaisesRegex(TypeError, "to_pandas"):
            np.asarray(table)
        self.refused("table: x: found a single value", deepfield.Table, {"x": 5})
