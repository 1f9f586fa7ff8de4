"""What is asked in ways that people try: one name, open ends, structured arrays; and what is told of what cannot be asked."""

import copy
import inspect
import os
import pathlib
import re
import unittest.mock
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

    def told(self, source, **settings):
        """The fields of a build's gas beside those that all have, and what is told of it here."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            built = deepfield.build(source, self.out, **settings)
        self.assertEqual({one.filename for one in caught} | {__file__}, {__file__})
        fields = set(built.families["gas"].fields) - {"mass", "density", "smoothing-length"}
        return fields, [str(one.message) for one in caught]

    def test_columns_that_are_no_attributes_are_told(self):
        _, told = self.told({**self.arrays, "metals": np.ones((400, 4))})
        self.assertEqual(told, ["gas: metals: left out: found shape (400, 4), expected (n,) or (n, 3)"])
        self.refused(r"B: found shape .*, expected \(n,\) or \(n, 3\)", deepfield.build, {**self.arrays, "B": np.ones((400, 3, 3))}, self.out)

    def test_a_table_has_texts_which_are_left_out(self):
        rows = np.zeros(400, dtype=[("positions", "f8", 3), ("name", "U5"), ("kind", "S3"), ("flag", "?"), ("notes", "O"), ("seen", "M8[D]")])
        rows["positions"] = self.arrays["positions"]
        left = [f"gas: {name}: left out: found an array of {rows.dtype[name]}, expected numbers" for name in ("name", "kind", "notes", "seen")]
        for source in (rows, {"gas": rows}):
            self.assertEqual(self.told(source), ({"flag"}, left))
        # Columns of a mapping were chosen.
        self.refused("gas: name: found an array of .*, expected numbers", deepfield.build, {**self.arrays, "name": rows["name"]}, self.out)

    def test_the_most_telling_attributes_are_kept_of_more_than_there_are_places_for(self):
        several = {name: np.arange(400.0) for name in "abcde"}
        expected = "left out: found too many attributes, expected at most 5 with those that are derived; attributes= names others"
        self.assertEqual(self.told({**several, "positions": self.arrays["positions"]}), (set("abcde"), []))
        self.assertEqual(self.told({**several, **self.arrays}), ({"temperature", *"abcd"}, [f"gas: e: {expected}"]))
        moving = {**several, **self.arrays, "velocities": np.random.default_rng(1).random((400, 3))}
        derived = {"divergence", "vorticity"}
        found = ({"temperature", "speed", "a", *derived}, [f"gas: b, c, d, e: {expected}"])
        self.assertEqual(self.told(moving, derive=sorted(derived)), found)
        # Of each family so many.
        both = {"gas": {**self.arrays, **several}, "dark": {"positions": self.arrays["positions"], **several}}
        self.assertEqual(self.told(both), ({"temperature", *"abcd"}, [f"gas: e: {expected}"]))
        self.assertEqual(self.told(moving, attributes="e, b"), ({"e", "b"}, []))
        self.refused("at most 5 can be kept", deepfield.build, moving, self.out, attributes=[*several, "speed"])

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

    def test_every_field_of_a_configuration_has_a_name(self):
        with self.assertRaises(deepfield.Error) as caught:
            self.data.render(config="(nothing: 1)")
        _, _, expected = str(caught.exception).partition("expected one of")
        fields = set(re.findall(r"`(\w+)`", expected))
        # What may be left undrawn is said as settings, volume as transfer, residency as memory; it is the processor that draws.
        self.assertEqual(
            fields - set(inspect.signature(self.data.render).parameters),
            {"budget", "volume", "residency", "backend"},
        )

    def test_names_say_what_a_configuration_says(self):
        near = {"eye": (0.5, 0.5, 3.0), "target": (0.5, 0.5, 0.5), "up": (0.0, 1.0, 0.0), "fov": 45.0}
        objects = self.folder / "objects.csv"
        objects.write_text("name,x,y,z,radius\nhere,0.5,0.5,0.5,0.2\n")
        ball = {"Sphere": {"center": np.full(3, 0.5), "radius": 0.3}}
        red = {"name": "ball", "color": "#ff0000", "members": {"Region": {"shapes": [ball]}}}
        red_in_ron = '(name: "ball", color: "#ff0000", members: Region((shapes: [Sphere(center: (0.5, 0.5, 0.5), radius: 0.3)])))'
        pair = {"kind": "off-axis", "separation": 0.2, "zero_parallax": 2.5, "eyes": "side-by-side"}

        def drawn(**names):
            return self.data.render(near, (320, 240), "points", **names).rgba

        plain = drawn()
        for names, ron in [
            ({"annotations": {"axes": True, "caption": "z = 0"}}, 'annotations: (axes: true, caption: "z = 0")'),
            ({"annotations": True}, "annotations: ()"),
            ({"annotations": True, "catalogue": objects}, f"annotations: (), catalogue: {str(objects)!r}".replace("'", '"')),
            ({"cut": {"clip": {"min": np.zeros(3), "max": (1, 1, 0.5)}}}, "cut: (clip: (min: (0.0, 0.0, 0.0), max: (1.0, 1.0, 0.5)))"),
            ({"cut": {"slab": {"axis": "y", "middle": 0.5, "thickness": 0.1}}}, "cut: (slab: (axis: y, middle: 0.5, thickness: 0.1))"),
            ({"selections": [red]}, f"selections: [{red_in_ron}]"),
            ({"projection": "dome"}, "projection: dome()"),
            ({"projection": {"dome": {"aperture": 210, "tilt": 20}}}, "projection: dome(aperture: 210.0, tilt: 20.0)"),
            ({"stereo": pair}, "stereo: (kind: off-axis, separation: 0.2, zero_parallax: 2.5, eyes: side-by-side)"),
            ({"bloom": {"strength": 1, "threshold": 0}}, "bloom: (strength: 1.0, threshold: 0.0)"),
        ]:
            with self.subTest(ron):
                found = drawn(**names)
                np.testing.assert_array_equal(found, drawn(config=f"({ron})"))
                self.assertFalse(np.array_equal(found, plain))
        # Names hold, then the configuration, then the scene.
        np.testing.assert_array_equal(drawn(annotations=False, config="(annotations: (axes: true))"), plain)
        scene = {"projection": {"dome": {}}, "annotations": {"axes": True}, "camera": near}
        np.testing.assert_array_equal(drawn(projection="flat", scene=scene, config="(annotations: (axes: true))", annotations=False), plain)
        np.testing.assert_array_equal(drawn(transfer={"color_map": "grey"}), drawn(transfer=deepfield.TransferFunction(color_map="grey")))

    def test_a_source_is_built_in_the_memory_that_is_said(self):
        cache = str(self.folder / "cache")
        caches = unittest.mock.patch.dict(os.environ, {"XDG_CACHE_HOME": cache, "LOCALAPPDATA": cache})
        caches.start()
        self.addCleanup(caches.stop)
        source = self.folder / "box.csv"
        np.savetxt(source, self.arrays["positions"], delimiter=",", header="x,y,z", comments="")
        self.refused("memory: found 'much'", deepfield.open, source, memory="much")
        self.refused("takes .* of memory, more than the .* MiB that the build may take", deepfield.open, source, memory="100 kB")
        self.assertEqual(deepfield.open(source, memory="256MiB").count, 400)
        # What is there is not built again.
        data = deepfield.open(source, memory="100 kB")
        self.assertEqual(data.count, 400)
        # A copy is of the same mind where it is built again.
        for path in pathlib.Path(cache).rglob("*.df"):
            path.unlink()
        self.refused("takes .* of memory, more than", copy.copy, data)

    def test_mistakes_have_names(self):
        build, render, data, arrays = deepfield.build, self.data.render, self.data, self.arrays
        self.refused("units: found temprature, expected one of positions", build, arrays, self.out, units={"temprature": "K"})
        self.refused("units: found gas", build, {"gas": arrays}, self.out, units={"gas": {"positions": "kpc"}})
        self.refused("box_size: found -1, expected a number greater than 0", build, arrays, self.out, box_size=-1)
        self.refused("redshift: found nan", build, arrays, self.out, redshift=float("nan"))
        for source in (arrays["positions"], None, 5):
            self.refused("source: found .*, expected a path, a list of paths, or a mapping", build, source, self.out)
        self.refused("source: found NoneType, expected a path", deepfield.open, None)
        for name in ("attributes", "families", "derive", "hierarchy"):
            self.refused(f"^{name}: found 5, expected a name, or a list of names", build, arrays, self.out, **{name: 5})
        self.refused("families: found 5, expected a name", data.probe, families=5)
        self.refused("fields: found 0.5, expected a name", data.select, fields=0.5)
        self.refused("error_px: .*expected", render, error_px="fine")
        self.refused("size: .*expected", render, size=(-1, 10))
        self.refused("size: found .*whole numbers", render, size=(10.5, 10))
        self.refused("radius: found nan, expected finite numbers", render, mode="points", radius=float("nan"))
        self.refused("camera: eye: found .*, expected three numbers", render, camera={"eye": (0.0, float("nan"), 1.0)})
        self.refused("camera: found 'home', expected a Camera", render, camera="home")
        self.refused("config: found dict, expected", render, config={"annotations": {}})
        self.refused("annotations: legnd: unknown field `legnd`, expected one of `legend`", render, annotations={"axes": True, "legnd": True})
        self.refused("cut: slab: missing field `thickness`", render, cut={"slab": {"axis": "y", "middle": 0.5}})
        self.refused("max: found .*, expected finite numbers", render, cut={"clip": {"min": (0, 0, 0), "max": (1, 1, np.inf)}})
        self.refused("projection: aperture: found 400, expected above 0 and at most 360", render, projection={"dome": {"aperture": 400}})
        pair = {"kind": "off-axis", "separation": 0.2, "zero_parallax": 2.0}
        self.refused("stereo: off-axis is for flat pictures", render, size=(20, 20), mode="points", projection="dome", stereo=pair)
        self.refused("projection: unknown variant `done`, expected one of `flat`, `dome`", render, projection="done")
        self.refused("interpolation: unknown variant `fast`, expected one of `auto`", render, interpolation="fast")
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
