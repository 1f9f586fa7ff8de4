"""The notebooks of the documentation, as somebody runs them from the first cell to the last."""

import ast
import contextlib
import importlib.util
import io
import json
import os
import pathlib
import sys
import tempfile
import unittest
import warnings

import deepfield

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebook").glob("*.ipynb"))


def missing(code):
    """Packages that a cell imports and that are not there."""
    names = set()
    for node in ast.walk(code):
        if isinstance(node, ast.Import):
            names |= {name.name.partition(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(node.module.partition(".")[0])
    return sorted(name for name in names if importlib.util.find_spec(name) is None)


def run(path):
    """Executes the code cells of a notebook in order, but for those that lack a package; says which these are."""
    names, left_out = {"__name__": "__main__"}, []
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"], 1):
        if cell["cell_type"] != "code":
            continue
        where = f"{path.name}: cell {number}"
        code = ast.parse("".join(cell["source"]), where)
        if absent := missing(code):
            left_out.append(f"{where}: no {', '.join(absent)}")
            continue
        # What a cell ends with is shown, as Jupyter does.
        shown = code.body.pop() if code.body and isinstance(code.body[-1], ast.Expr) else None
        exec(compile(code, where, "exec"), names)
        if shown is not None:
            found = eval(compile(ast.Expression(shown.value), where, "eval"), names)
            if hasattr(found, "_repr_png_"):
                assert found._repr_png_().startswith(b"\x89PNG"), where
            repr(found)
    return left_out


@unittest.skipUnless(NOTEBOOKS, "no docs/notebook")
class Notebooks(unittest.TestCase):
    def test_they_run(self):
        for path in NOTEBOOKS:
            with self.subTest(path.name), tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as ends:
                # They stand where they find the demo dataset, and leave their figures there.
                place = pathlib.Path(folder) / "docs" / "notebook"
                place.mkdir(parents=True)
                os.symlink(ROOT / "assets", pathlib.Path(folder) / "assets", target_is_directory=True)
                ends.callback(os.chdir, os.getcwd())
                os.chdir(place)
                ends.enter_context(warnings.catch_warnings())
                warnings.simplefilter("ignore", deepfield.Note)
                said = ends.enter_context(contextlib.redirect_stdout(io.StringIO()))
                for line in run(path):
                    print(f"Not tried: {line}", file=sys.stderr)
                self.assertTrue(said.getvalue())

    def test_they_hold_code_and_words_alone(self):
        for path in NOTEBOOKS:
            notebook = json.loads(path.read_text(encoding="utf-8"))
            self.assertEqual((notebook["nbformat"], notebook["nbformat_minor"]), (4, 5))
            identifiers = [cell["id"] for cell in notebook["cells"]]
            self.assertEqual(len(set(identifiers)), len(identifiers))
            for cell in notebook["cells"]:
                self.assertIn(cell["cell_type"], ("code", "markdown"))
                if cell["cell_type"] == "code":
                    self.assertEqual((cell["outputs"], cell["execution_count"]), ([], None), f"{path.name}: results are not kept")


if __name__ == "__main__":
    unittest.main()
