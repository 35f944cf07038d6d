"""Robustness campaign: the forward model at 500 points of everything a lab may ask of it, extremes included.

    python tests/campaigns/robustness.py [--points 0:500] [--output robustness.jsonl] [--set KEY=VALUE ...] [--workers 2]
    python tests/campaigns/robustness.py --summary [--output robustness.jsonl]

Points 0 to 99 are a Latin hypercube of usual inputs, 100 to 459 one of wider ranges, 460 to 499 corners of the extremes, 500 and
501 the paper's optimum at 20 % strain. Each point ends as a line of JSON in the output: the campaign goes on where it was stopped,
and `--points a:b` does a part of it; a point is done anew when it or the --set texts changed. Then a table, each failure with its
cause; exit code 1 when less than 99 % are solved or one failed in a way that nobody foresaw. The tests import `sample_points`.
"""

import argparse
import itertools
import json
import math
import os
import sys
import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

CASE = Path(__file__).parents[2] / "cases" / "white_matter_2017" / "case.toml"
THICKNESS = 3.3
RANGES = {
    "mu": (0.1, 10.0),
    "zeta": (0.0, 20.0),
    "phi": (0.0, 5.0),
    "friction": (0.0, 1.0),
    "angle": (0, 1),
    "base": (0, 1),
    "bulk_ratio": (50.0, 5000.0),
    "edge_radius": (0.0, 0.3),
    "strain": (0.05, 0.15),
}
WIDER = RANGES | {"friction": (0.0, 1.5), "bulk_ratio": (20.0, 5000.0), "strain": (0.02, 0.20)}
SHARP, SLIGHT = 0.0, 0.05  # edge radii that two of three points of the wider ranges have, mm
OPTIMUM = {
    "mu": 1.49, "zeta": 4.68, "phi": 0.68, "friction": 0.5, "base": "sliding", "bulk_ratio": 1000.0, "edge_radius": 0.0,
    "strain": 0.20,
}  # fmt: skip


def sample_points(number, seed=0, ranges=RANGES):
    """Latin-hypercube points as dicts; bulk ratios are even in their logarithm, every third edge is sharp, every eighth strain
    is the largest."""
    from scipy.stats import qmc

    unit = qmc.LatinHypercube(len(ranges), seed=seed).random(number)
    points = []
    for index, row in enumerate(unit):
        point = {key: low + share * (high - low) for share, (key, (low, high)) in zip(row, ranges.items(), strict=True)}
        point["angle"] = 90 if point["angle"] > 0.5 else 0
        point["base"] = "bonded" if point["base"] > 0.5 else "sliding"
        low, high = ranges["bulk_ratio"]
        point["bulk_ratio"] = low * (high / low) ** ((point["bulk_ratio"] - low) / (high - low))
        point["edge_radius"] = 0.0 if index % 3 == 0 else point["edge_radius"]
        point["strain"] = ranges["strain"][1] if index % 8 == 0 else point["strain"]
        points.append(point)
    return points


def all_points(seed=0):
    """The 502 points of the campaign; which is which does not depend on how many are asked for."""
    return [*sample_points(100, seed), *wider_points(360, seed + 1), *corner_points(), *(OPTIMUM | {"angle": a} for a in (0, 90))]


def wider_points(number, seed):
    """Points of the wider ranges; edges are sharp, slightly rounded or round in turn."""
    points = sample_points(number, seed, WIDER)
    for n, point in enumerate(points):
        point["edge_radius"] = (SHARP, SLIGHT, point["edge_radius"])[n % 3]
    return points


def corner_points():
    """40 points at 20 % strain with everything at an end of its range."""
    ends = [(0, 90), (0.0, 20.0), (0.0, 5.0)]
    usual = {"mu": 1.0, "base": "sliding", "strain": 0.20}
    kinds = [(f, r, k) for f in (0.0, 1.2) for r, k in ((SHARP, 20.0), (SLIGHT, 5000.0))] + [("stick", SHARP, 1000.0)]
    return [
        usual | {"angle": a, "zeta": z, "phi": p, "friction": f, "edge_radius": r, "bulk_ratio": k}
        for (f, r, k), (a, z, p) in itertools.product(kinds, itertools.product(*ends))
    ]


def overrides(point):
    """The `--set` texts of one point on the white-matter case."""
    friction = point["friction"]
    return [
        f"material.parameters={{mu={point['mu']},zeta={point['zeta']},phi={point['phi']}}}",
        f"material.bulk_ratio={point['bulk_ratio']}",
        f"sample.base={point['base']}",
        f"indenter.friction={friction}",
        f"indenter.edge_radius={point['edge_radius']}",
        f"test=[{{name='run',angle={point['angle']},depth={point['strain'] * THICKNESS},points=25}}]",
    ]


def run(job):
    """The record of one point: (number, point, further --set texts) -> what goes into the output."""
    number, point, extra = job
    from indentfit.errors import IndentfitError
    from indentfit.experiment.measured import read_case
    from indentfit.runs.forward import simulate

    started, cause, unforeseen, force, facts = time.perf_counter(), None, None, None, {}
    try:
        test = simulate(read_case(CASE, [*overrides(point), *extra])).tests[0]
        force, facts = test.force.tolist(), test.facts.as_json()
        if not all(map(math.isfinite, force)):
            force, cause = None, "its force is not a finite number"
    except IndentfitError as error:
        cause = " ".join(str(error).split())
    except Exception:
        cause, unforeseen = "a bug", traceback.format_exc()
    return {
        "number": number, "point": point, "set": extra, "force_mN": force, "facts": facts, "cause": cause,
        "unforeseen": unforeseen, "seconds": time.perf_counter() - started,
    }  # fmt: skip


def line(record):
    """A record in words."""
    point, facts, force = record["point"], record["facts"], record["force_mN"]
    friction = point["friction"] if point["friction"] == "stick" else f"{point['friction']:5.2f}"
    inputs = (
        f"{record['number']:4d} mu {point['mu']:6.3f} zeta {point['zeta']:5.2f} phi {point['phi']:4.2f} f {friction} "
        f"{point['angle']:2d} deg {point['base']:7s} kappa/mu {point['bulk_ratio']:6.0f} r {point['edge_radius']:5.3f} "
        f"strain {point['strain']:5.3f} "
    )
    if force is None:
        return inputs + f"FAILED after {record['seconds']:.1f} s: {record['unforeseen'] or record['cause']}"
    rough = " FALLING" if any(b < a for a, b in itertools.pairwise(force)) else ""
    rough += f" tries {facts['tries']}" if facts["tries"] > 1 else ""
    return inputs + (
        f"F {force[-1]:9.3f} steps {facts['steps']:3d} cutbacks {facts['cutbacks']:2d} Newton {facts['newton_iterations']:3d} "
        f"loose {facts['loose_steps']:2d} factorizations {facts['factorizations']:3d} "
        f"penalty {100 * facts['penalty_error']:6.3f} % {record['seconds']:6.1f} s{rough}"
    )


def summary(records):
    """Lines of the table, and whether the target is met."""
    solved = [one for one in records if one["force_mN"] is not None]
    seconds = sorted(one["seconds"] for one in records)
    yield ""
    for one in records:
        if one["force_mN"] is None:
            yield line(one)
    yield (
        f"{len(records)} points, {len(solved)} solved ({len(solved) / len(records):.1%}), "
        f"{sum(one['unforeseen'] is not None for one in records)} failed in a way that nobody foresaw"
    )
    if solved:
        tries = [one["facts"]["tries"] for one in solved]
        yield "tries: " + ", ".join(f"{tries.count(n)} at number {n}" for n in sorted(set(tries)))
        loose = [one for one in solved if one["facts"]["loose_steps"]]
        falling = sum(any(b < a for a, b in itertools.pairwise(one["force_mN"])) for one in solved)
        largest = max((one["facts"]["residual_error"] for one in solved), default=0)
        yield f"{len(loose)} with loose steps, largest residual error {largest:.2%}; {falling} with a falling force"
    yield f"seconds: median {seconds[len(seconds) // 2]:.1f}, largest {seconds[-1]:.1f}"


def known(path, points, extra):
    """number -> record of what the output holds of these points, run with these --set texts."""
    if not path.exists():
        return {}
    records = [json.loads(text) for text in path.read_text().splitlines() if text.endswith("}")]
    return {one["number"]: one for one in records if one["set"] == extra and points.get(one["number"]) == one["point"]}


def asked(text, number):
    """Numbers of the points of "a:b", "a" or "b" points from the start."""
    first, colon, last = text.partition(":")
    return range(number)[int(first or 0) : int(last or number)] if colon else range(min(int(text), number))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", default="0:502", metavar="A:B")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], dest="extra")
    parser.add_argument("--only", type=int, nargs="*")
    parser.add_argument("--output", type=Path, default=Path("robustness.jsonl"))
    parser.add_argument("--summary", action="store_true", help="only the table of what is in the output")
    arguments = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    every = dict(enumerate(all_points(arguments.seed)))
    wanted = {n: every[n] for n in arguments.only or asked(arguments.points, len(every))}
    done = known(arguments.output, wanted, arguments.extra)
    jobs = [(n, point, arguments.extra) for n, point in wanted.items() if n not in done]
    if not arguments.summary and jobs:
        with ProcessPoolExecutor(arguments.workers) as pool, arguments.output.open("a") as output:
            for future in as_completed([pool.submit(run, job) for job in jobs]):
                record = future.result()
                done[record["number"]] = record
                output.write(json.dumps(record) + "\n")
                output.flush()
                print(line(record), flush=True)
    records = [done[n] for n in sorted(done)]
    if not records:
        sys.exit("no point is done yet")
    print("\n".join(summary(records)))
    failed = [one for one in records if one["force_mN"] is None]
    sys.exit(len(failed) > 0.01 * len(records) or any(one["unforeseen"] for one in failed))


if __name__ == "__main__":
    main()
