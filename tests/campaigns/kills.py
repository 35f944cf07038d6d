"""Kill campaign: a fit is killed with -9 at random moments, resumed, and must end with the same numbers, bit by bit.

    python tests/campaigns/kills.py [--kills 10] [--seed 0] [--case CASE] [--set KEY=VALUE ...] [--victim fit|worker]

Each round kills one fit: the whole process (then `--resume`, which is killed too, up to three times, at the next
random moments) or, with `--victim worker`, one of its workers a few times. Prints a line for each round;
exit code 1 when a result differs from that of the undisturbed fit in anything but times and what came from the ledger.
"""

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CASE = Path(__file__).parents[2] / "cases" / "quickstart" / "case.toml"
SETS = ["mesh.elements=40", "fit.method=ga", "fit.population=5", "fit.generations=3", "fit.workers=2"]
PROGRAM = [sys.executable, "-P", "-c", "from indentfit.cli import main; main()"]
MAY_DIFFER = ("seconds", "reused", "solver")


def main():
    options = arguments()
    folder, dice = Path(tempfile.mkdtemp(prefix="kills-")), random.Random(options.seed)
    command = [*PROGRAM, "fit", str(options.case), *(word for key in options.set or SETS for word in ("--set", key))]
    started = time.monotonic()
    subprocess.run([*command, "-o", str(folder / "whole")], check=True, capture_output=True)
    whole, length = result(folder / "whole"), time.monotonic() - started
    print(f"undisturbed: {length:.1f} s, {whole['runs']} runs, {values(whole)}", flush=True)
    wrong = kills = 0
    for n in range(options.kills):
        moments, found = (kill_fit if options.victim == "fit" else kill_workers)(command, folder / f"r{n}", length, dice)
        differs = [key for key in whole if key not in MAY_DIFFER and whole[key] != found.get(key)]
        wrong, kills = wrong + bool(differs), kills + len(moments)
        when = "killed at " + ", ".join(f"{moment:.1f}" for moment in moments) + " s" if moments else "had ended before its kill"
        print(f"{n:3d}  {when}  reused {found['reused']:3d}  {differs or 'same'}", flush=True)
    print(f"{options.kills} rounds, {kills} kills, {wrong} results differ")
    shutil.rmtree(folder)
    sys.exit(wrong > 0)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--case", type=Path, default=CASE)
    parser.add_argument("--set", action="append", metavar="KEY=VALUE")
    parser.add_argument("--victim", choices=["fit", "worker"], default="fit")
    return parser.parse_args()


def kill_fit(command, place, length, dice):
    """Moments of the kills, and the result after the last `--resume`."""
    moments = []
    for _ in range(dice.randint(1, 3)):
        process = subprocess.Popen([*command, "-o", str(place), "--resume"], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        moment = dice.uniform(0, length)
        try:
            process.wait(moment)
            break
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            moments.append(moment)
    if not place.exists():
        done = subprocess.run([*command, "-o", str(place), "--resume"], capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stderr)
    return moments, result(place)


def kill_workers(command, place, length, dice):
    """Moments of the kills of one worker each, and the result of the fit, which goes on."""
    process = subprocess.Popen([*command, "-o", str(place)], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    moments, started = [], time.monotonic()
    for moment in sorted(dice.uniform(0, length) for _ in range(3)):
        time.sleep(max(started + moment - time.monotonic(), 0))
        if workers := children(process.pid):
            os.kill(dice.choice(workers), 9)
            moments.append(moment)
    process.wait()
    return moments, result(place)


def children(pid):
    """The worker processes of a fit: forked from the server that the fit has prepared, or spawned by the fit."""
    first, again = _of(pid), []
    for process, command in first:
        if b"forkserver" in command:
            again += [child for child, _ in _of(process)]
    return again + [process for process, command in first if b"spawn_main" in command]


def _of(pid):
    """(process, command line) of each child of a process."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == pid:
                found.append((int(entry.name), (entry / "cmdline").read_bytes()))
        except (OSError, ValueError):
            continue
    return found


def result(place):
    return json.loads((place / "result.json").read_text())


def values(found):
    return ", ".join(f"{name} {one['value']!r}" for name, one in found["parameters"].items())


if __name__ == "__main__":
    main()
