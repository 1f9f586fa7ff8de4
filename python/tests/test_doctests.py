"""The examples of the package's docstrings, with `data` and `np` at hand and in a folder of their own, in which `movie.xyz` is a run."""

import doctest
import importlib.util
import os
import pathlib
import pkgutil
import tempfile
import unittest
import warnings

import numpy as np

import deepfield
from test_deepfield import write_movie


def load_tests(loader, tests, pattern):
    names = ["deepfield", *(f"deepfield.{found.name}" for found in pkgutil.iter_modules(deepfield.__path__))]
    for name in names:
        # What it is from the package's root is described where it is defined.
        module = importlib.import_module(name)
        tests.addTests(doctest.DocTestSuite(module, setUp=_begin, tearDown=_end, optionflags=doctest.NORMALIZE_WHITESPACE))
    return tests


def _begin(test):
    if test.name.endswith("to_pandas") and not importlib.util.find_spec("pandas"):
        raise unittest.SkipTest("pandas is not installed")
    caught = warnings.catch_warnings()
    caught.__enter__()
    warnings.simplefilter("ignore", deepfield.Note)
    folder = tempfile.TemporaryDirectory()
    test.ends = [(os.chdir, os.getcwd()), (folder.cleanup,), (caught.__exit__, None, None, None)]
    os.chdir(folder.name)
    chance = np.random.default_rng(1)
    gas = {"positions": chance.random((200, 3)), "mass": 1.0, "smoothing_length": 0.1, "temperature": chance.random(200)}
    test.globs |= {"deepfield": deepfield, "np": np, "data": deepfield.build(gas, "box.df", units={"positions": "kpc"})}
    write_movie(pathlib.Path("movie.xyz"), chance.random((60, 3)))


def _end(test):
    for end, *arguments in test.ends:
        end(*arguments)


if __name__ == "__main__":
    unittest.main()
