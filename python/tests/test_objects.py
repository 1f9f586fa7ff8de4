"""Transfer functions, scenes, tours and colour maps: the same as files, and what they draw."""

import unittest

import numpy as np

import deepfield
from test_deepfield import ABOVE, WithFolder, particles


class WithData(WithFolder):
    def setUp(self):
        super().setUp()
        self.data = deepfield.build(particles(800), self.folder / "box.df")


class Texts(WithFolder):
    def test_what_is_written_reads_back(self):
        names = deepfield.transfer_functions()
        self.assertIn("density-hue", names)
        for name in names:
            function = deepfield.TransferFunction.named(name)
            again = deepfield.TransferFunction(**function.fields)
            self.assertEqual(again, function, name)
            self.assertEqual(deepfield.TransferFunction.from_ron(again.to_ron()), function, name)
        own = deepfield.TransferFunction(color_map=[(0.0, "#000000"), (1.0, "#80ff00")], range=(1e-3, 7.5), gamma=1.5)
        self.assertEqual((own.gamma, own.range), (1.5, {"fixed": [1e-3, 7.5]}))
        own.write(self.folder / "own.ron")
        self.assertEqual(deepfield.TransferFunction.read(self.folder / "own.ron"), own)
        keyframes = [
            {"mode": "points", "caption": "Here", "around": {"what": {"ball": [[0.5, 0.5, 0.5], 1.0]}}},
            {"after": 2.0, "move": "flight", "camera": {"eye": [0.5, 0.5, 9.0], "target": [0.5, 0.5, 0.5]}, "time": "last"},
        ]
        tour = deepfield.Tour(keyframes=keyframes, size=(64, 48), rate=10)
        self.assertEqual(deepfield.Tour(**tour.fields), tour)
        self.assertEqual([tour.size, tour.keyframes[1]["move"], tour.keyframes[1]["time"]], [[64, 48], "flight", "last"])
        tracked = {"at": "z:1.5", "region": {"shapes": [{"Sphere": {"center": [0.5, 0.5, 0.5], "radius": 0.25}}]}}
        scene = deepfield.Scene("box.df", mode="points", settings={"radius": 3.0}, time="step:2", paths={"of": "all"},
                                selections=[{"name": "ball", "members": {"Tracked": tracked}}],
                                camera=deepfield.Camera(eye=(1, 2, 3), target=(0, 0, 0)))
        self.assertEqual(deepfield.Scene(**scene.fields), scene)
        self.assertEqual(scene.selections[0]["members"], {"Tracked": {**tracked, "at": {"redshift": 1.5}}})
        self.assertEqual([scene.time, scene.paths["of"], scene.camera["eye"]], [{"step": 2}, "all", [1.0, 2.0, 3.0]])
        self.assertEqual(scene.replace(mode="column-density", settings={}).mode, "column-density")
        fading = scene.replace(film={"from": scene.fields, "share": 0.5}, time="last")
        self.assertEqual((fading.time, fading.film["from"]["time"]), ("last", {"step": 2}))
        self.assertEqual(deepfield.Scene(**fading.fields), fading)

    def test_mistakes_are_the_programs(self):
        function, scene, tour = deepfield.TransferFunction, deepfield.Scene, deepfield.Tour
        self.refused("gamma is -1", function, gamma=-1.0)
        self.refused("no colour map `infern`|infern", function, color_map="infern")
        self.refused("colour_map", function, colour_map="inferno")
        self.refused("density-hue", function.named, "nowhere")
        self.refused("t.ron:1:.*gama", function.from_ron, "(gama: 1.0)", "t.ron")
        self.refused("pionts, expected one of column-density", scene, "box.df", mode="pionts")
        self.refused("1 to 64 datasets", scene)
        self.refused("time: found soon, expected a time such as", scene, "box.df", time="soon")
        self.refused("keyframes", tour)
        self.refused("rate", tour, keyframes=[{}], rate=-1)
        self.refused("absent.ron", scene.read, self.folder / "absent.ron")
        self.refused("color_map: found nope, expected one of inferno", deepfield.color_map, "nope")

    def test_names(self):
        maps = deepfield.color_maps()
        self.assertTrue(all(maps.values()) and {"inferno", "viridis", "grey"} <= set(maps))
        grey = deepfield.color_map("grey", 5)
        self.assertEqual((grey.dtype, grey.shape), (np.float32, (5, 3)))
        np.testing.assert_allclose(grey[[0, -1]], [[0, 0, 0], [1, 1, 1]], atol=0.01)
        self.assertIn("column-density", deepfield.modes())


class Drawn(WithData):
    def test_a_scene_draws_what_its_settings_draw(self):
        plain = self.data.render({**ABOVE, "up": (0, 1, 0)}, (48, 32), "points", radius=3.0, transfer="grey")
        said = {"mode": "points", "settings": {"radius": 3.0}, "size": (48, 32), "camera": ABOVE}
        said["transfer"] = deepfield.TransferFunction.named("grey")
        scene = deepfield.Scene(self.data, **said)
        scene.write(self.folder / "box.scene.ron")
        for of in (scene, said, self.folder / "box.scene.ron"):
            np.testing.assert_array_equal(self.data.render(scene=of).rgba, plain.rgba)
        # What is said beside it holds.
        self.assertEqual(self.data.render(scene=scene, size=(20, 10)).size, (20, 10))
        self.assertEqual(self.data.render(scene=scene, mode="column-density").mode, "column-density")
        function = deepfield.TransferFunction(color_map="viridis")
        drawn = self.data.render(scene=scene, transfer=function).rgba
        self.assertTrue((drawn != plain.rgba).any())
        # As files of the program begin.
        commented = deepfield.TransferFunction.from_ron("// Mine.\n" + function.to_ron())
        np.testing.assert_array_equal(self.data.render(scene=scene, transfer=commented).rgba, drawn)

    def test_a_tour_draws_its_frames(self):
        tour = deepfield.Tour.around(2.0)
        paths = tour.render(self.data, self.folder / "frames", (24, 16), 2, end=1.2, progress=lambda *told: None)
        self.assertEqual([path[-15:] for path in paths], ["frame-00000.png", "frame-00001.png", "frame-00002.png"])
        for number, path in enumerate(paths):
            with open(path, "rb") as file:
                frame = file.read()
            scene = tour.scene(self.data, number / 2, (24, 16))
            self.assertEqual(self.data.render(scene=scene).png(), frame, number)
        self.assertEqual(tour.picture(self.data, 0.5, (24, 16)).size, (24, 16))
        self.refused("no frame lies there", tour.render, self.data, self.folder / "none", start=50.0)
        self.refused("expected a name with one number", tour.render, self.data, self.folder / "none", pattern="frame")


if __name__ == "__main__":
    unittest.main()
