"""Built files behind a URL: the same as from the disk, by parts."""

import functools
import http.server
import multiprocessing
import os
import threading
import unittest.mock

import numpy as np

import deepfield
from test_deepfield import ABOVE, WithFolder, particles


def count(path):
    return deepfield.open(path).count


class Server(http.server.ThreadingHTTPServer):
    def handle_error(self, request, client_address):
        """A client that has heard enough is no fault."""


class Whole(http.server.SimpleHTTPRequestHandler):
    """Python's own server, which gives whole files."""

    def log_message(self, *_):
        pass


class Parts(Whole):
    """A server that takes ranges of bytes, and keeps what it was asked for."""

    protocol_version = "HTTP/1.1"

    def __init__(self, *arguments, asked, **settings):
        self.asked = asked
        super().__init__(*arguments, **settings)

    def do_GET(self):
        try:
            with open(self.translate_path(self.path), "rb") as file:
                content = file.read()
        except OSError:
            self.send_response(404)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        # `bytes=0-99`, or the last ones as `bytes=-100`.
        first, _, last = self.headers["Range"].removeprefix("bytes=").partition("-")
        start = int(first) if first else max(0, len(content) - int(last))
        end = min(len(content), int(last) + 1) if first else len(content)
        self.asked.append((start, end))
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {start}-{end - 1}/{len(content)}")
        self.send_header("Content-Length", str(end - start))
        self.send_header("ETag", '"first"')
        self.end_headers()
        self.wfile.write(content[start:end])


class Afar(WithFolder):
    def setUp(self):
        super().setUp()
        self.files, cache = self.folder / "files", str(self.folder / "cache")
        self.files.mkdir()
        caches = unittest.mock.patch.dict(os.environ, {"XDG_CACHE_HOME": cache, "LOCALAPPDATA": cache})
        caches.start()
        self.addCleanup(caches.stop)
        self.data = deepfield.build(particles(20_000), self.files / "box.df", units={"positions": "kpc"})

    def served(self, handler, **settings):
        """The address of a server of the files."""
        server = Server(("127.0.0.1", 0), functools.partial(handler, directory=self.files, **settings))
        self.addCleanup(server.server_close)
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        self.addCleanup(server.shutdown)
        return f"http://127.0.0.1:{server.server_address[1]}"

    def test_a_url_is_opened_drawn_and_asked_as_the_file_is(self):
        asked = []
        url = self.served(Parts, asked=asked) + "/box.df"
        data = deepfield.open(url)
        self.assertTrue(asked)
        self.assertEqual((data.paths, data.kind, data.count, data.unit), ([url], "particles", 20_000, "kpc"))
        np.testing.assert_array_equal(data.bounds, self.data.bounds)
        self.assertEqual(repr(data.families), repr(self.data.families))
        for draw in (lambda of: of.render(ABOVE, (64, 48), "column-density"), lambda of: of.render(size=(48, 32), mode="points")):
            np.testing.assert_array_equal(draw(data).rgba, draw(self.data).rgba)
        sphere = (0.4, 0.5, 0.6, 0.2)
        self.assertEqual(data.probe(sphere), self.data.probe(sphere))
        self.assertEqual(deepfield.Scene(data, mode="points").datasets[0]["path"], url)
        deepfield.build(particles(100, 8), self.files / "stars.df", family="stars", units={"positions": "kpc"})
        self.assertEqual(deepfield.open([url, self.files / "stars.df"]).count, 20_100)

    @unittest.skipUnless(hasattr(os, "fork"), "this system has no fork")
    def test_processes_that_are_forked_read_from_afar_too(self):
        here = self.served(Parts, asked=[])
        deepfield.build(particles(100, 8), self.files / "stars.df")
        self.assertEqual(count(f"{here}/box.df"), 20_000)
        with multiprocessing.get_context("fork").Pool(1) as pool:
            # What attends to the first one's connections is not there, and one file is open already.
            names = [f"{here}/stars.df", f"{here}/box.df"]
            self.assertEqual(pool.map_async(count, names).get(60.0), [100, 20_000])

    def test_what_cannot_be_read_from_afar_is_told(self):
        here = self.served(Parts, asked=[])
        self.refused("absent.df.*has no such file", deepfield.open, f"{here}/absent.df")
        (self.files / "box.csv").write_text("x,y,z\n0,0,0\n1,1,1\n")
        self.refused("box.csv.*found a file that was not built", deepfield.open, f"{here}/box.csv")
        self.refused("box.df.*gives whole files only", deepfield.open, self.served(Whole) + "/box.df")


if __name__ == "__main__":
    unittest.main()
