"""Platform campaign: wheel and sdist in clean environments of each Python, odd surroundings, locked and lowest versions.

    python tests/campaigns/platforms.py [--pythons PATH ...] [--work DIR] [--only wheel sdist lowest]
    python tests/campaigns/platforms.py --lock > tests/constraints.txt     # the versions of this environment

Builds wheel and sdist from the repository. For each Python (those of pyenv from 3.11 on, or --pythons) a new environment gets the
wheel with the versions of tests/constraints.txt (on the first, the sdist too), and on the first Python another one the lowest
versions that pyproject.toml promises. In each: --version, the four materials, and a simulation of the quickstart, which must give
the same forces within 1e-6; on the wheel also without display, home folder and locale, with read-only site-packages, from a path
with spaces and foreign letters, under umask 077. Prints a line for each; exit code 1 when one failed.
"""

import argparse
import contextlib
import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

HOME = Path(__file__).parents[2]
CONSTRAINTS = HOME / "tests" / "constraints.txt"
MATERIALS = {"transversely_isotropic", "neo_hookean", "mooney_rivlin", "holzapfel", "ogden", "ogden2", "ogden3"} | {
    "yeoh",
    "gent",
    "demiray_fung",
    "arruda_boyce",
    "polynomial",
}
SIMULATE = ["simulate", "case.toml", "--set", "mesh.elements=40", "--json"]
THREADS = {"MKL_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pythons", nargs="*", type=Path)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--only", nargs="*", choices=["wheel", "sdist", "lowest"], default=["wheel", "sdist", "lowest"])
    parser.add_argument("--lock", action="store_true")
    options = parser.parse_args()
    if options.lock:
        print("\n".join(locked()))
        return
    work = options.work or Path(tempfile.mkdtemp(prefix="platforms-"))
    work.mkdir(exist_ok=True)
    pythons = options.pythons or pyenv()
    wheel, sdist = built(pythons[0], work)
    wrong, forces = 0, {}
    jobs = [("wheel", python, [f"{wheel}[xlsx]", "-c", CONSTRAINTS]) for python in pythons]
    jobs += [("sdist", pythons[0], [sdist, "-c", CONSTRAINTS]), ("lowest", pythons[0], [wheel, "-c", lowest(work)])]
    for what, python, given in jobs:
        if what not in options.only:
            continue
        name = f"{what} {version(python)}"
        try:
            environment = installed(python, work / name.replace(" ", "-"), given)
            for check, outcome in checked(environment, work, what == "wheel", forces):
                print(f"{name:16s} {check}: {outcome}", flush=True)
        except (AssertionError, subprocess.CalledProcessError) as error:
            wrong += 1
            said = [line for line in str(getattr(error, "stderr", "")).splitlines() if "WARNING" not in line]
            print(f"{name:16s} FAILED: {error}", *said[-15:], sep="\n    ", flush=True)
        shutil.rmtree(work / name.replace(" ", "-"), ignore_errors=True)
    sys.exit(wrong > 0)


def pyenv():
    """Pythons of pyenv from 3.11 on."""
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    found = [path / "bin" / "python" for path in root.glob("3.*") if tuple(map(int, path.name.split(".")[:2])) >= (3, 11)]
    return sorted(found, key=version) or [Path(sys.executable)]


def version(python):
    return run(python, "-c", "import platform; print(platform.python_version())").strip()


def run(*words, **options):
    return subprocess.run([*map(str, words)], check=True, capture_output=True, text=True, **options).stdout


def built(python, work):
    """The wheel and the sdist of the repository; both hold the materials."""
    run(python, "-m", "venv", work / "build")
    run(work / "build/bin/pip", "install", "-q", "build")
    source = work / "source"
    shutil.copytree(HOME, source, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", "*.egg-info"), dirs_exist_ok=True)
    run(work / "build/bin/python", "-m", "build", "-q", "--outdir", work / "dist", source)
    return next((work / "dist").glob("*.whl")), next((work / "dist").glob("*.tar.gz"))


def installed(python, place, given):
    run(python, "-m", "venv", "--clear", place)
    run(place / "bin/pip", "install", "-q", *given)
    run(place / "bin/pip", "check")
    return place


def checked(environment, work, odd, forces):
    """Yield (what was checked, how it came out) in an installed environment. Raises AssertionError."""
    program = environment / "bin" / "indentfit"
    said = run(program, "--version", cwd="/", env=THREADS | {"PATH": "/usr/bin:/bin"}).strip()
    assert said.startswith("indentfit "), said
    listed = json.loads(run(program, "materials", "--json", cwd="/"))
    assert set(listed) == MATERIALS and not any("error" in one for one in listed.values()), listed
    yield "version and materials", said
    case = work / "cases" / "quickstart"
    shutil.copytree(HOME / "cases" / "quickstart", case, dirs_exist_ok=True)
    yield "simulate", same_forces(run(program, *SIMULATE, cwd=case, env=os.environ | THREADS), forces)
    if not odd:
        return
    for what, words in surroundings(environment, work).items():
        yield what, words(program, forces)


def same_forces(text, forces):
    """What was computed in words; the first is kept, others must agree with it within 1e-6."""
    found = json.loads(text)
    values = [force for test in found["tests"] for force in test["force_mN"]]
    known = forces.setdefault("known", values)
    error = max(abs(a - b) for a, b in zip(values, known, strict=True)) / max(known)
    assert error < 1e-6, f"forces differ by {error:.1e} of the largest"
    return f"{found['solver']['linear']}, forces within {error:.0e}"


def surroundings(environment, work):
    """What is odd -> function(program, forces) that simulates in it."""
    bare = {"PATH": "/usr/bin:/bin", **THREADS}
    spaces = work / "a b ü 位移"
    shutil.copytree(HOME / "cases" / "quickstart", spaces, dirs_exist_ok=True)
    case = work / "cases" / "quickstart"

    def simulated(cwd=case, env=bare, before=(), more=()):
        return lambda program, forces: same_forces(run(*before, program, *SIMULATE, *more, cwd=cwd, env=env), forces)

    def read_only(program, forces):
        """Site-packages that nobody can write: what is compiled is kept in the system's temporary folder."""
        caches = [*environment.rglob("__pycache__/*.nb[ic]")]
        for path in caches:
            path.unlink()
        if os.geteuid():
            return "left out: needs root"
        with bound_read_only(environment):
            outcome = same_forces(run(program, *SIMULATE, cwd=case, env=bare), forces)
        assert not [*environment.rglob("__pycache__/*.nb[ic]")], "written in site-packages"
        return outcome

    def umask(program, forces):
        place = work / "masked"
        shutil.rmtree(place, ignore_errors=True)
        out = run("sh", "-c", f'umask 077; "$0" {" ".join(SIMULATE)} -o "{place}"', program, cwd=case, env=bare)
        assert place.stat().st_mode & 0o777 == 0o700 and (place / "report.html").exists()
        return same_forces(out, forces)

    return {
        "no display, no home, no locale": simulated(),
        "LANG=C": simulated(env=bare | {"LANG": "C", "LC_ALL": "C"}),
        "home that is not there": simulated(env=bare | {"HOME": "/nonexistent"}),
        "path with spaces and foreign letters": simulated(cwd=spaces, env=bare | {"LC_ALL": "C"}),
        "read-only site-packages": read_only,
        "umask 077": umask,
    }


@contextlib.contextmanager
def bound_read_only(place):
    """Context in which a folder is mounted read-only over itself; root could write in it else."""
    subprocess.run(["mount", "--bind", place, place], check=True)
    try:
        subprocess.run(["mount", "-o", "remount,ro,bind", place], check=True)
        yield
    finally:
        subprocess.run(["umount", "-l", place], check=True)


def lowest(work):
    """A constraints file with the lowest versions that pyproject.toml promises."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["xlsx"]]
    floors = [re.match(r"([\w.-]+)(\[.*\])?>=([\w.]+)", one) for one in wanted]
    path = work / "lowest.txt"
    path.write_text("".join(f"{one[1]}=={one[3]}\n" for one in floors))
    return path


def locked():
    """name==version of everything that the tests of this environment use, from pyproject.toml's dependencies on."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["xlsx"], *extras["cluster"], *extras["test"]]
    queue = [re.match(r"[\w.-]+", one)[0] for one in wanted]
    found: dict[str, str] = {}
    while queue:
        name = re.sub(r"[-_.]+", "-", queue.pop()).lower()
        if name in found or name == "indentfit":
            continue
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        found[name] = distribution.version
        queue += [re.match(r"[\w.-]+", one)[0] for one in distribution.requires or () if "extra ==" not in one]
    return [f"{name}=={number}" for name, number in sorted(found.items())]


if __name__ == "__main__":
    main()
