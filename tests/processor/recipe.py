"""Renders the recipe of conda-forge as rattler-build does, for what it is made for and on (pip install py-rattler-build): FOLDER."""

import pathlib
import re
import sys
import tomllib

from rattler_build import JinjaConfig, PlatformConfig, RenderConfig, Stage0Recipe, VariantConfig

COMPILERS = {"linux-64": "gcc", "linux-aarch64": "gcc", "osx-64": "clang", "osx-arm64": "clang", "win-64": "vs2022"}

folder = pathlib.Path(sys.argv[1])
python = folder / "../../python"
# What the package for Python says of itself: the oldest interpreter of its stable interface, what it needs, what makes it.
features = tomllib.loads((python / "Cargo.toml").read_text())["dependencies"]["pyo3"]["features"]
oldest = ".".join(next(filter(None, (re.fullmatch(r"abi3-py(3)(\d+)", feature) for feature in features))).groups())
described = tomllib.loads((python / "pyproject.toml").read_text())
assert described["project"]["requires-python"] == f">={oldest}", (oldest, described)
recipe = Stage0Recipe.from_file(folder / "recipe.yaml")


def spaced(requirement):
    """A requirement of PyPI as one of conda, which has a space before the versions."""
    return re.sub(r"(?<=[\w-])(?=[<>=!])", " ", requirement, count=1)


for target, compiler in COMPILERS.items():
    for machine in {target, "linux-64"}:
        platform = PlatformConfig(target_platform=target, build_platform=machine, host_platform=target)
        variants = VariantConfig.from_file_with_context(folder / "variants.yaml", JinjaConfig(platform=platform))
        (rendered,) = recipe.render(variants, RenderConfig(platform=platform))
        made = rendered.recipe.to_dict()
        script, needed = made["build"]["script"], made["requirements"]
        build, host, run = (needed.get(environment, []) for environment in ("build", "host", "run"))
        found = f"for {target} on {machine}: {made}"
        assert {f"{compiler}_{target}", f"rust_{target}", "cargo-bundle-licenses"} <= set(build), found
        # What adapters and windows need is loaded at run time, from packages on Linux and from the system elsewhere.
        assert ("libvulkan-loader" in run) == target.startswith("linux"), found
        # Completions are asked of the program, which has to run where it is compiled.
        assert any(" completions " in line for line in script) == (machine == target != "win-64"), found
        prefix = "%LIBRARY_PREFIX%" if target == "win-64" else "${PREFIX}"
        assert any("cargo install" in line and prefix in line for line in script), found
        # One package does for all versions of Python from the oldest on; where it is compiled for another machine, a Python of this one helps.
        assert made["build"]["python"] == {"version_independent": True}, found
        makers = [spaced(maker) for maker in described["build-system"]["requires"]]
        assert {f"python {oldest}.*", "python-abi3", "pip", *makers} <= set(host), found
        assert (f"cross-python_{target}" in build) == (f"python {oldest}.*" in build) == set(makers).issubset(build) == (machine != target), found
        assert {"python", *map(spaced, described["project"]["dependencies"])} <= set(run), found
        assert script[-3] == "cd python" and "-m pip install ." in script[-1], found
        (imported,) = (test["python"] for test in made["tests"] if "python" in test)
        assert "deepfield" in imported["imports"] and imported["python_version"] == [f"{oldest}.*", "*"], found
        # The licences of the project lie in the clone; the script writes those of what the program and the library are linked with.
        others = [name for name in made["about"]["license_file"] if not (folder / "../.." / name).is_file()]
        written = [pathlib.PurePath(line.split(" --output ")[1]).name for line in script if line.startswith("cargo-bundle-licenses ")]
        assert len(others) == 2 and others == written, found
