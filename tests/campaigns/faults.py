"""Fault campaign: commands on a tiny case, each with one fault drawn at random, and how they end.

    nice -n 19 python tests/campaigns/faults.py [--runs 300] [--seed 0] [--only FAULT ...]

Allowed outcomes: the right numbers; or one clear line and exit 2 to 4 (130 or 143 after a signal, death by kill -9), after which
the same command, given again without the fault, ends with the right numbers. "Right" is bit by bit what the undisturbed command
gives, but for times; with a linear solver that returns garbage, within 1e-3. Anything else, a traceback, a hang over 60 s, other
numbers, a result folder that is not whole, is a finding: printed, and exit code 1. Faults of file systems need root (mount); else
they are left out. Where memory is short, a library in C++ may abort, and callbacks of C libraries print "Exception ignored":
nobody can catch these.
"""

import argparse
import collections
import contextlib
import json
import math
import os
import random
import re
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

CASES = Path(__file__).parents[2] / "cases"
PROGRAM = [sys.executable, "-P", "-c", "from indentfit.cli import main; main()"]
HANG = 60.0  # seconds of one command
TINY = [
    "mesh.elements=30", "material.phi=0.8", "fit.method=least_squares", "fit.starts=1", "fit.profiles=false", "fit.time_limit=4",
]  # fmt: skip
COMMANDS = {
    "fit": ["--no-fields"],
    "simulate": [],
    "sweep": ["--vary", "material.mu=+-10%", "--workers", "1"],
    "mesh-check": ["--elements", "24,30", "--mesh-only"],
    "report": [],
}
SHARES = {"fit": 8, "simulate": 5, "sweep": 5, "mesh-check": 1, "report": 2}  # a mesh-check takes ten times as long
# Python's own words where a callback of a C library gets no memory: nobody can catch these.
IGNORED = re.compile(r"^Exception ignored in: .*\nTraceback .*\n(  .*\n)*MemoryError.*\n", re.MULTILINE)
RESULTS = ("result.json", "simulation.json")
TIMES = (
    "seconds", "memory", "wall", "cpu", "time", "reused", "workers", "versions", "overrides", "solver", "factorizations", "peak",
)  # fmt: skip
PLUGIN = """\
import time
from indentfit.material import Material, Parameter

class Bad(Material):
    \"\"\"psi = mu/2 (I1 - 3) + zeta/2 (I4 - 1)^2, and what a plugin can do wrong.\"\"\"
    mu = Parameter("kPa", "shear modulus", min=0)
    zeta = Parameter("1", "fibres", min=0)
    phi = Parameter("1", "nothing much", min=0)

    def energy(self, I1, I4):
        return self.mu / 2 * (I1 - 3) + self.zeta / 2 * (I4 - 1) ** 2 + self.phi * (I4 - 1) ** 2

    def gradient(self, I):
        found = super().gradient(I)
        return found if found[0].size < 50 else self.spoilt(found)

    def hessian(self, I):
        found = super().hessian(I)
        return found if found[0, 0].size < 50 else self.spoilt(found)

    def spoilt(self, found):
"""
SPOILT = {
    "raises": 'raise ValueError("two\\nlines")',
    "exits": "raise SystemExit(0)",
    "NaN": 'return found * float("nan")',
    "complex": "return found * 1j",
    "wrong shape": "return found[:2, ..., :3]",
    "one number": "return 1.0",
    "nothing": "return None",
    "text": 'return "kPa"',
    "loops": "\n            ".join(["while True:", "    time.sleep(0.001)"]).replace("            ", "        "),
    "spins": "while True: pass",
    "allocates": "import numpy; return [numpy.ones(1 << 40) for _ in range(1 << 20)]",
    "infinite": "return found * 1e308",
    "wrong sign": "return -found",
}
HOOK = """\
import os, sys
kind, _, number = os.environ.get("INDENTFIT_FAULT", "").partition(":")
def strike():
    with open(os.environ["INDENTFIT_STRUCK"], "w") as mark:
        mark.write(kind)
if kind == "clock":
    import time
    real, calls = time.time, [0]
    def back():
        if not calls[0]:
            strike()
        calls[0] += 1
        return real() - float(number) * calls[0]
    time.time = back
elif kind == "memory" and "spawn_main" in " ".join(sys.orig_argv) or kind == "memory here":
    from indentfit.fem import path
    usual = path._step
    def step(*words, **named):
        import resource
        strike()
        pages = int(open("/proc/self/statm").read().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * 4096 + int(number) * 1024, resource.RLIM_INFINITY))
        return usual(*words, **named)
    path._step = step
elif kind.startswith("garbage"):
    import numpy
    from indentfit.fem.linear import direct
    share, rng = float(number), numpy.random.default_rng(0)
    def spoil(usual):
        def spoiled(b):
            x = usual(b)
            if rng.random() > share:
                return x
            strike()
            noise = rng.standard_normal(x.size)
            return {"garbage noise": x * (1 + noise), "garbage small": x * (1 + 1e-3 * noise), "garbage zero": 0 * x,
                    "garbage NaN": x * numpy.nan, "garbage large": x * 1e12}[kind]
        return spoiled
    plain = direct.DirectFactor.preconditioner
    direct.DirectFactor.preconditioner = lambda self, tangent: spoil(plain(self, tangent))
"""


@dataclass(frozen=True)
class Done:
    """How a command ended: exit code (negative: a signal), None after a hang."""

    code: int | None
    stdout: str
    stderr: str


class Finding(AssertionError):
    """An outcome that is not allowed."""


class Trial:
    """One command in a folder of its own: started, disturbed, judged and given again."""

    def __init__(self, command, folder, undisturbed, dice):
        self.command, self.folder, self.undisturbed, self.dice, self.again = command, folder, undisturbed, dice, "--resume"
        folder.mkdir(exist_ok=True)
        self.mark, self.hooked = folder / "struck", False
        self.case, self.out, self.sets, self.workers = folder / "case" / "case.toml", folder / "room" / "out", list(TINY), 1
        shutil.copytree(CASES / "quickstart", folder / "case")
        (folder / "room").mkdir()
        if command == "report":
            shutil.copytree(undisturbed["report"].folder, self.out)

    def words(self, resume=False):
        if self.command == "report":
            return ["report", str(self.out)]
        sets = [word for key in [*self.sets, f"fit.workers={self.workers}"] for word in ("--set", key)]
        again = [self.again] if resume and self.command == "fit" else []
        return [self.command, str(self.case), *sets, *COMMANDS[self.command], *again, "-o", str(self.out)]

    @property
    def idle(self):
        """Whether a fault was to be put into the program's own code and that code was never reached."""
        return self.hooked and not self.mark.exists()

    def start(self, resume=False, hook="", limit=None):
        path = os.pathsep.join([str(self.folder.parent / "hook"), *filter(None, [os.environ.get("PYTHONPATH")])])
        hooks = {"PYTHONPATH": path, "INDENTFIT_FAULT": hook, "INDENTFIT_STRUCK": str(self.mark)} if hook else {}
        self.hooked = self.hooked or bool(hook)
        before = (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))) if limit is not None else None
        return subprocess.Popen(
            [*PROGRAM, *self.words(resume)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
            cwd=self.folder / "room", env={**os.environ, **hooks}, preexec_fn=before,
        )  # fmt: skip

    def end(self, process):
        try:
            out, err = process.communicate(timeout=HANG)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, err = process.communicate()
            raise Finding(f"hangs: {err[-300:]}") from None
        return Done(process.returncode, out, err)

    def moment(self):
        """Wait until some moment of the command's life."""
        time.sleep(self.dice.uniform(0.2, 1.0) ** 1.5 * self.undisturbed[self.command].seconds)

    def judge(self, done, again=True, tolerance=0.0, died=()):
        """The outcome in words; `died`: exit codes that the fault itself brings. Raises Finding."""
        if "Traceback" in IGNORED.sub("", done.stderr) or "a bug in indentfit" in done.stderr:
            raise Finding(f"a traceback or a bug: {done.stderr[-1500:]}")
        if done.code == 0:
            self.compare(tolerance)
            return "right numbers"
        if done.code not in died:
            lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
            each_of_case = lines and all(f"{self.case}: " in line for line in lines)
            if done.code not in (2, 3, 4) or not (len(lines) == 1 or each_of_case):
                raise Finding(f"exit {done.code} with {len(lines)} error lines: {done.stderr[-600:]!r}")
        studied = done.code == 3 and self.command in ("sweep", "mesh-check")  # a study whose points all failed shows why
        if self.out.exists() and done.code != 4 and not studied and self.command != "report":
            if done.code in died:  # it was whole before the fault came
                self.compare(tolerance)
                return "right numbers"
            if any((self.out / name).exists() for name in RESULTS):
                self.compare(tolerance)
        if not again:
            return f"a line, exit {done.code}"
        if self.out.is_file():
            self.out.unlink()
        if self.command == "report" and not self.out.is_dir():
            return f"a line, exit {done.code}"
        if self.out.exists() and self.command != "report":
            shutil.rmtree(self.out)
        repeated = self.end(self.start(resume=True))
        if repeated.code != 0:
            raise Finding(f"given again, exit {repeated.code}: {repeated.stderr[-600:]}; before: {done.code} {done.stderr[-300:]}")
        self.compare(tolerance)
        return "stopped, then the right numbers" if done.code in died else f"a line, exit {done.code}; then the right numbers"

    def shown(self, done, cause):
        """Whether it is a study that ended well, and shows the cause why a point of it has no numbers."""
        studied = done.code == 0 and self.command in ("sweep", "mesh-check")
        return studied and cause in str(numbers(self.command, self.out))

    def compare(self, tolerance=0.0):
        found, true = numbers(self.command, self.out), self.undisturbed[self.command].numbers
        if not (found == true or (tolerance and close(found, true, tolerance))):
            raise Finding(f"other numbers: {difference(found, true)}")


# Faults: each takes a Trial, does its harm and returns the outcome


def signalled(*numbers):
    """Signals one after the other, to the process and (as a terminal does with SIGINT) to its group."""

    def fault(trial):
        trial.workers = trial.dice.choice([1, 2])
        process = trial.start()
        for number in numbers:
            trial.moment() if number is numbers[0] else time.sleep(trial.dice.uniform(0, 0.4))
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
        done = trial.end(process)
        return trial.judge(done, died=(130, 143, *(-number for number in numbers)))

    return fault


def worker_killed(trial):
    trial.workers = 2
    process = trial.start()
    trial.moment()
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError):
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == process.pid and b"spawn_main" in (entry / "cmdline").read_bytes():
                os.kill(int(entry.name), signal.SIGKILL)
                break
    return trial.judge(trial.end(process))


def folder_removed(trial):
    process = trial.start()
    trial.moment()
    whole = trial.command != "report" and trial.out.exists()
    shutil.rmtree(trial.folder / "room", ignore_errors=True)
    done = trial.end(process)
    (trial.folder / "room").mkdir(exist_ok=True)
    if done.code == 0 and (whole or trial.command == "report"):
        return "right numbers"  # they were written before
    return trial.judge(done)


def case_removed(trial):
    process = trial.start()
    trial.moment()
    shutil.move(trial.folder / "case", trial.folder / "moved")
    done = trial.end(process)
    shutil.move(trial.folder / "moved", trial.folder / "case")
    return trial.judge(done)


def file_in_its_place(trial):
    if trial.command == "report":
        shutil.rmtree(trial.out)
    process = trial.start()
    trial.dice.random() < 0.5 and trial.moment()
    with contextlib.suppress(OSError):
        trial.out.write_text("somebody else's")
    return trial.judge(trial.end(process))


def read_only(trial):
    room = trial.folder / "room"
    with mounted("--bind", room, room):
        process = trial.start()
        trial.dice.random() < 0.7 and trial.moment()
        for _ in range(100):  # busy while a file is being written
            if not subprocess.run(["mount", "-o", "remount,ro,bind", str(room)], capture_output=True).returncode:
                break
            time.sleep(0.02)
        done = trial.end(process)
    return trial.judge(done)


def small_disk(trial):
    room = trial.folder / "room"
    kept = {path.name: path.read_bytes() for path in trial.out.iterdir() if path.is_file()} if trial.command == "report" else {}
    size = int(4096 * 2 ** trial.dice.uniform(1, 7)) + sum(map(len, kept.values()))
    with mounted("-t", "tmpfs", "-o", f"size={size}", "tmpfs", room):
        if kept:
            trial.out.mkdir()
            for name, content in kept.items():
                (trial.out / name).write_bytes(content)
        done = trial.end(trial.start())
        if done.code == 0:
            return trial.judge(done)
    return trial.judge(done)


def short_files(trial):
    """No file may be longer than some bytes, as with a quota."""
    return trial.judge(trial.end(trial.start(limit=int(512 * 2 ** trial.dice.uniform(0, 8)))))


def two_at_once(trial):
    processes = [trial.start()]
    trial.dice.random() < 0.7 and trial.moment()
    processes.append(trial.start())
    both = [trial.end(process) for process in processes]
    if all(done.code for done in both):
        raise Finding(f"neither of two runs came to its end: {both}")
    return " / ".join(trial.judge(done, again=False) for done in both)


def clock_back(trial):
    for path in trial.folder.rglob("*"):
        os.utime(path, (0, trial.dice.choice([0, 4e9])))
    return trial.judge(trial.end(trial.start(hook=f"clock:{trial.dice.choice([1, 3600, 1e8])}")))


def spoilt_memory_of_runs(trial):
    """What was finished when a command was killed is changed on the disk before it is given again."""
    trial.command = trial.dice.choice(["fit", "fit", "sweep"])
    process = trial.start()
    place = trial.folder / "room" / ".out.unfinished" / "ledger.sqlite"
    until = time.monotonic() + 30
    while time.monotonic() < until and process.poll() is None and not (place.exists() and place.stat().st_size > 600):
        time.sleep(0.02)
    time.sleep(trial.dice.uniform(0, 0.8))
    process.kill()
    trial.end(process)
    if not place.exists():
        return trial.judge(Done(-9, "", ""), died=(-9,))
    how = trial.dice.choice(["bit", "bit", "truncated", "other version", "other case", "empty", "other code"])
    raw = place.read_bytes()
    if how == "bit" and raw:
        n = trial.dice.randrange(len(raw))
        place.write_bytes(raw[:n] + bytes([raw[n] ^ (1 << trial.dice.randrange(8))]) + raw[n + 1 :])
    elif how == "truncated":
        place.write_bytes(raw[: trial.dice.randrange(len(raw) + 1)])
    elif how == "empty":
        place.write_bytes(b"")
    elif how == "other case":
        trial.case.write_text(trial.case.read_text().replace("friction = 0.5", "friction = 0.45"))
    else:
        statement = "PRAGMA user_version = 7" if how == "other version" else "UPDATE about SET value = '{}' WHERE name = 'versions'"
        with contextlib.closing(sqlite3.connect(place)) as file:
            file.execute(statement)
            file.commit()
    done = trial.end(trial.start(resume=True))
    if how == "other case":
        if done.code == 0 and trial.command == "sweep":
            found, true = numbers("sweep", trial.out), trial.undisturbed["sweep"].numbers
            return "computed anew" if found != true else _raise("the other case's numbers")
        return trial.judge(done, again=False)
    if done.code:
        shutil.rmtree(place.parent, ignore_errors=True)
    return trial.judge(done)


def plugin(trial):
    how = trial.dice.choice(list(SPOILT))
    (trial.folder / "case" / "bad.py").write_text(PLUGIN + "        " + SPOILT[how] + "\n")
    trial.sets.append("material.model=bad.py:Bad")
    if how in ("loops", "spins"):  # `simulate` and `mesh-check` have no time limit
        trial.command = trial.dice.choice(["fit", "sweep"])
    trial.workers = trial.dice.choice([1, 1, 2])
    done = trial.end(trial.start())
    if done.code == 0:
        raise Finding(f"{how}: a result all the same: {done.stdout[-300:]}")
    if trial.out.exists():  # a study shows what failed, with its cause
        shutil.rmtree(trial.out)
    return f"{how}: " + trial.judge(done, again=False)


def little_memory(trial):
    trial.workers = trial.dice.choice([1, 2])
    trial.again = "--overwrite"  # --resume takes runs as they ended, out of memory or not
    kind = "memory" if trial.workers == 2 and trial.command == "fit" else "memory here"
    done = trial.end(trial.start(hook=f"{kind}:{int(2 ** trial.dice.uniform(4, 16))}"))
    if trial.shown(done, "memory"):
        return "what had no memory is shown, with its cause"
    return trial.judge(done, died=(-signal.SIGABRT, -signal.SIGSEGV))  # a library that gets no memory ends the process


def garbage(trial):
    kind, share = trial.dice.choice(["noise", "small", "zero", "NaN", "large"]), trial.dice.choice([0.02, 0.2, 1.0])
    done = trial.end(trial.start(hook=f"garbage {kind}:{share}"))
    if trial.shown(done, "no equilibrium"):
        return "what was not solved is shown, with its cause"
    return trial.judge(done, tolerance=1e-3)


def environment(trial):
    """No home, no language, a closed stdin, an odd umask and a path with spaces and foreign letters."""
    odd = trial.folder / "a b ü 位移"
    odd.mkdir()
    shutil.move(trial.folder / "case", odd / "case")
    trial.case = odd / "case" / "case.toml"
    before = {name: os.environ.pop(name, None) for name in ("HOME", "LANG", "LC_ALL")}
    mask = os.umask(0o077)
    os.environ["LC_ALL"] = "C"
    try:
        return trial.judge(trial.end(trial.start()))
    finally:
        os.umask(mask)
        os.environ.pop("LC_ALL")
        os.environ.update({name: value for name, value in before.items() if value is not None})


FAULTS = {
    "SIGINT once": (signalled(signal.SIGINT), 2), "SIGINT twice": (signalled(signal.SIGINT, signal.SIGINT), 2),
    "SIGTERM": (signalled(signal.SIGTERM), 2), "kill -9": (signalled(signal.SIGKILL), 3), "kill -9 of a worker": (worker_killed, 2),
    "folder removed under the run": (folder_removed, 2), "case moved away under the run": (case_removed, 1),
    "a file where the folder shall be": (file_in_its_place, 1), "folder gets read-only": (read_only, 2),
    "disk full (tmpfs)": (small_disk, 2), "files limited in size": (short_files, 2), "two runs on one folder": (two_at_once, 2),
    "clock going back, odd dates": (clock_back, 1),
    "what was finished is changed on the disk": (spoilt_memory_of_runs, 4), "plugin": (plugin, 4),
    "little memory": (little_memory, 2),
    "linear solver returns garbage": (garbage, 3), "no home, LANG=C, odd path, umask 077": (environment, 1),
}  # fmt: skip
NEED_ROOT = ("folder gets read-only", "disk full (tmpfs)")
NOT_OF_REPORT = (
    "what was finished is changed on the disk",
    "plugin", "little memory", "linear solver returns garbage", "case moved away under the run", "two runs on one folder",
    "clock going back, odd dates", "kill -9 of a worker", "no home, LANG=C, odd path, umask 077",
)  # fmt: skip
ONLY_FIT = ("kill -9 of a worker",)


def _raise(text):
    raise Finding(text)


@contextlib.contextmanager
def mounted(*words):
    subprocess.run(["mount", *map(str, words)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(words[-1])], check=True)


# What is compared


@dataclass(frozen=True)
class Undisturbed:
    """What a command gives when nothing happens: its numbers, folder and seconds."""

    numbers: object
    folder: Path
    seconds: float


def numbers(command, folder):
    """What must be the same in a result folder: all but times and what came from the ledger; of a report, its page."""
    if command == "report":
        page = folder / "report.html"
        return page.read_text() if page.exists() else None
    path = next((folder / name for name in RESULTS if (folder / name).exists()), None)
    if path is None:
        raise Finding(f"a folder that is not whole: {[one.name for one in folder.iterdir()] if folder.is_dir() else folder}")
    return _timeless(json.loads(path.read_text()))


def _timeless(value):
    if isinstance(value, dict):
        return {key: _timeless(one) for key, one in value.items() if not any(word in key for word in TIMES)}
    return [_timeless(one) for one in value] if isinstance(value, list) else value


def close(found, true, tolerance):
    """Whether forces, and what follows from them, agree."""
    found, true = forces(found), forces(true)
    sizes = {key: max(map(abs, values)) for key, values in true.items()}
    return found.keys() == true.keys() and all(
        len(values) == len(true[key])
        and all(math.isclose(a, b, abs_tol=tolerance * sizes[key]) for a, b in zip(values, true[key], strict=True))
        for key, values in found.items()
    )


def forces(value, place=""):
    """place -> list of forces in a tree."""
    found = {}
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, one in items:
        if "force" in str(key) and isinstance(one, list) and one and all(isinstance(x, float) for x in one):
            found[f"{place}.{key}"] = one
        else:
            found |= forces(one, f"{place}.{key}")
    return found


def difference(found, true, place=""):
    """The first place where two trees differ."""
    if type(found) is not type(true) or not isinstance(found, dict | list) or len(found) != len(true):
        return f"{place}: {str(found)[:100]} for {str(true)[:100]}"
    keys = true if isinstance(true, dict) else range(len(true))
    return next(difference(found[k], true[k], f"{place}.{k}") for k in keys if k not in keys or found[k] != true[k])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--numbers", type=int, nargs="*", help="only the runs of these numbers, again")
    parser.add_argument("--only", nargs="*", choices=list(FAULTS), default=[])
    options = parser.parse_args()
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    names = [name for name in options.only or FAULTS if root or name not in NEED_ROOT]
    folder, wrong = Path(tempfile.mkdtemp(prefix="faults-")), 0
    (folder / "hook").mkdir()
    (folder / "hook" / "sitecustomize.py").write_text(HOOK)
    undisturbed = dict(_undisturbed(folder))
    table: dict[str, collections.Counter] = {name: collections.Counter() for name in names}
    struck: collections.Counter[str] = collections.Counter()
    numbers_of_runs = options.numbers or range(options.runs)
    for n in numbers_of_runs:
        dice = random.Random(f"{options.seed} {n}")
        name = dice.choices(names, [FAULTS[name][1] for name in names])[0]
        open_to = [one for one in COMMANDS if one != "report" or name not in NOT_OF_REPORT]
        command = "fit" if name in ONLY_FIT else dice.choices(open_to, [SHARES[one] for one in open_to])[0]
        trial = Trial(command, folder / f"t{n}", undisturbed, dice)
        try:
            outcome = FAULTS[name][0](trial)
        except (Finding, OSError, subprocess.SubprocessError) as error:
            wrong, outcome = wrong + 1, "FINDING"
            print(f"FINDING {n} {trial.command}, {name}: {error}", flush=True)
        outcome += " (the code with the fault was not reached)" if trial.idle else ""
        struck[name] += not trial.idle
        table[name][outcome] += 1
        print(f"{n:3d}  {trial.command:10s}  {name}: {outcome}", flush=True)
        shutil.rmtree(trial.folder, ignore_errors=True)
    for name in [name for name in names if table[name].total() and not struck[name]]:
        wrong += 1
        print(f"FINDING {name}: not once was the code with the fault reached; has it moved?")
    print(f"\n{len(numbers_of_runs)} runs, {wrong} findings\n\n| fault | runs | outcome |\n|---|---|---|")
    for name, counts in table.items():
        print(f"| {name} | {counts.total()} | {'; '.join(f'{number} x {outcome}' for outcome, number in counts.most_common())} |")
    shutil.rmtree(folder, ignore_errors=True)
    sys.exit(wrong > 0)


def _undisturbed(folder):
    """command -> Undisturbed, each by one run; that of `report` draws the page of a simulation again."""
    known: dict[str, Undisturbed] = {}
    for command in COMMANDS:
        if command == "report":
            known["report"] = known["simulate"]
        trial = Trial(command, folder / f"undisturbed-{command}", known, random.Random(0))
        started = time.monotonic()
        done = trial.end(trial.start())
        if done.code:
            sys.exit(f"{command}: {done.stderr}")
        known[command] = Undisturbed(numbers(command, trial.out), trial.out, time.monotonic() - started)
        print(f"undisturbed {command}: {known[command].seconds:.1f} s", flush=True)
        yield command, known[command]


if __name__ == "__main__":
    main()
