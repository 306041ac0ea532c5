"""Whether a release works where it will be installed: ``python tests/release.py --write docs/validation.md``.

Builds sdist and wheel, installs them into fresh environments of every Python at hand (3.11 and newer, pyenv's too),
once with the oldest versions that pyproject.toml allows and once with the newest, and there runs the demonstration and
the tests named below, on the installed package and outside of the checkout. Needs uv and the package registry. What it
finds is kept in `benchmarks/results/release.json`; a run of some Pythons or versions leaves the rows of the others.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from benchmarks.page import put_section, record, recorded  # noqa: E402

TITLE = "## Installed releases"
INTRODUCTION = """`python tests/release.py --write docs/validation.md`

The source distribution and the wheel in fresh environments, with the oldest versions that `pyproject.toml` allows
(lowest-direct) and the newest ones (highest): the demonstration must name its effect, and the tests of all readers and
writers, simulation, estimation, discovery, reports and other processes run outside of the checkout on the installed
package."""
EXTRAS = "parquet,hdf5,xarray,modelica,cluster"
TOOLS = ("pytest>=8.2", "pytest-xdist>=3.6", "hypothesis>=6.100")
# every reader and writer, simulation, estimation, discovery, reports, other processes
TESTS = [
    "test_language",
    "test_units",
    "test_study",
    "test_data_corpus",
    "test_fuzz",
    "test_simulate",
    "test_identify",
    "test_likelihood",
    "test_discover_pendulum",
    "test_resume",
    "test_parallel",
    "test_cluster",
    "test_report",
    "test_plot",
    "test_fmi",
    "test_modelica",
]
# what is about the place of the checkout, where the package is not installed
HERE = "beside_the_checkout"
SHOWN = (
    "casadi",
    "numpy",
    "scipy",
    "pandas",
    "matplotlib",
    "pydantic",
    "typer",
    "rich",
    "fmpy",
    "jinja2",
    "pyarrow",
    "h5py",
    "distributed",
)


def main():
    """Do all, and print a table; exit code 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--python", help="versions by comma, such as 3.11,3.13; default: all at hand")
    parser.add_argument("--tests", default=",".join(TESTS), help="files by comma; none with an empty text")
    parser.add_argument("--resolution", default="lowest-direct,highest")
    parser.add_argument("--write", type=Path, help="the page that the table goes into")
    options = parser.parse_args()
    pythons = interpreters()
    wanted = options.python.split(",") if options.python else sorted(pythons, key=lambda v: int(v.split(".")[1]))
    rows = recorded("release").get("release", {})
    tests = tuple(filter(None, options.tests.split(",")))
    done = []
    with tempfile.TemporaryDirectory(prefix="cartpend-release-") as folder:
        place = Path(folder)
        place.chmod(0o755)  # a test becomes a user who may not read a log, and must still read the package
        wheel, sdist = built(place / "dist")
        todo = [("sdist", wanted[-1], "highest", sdist, ())]
        todo += [
            ("wheel", version, which, wheel, tests) for version in wanted for which in options.resolution.split(",")
        ]
        for what, version, which, package, chosen in todo:
            row = tried(what, version, pythons[version], package, which, chosen, place)
            done.append(row)
            rows[f"{what} {version} {which}"] = row
            record("release", rows)
    print("", *section(rows)[2:], sep="\n")
    if options.write:
        put_section(options.write, section(rows))
    sys.exit(0 if all(row["good"] for row in done) else 1)


def section(rows):
    """Return the section of the page."""
    lines = [TITLE, "", *INTRODUCTION.splitlines(), ""]
    lines += ["| what | Python | versions | demo | tests | seconds |", "|---|---|---|---|---|--:|"]
    for _, row in sorted(rows.items()):
        cells = (row[key] for key in ("what", "python", "versions", "demo", "tests", "seconds"))
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def uv():
    """Return the command of uv: beside this interpreter, or on the path."""
    beside = Path(sys.executable).with_name("uv")
    found = str(beside) if beside.exists() else shutil.which("uv")
    if found is None:
        sys.exit("uv is needed: pip install uv")
    return found


def interpreters():
    """Return the interpreters from 3.11 on, by version."""
    found = {}
    names = [shutil.which(f"python3.{minor}") for minor in range(11, 20)]
    names += [str(path) for path in Path("~/.pyenv/versions").expanduser().glob("3.*/bin/python")]
    for name in filter(None, names):
        done = subprocess.run([name, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"], **quiet())
        version = done.stdout.strip()
        if done.returncode == 0 and re.fullmatch(r"3\.\d+", version) and int(version[2:]) >= 11:
            found.setdefault(version, name)
    return found


def quiet():
    """Return options that keep what a command prints."""
    return {"capture_output": True, "text": True, "check": False}


def clean():
    """Return the environment without what would lead to another copy of the package."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def built(dist):
    """Build sdist and wheel, the wheel from the sdist; return their paths."""
    subprocess.run([uv(), "build", "--quiet", "--out-dir", str(dist), str(ROOT)], check=True)
    (wheel,), (sdist,) = dist.glob("*.whl"), dist.glob("*.tar.gz")
    return wheel, sdist


def tried(what, version, python, package, resolution, tests, place):
    """Install a package into a fresh environment, and run the demonstration and the tests there."""
    begin = time.monotonic()
    row = {"what": what, "python": version, "versions": resolution, "demo": "–", "tests": "–", "good": False}
    home = place / f"{what}-{version}-{resolution}"
    subprocess.run([uv(), "venv", "--quiet", "--python", python, str(home)], check=True)
    bin_ = home / "bin"
    done = installed(home, package, resolution)
    if done.returncode:
        row["versions"] += f": cannot be installed ({done.stderr.strip().splitlines()[-1][:200]})"
    else:
        row["versions"] += f" ({versions(bin_)})"
        demo = subprocess.run(
            [str(bin_ / "cartpend"), "demo", "--out", str(home / "demo")], cwd=home, env=clean(), **quiet()
        )
        row["demo"] = _demo(home / "demo" / "results" / "result.json", demo)
        row["tests"] = tested(bin_, home, tests) if tests else "–"
        row["good"] = row["demo"] == "right" and "failed" not in row["tests"] and "error" not in row["tests"]
    row["seconds"] = f"{time.monotonic() - begin:.0f}"
    print(" | ".join(str(value) for value in row.values()), flush=True)
    shutil.rmtree(home, ignore_errors=True)
    return row


def installed(home, package, resolution):
    """Install a package with the oldest or the newest versions of what pyproject.toml names, and tools to test it."""
    interpreter, locked = str(home / "bin" / "python"), str(home / "locked.txt")
    lock = [uv(), "pip", "compile", "--quiet", "--python", interpreter, "--resolution", resolution, "-o", locked]
    extras = [word for name in EXTRAS.split(",") for word in ("--extra", name)]
    # what has no wheel for a Python was not made for it
    done = subprocess.run([*lock, "--only-binary", ":all:", *extras, str(ROOT / "pyproject.toml")], **quiet())
    if done.returncode:
        return done
    install = [uv(), "pip", "install", "--quiet", "--python", interpreter, "-r", locked, str(package), *TOOLS]
    return subprocess.run(install, **quiet())


def versions(bin_):
    """Return the versions of what the package depends on."""
    code = f"from importlib.metadata import version\nprint(*(f'{{n}} {{version(n)}}' for n in {SHOWN!r}), sep=', ')"
    return subprocess.run([str(bin_ / "python"), "-c", code], **quiet()).stdout.strip()


def _demo(path, done):
    if done.returncode or not path.exists():
        print(done.stdout[-2000:], done.stderr[-2000:])
        return f"failed ({done.returncode})"
    result = json.loads(path.read_text("utf-8"))
    named = [(step["effect"], step["at"]) for step in result["steps"]]
    return "right" if named == [("coulomb_friction", "bearing")] else f"failed: {named}"


def tested(bin_, home, tests):
    """Run tests outside of the checkout, so that the installed package is meant."""
    copy = home / "checkout"
    copy.mkdir()
    for name in ("tests", "models", "docs", "pyproject.toml", "README.md"):
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, copy / name)
    # the package is that which is installed: the folder of the checkout is not on the path
    command = [
        str(bin_ / "python"),
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "--maxfail=20",
        "-k",
        f"not {HERE}",
    ]
    files = [f"tests/{name}.py" for name in tests]
    where = [str(bin_ / "python"), "-c", "import cartpend_dae; print(cartpend_dae.__file__)"]
    assert "site-packages" in subprocess.run(where, cwd=home, env=clean(), **quiet()).stdout
    # workers in other processes find the models of the tests, as they would find a user's own
    done = subprocess.run([*command, *files], cwd=copy, env=clean() | {"PYTHONPATH": str(copy)}, **quiet())
    last = done.stdout.strip().splitlines()[-1] if done.stdout.strip() else done.stderr[-300:]
    if done.returncode:
        print(
            "\n".join(line for line in done.stdout.splitlines() if line.startswith(("E ", "FAILED", "ERROR")))[-6000:]
        )
    return last.strip("= ") if not done.returncode else f"failed: {last.strip('= ')}"


if __name__ == "__main__":
    main()
