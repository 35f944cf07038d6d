"""Robustness campaign: the forward model at Latin-hypercube points of everything a lab may ask of it.

    python tests/campaigns/robustness.py [--points 100] [--seed 0] [--set KEY=VALUE ...] [--only K] [--workers 2]

Prints one line per run and a summary; exit code 1 when any run failed. The paper's optimum at 20 % strain is added.
`sample_points` is imported by the tests, which run a few of the same points.
"""

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
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


def sample_points(number, seed=0):
    """Latin-hypercube points as dicts; every third one has a sharp edge, and twelve strains reach the full 15 %."""
    from scipy.stats import qmc

    unit = qmc.LatinHypercube(len(RANGES), seed=seed).random(number)
    points = []
    for index, row in enumerate(unit):
        point = {key: low + share * (high - low) for share, (key, (low, high)) in zip(row, RANGES.items(), strict=True)}
        point["angle"] = 90 if point["angle"] > 0.5 else 0
        point["base"] = "bonded" if point["base"] > 0.5 else "sliding"
        point["bulk_ratio"] = 50 * 100 ** ((point["bulk_ratio"] - 50) / 4950)
        point["edge_radius"] = 0.0 if index % 3 == 0 else point["edge_radius"]
        point["strain"] = 0.15 if index % 8 == 0 else point["strain"]
        points.append(point)
    return points


def overrides(point):
    """The `--set` texts of one point on the white-matter case."""
    return [
        f"material.parameters={{mu={point['mu']},zeta={point['zeta']},phi={point['phi']}}}",
        f"material.bulk_ratio={point['bulk_ratio']}",
        f"sample.base={point['base']}",
        f"indenter.friction={point['friction']}",
        f"indenter.edge_radius={point['edge_radius']}",
        f"test=[{{name='run',angle={point['angle']},depth={point['strain'] * THICKNESS},points=25}}]",
    ]


def run(job):
    """One point: (index, point, force or None, facts or cause, seconds)."""
    index, point, extra = job
    from indentfit.case import read_case
    from indentfit.errors import IndentfitError
    from indentfit.fem.simulate import simulate

    started = time.perf_counter()
    try:
        simulation = simulate(read_case(CASE, [*overrides(point), *extra]))
    except IndentfitError as error:
        return index, point, None, str(error), time.perf_counter() - started
    test = simulation.tests[0]
    return index, point, test.force, test.facts, time.perf_counter() - started


def line(result):
    index, point, force, facts, seconds = result
    inputs = (
        f"{index:4d} mu {point['mu']:6.3f} zeta {point['zeta']:5.2f} phi {point['phi']:4.2f} f {point['friction']:4.2f} "
        f"{point['angle']:2d} deg {point['base']:7s} kappa/mu {point['bulk_ratio']:6.0f} r {point['edge_radius']:5.3f} "
        f"strain {point['strain']:5.3f} "
    )
    if force is None:
        return inputs + f"FAILED after {seconds:.1f} s: {facts}"
    rough = " FALLING" if (force[1:] < force[:-1]).any() else ""
    rough += f" tries {facts['tries']}" if facts["tries"] > 1 else ""
    return inputs + (
        f"F {force[-1]:9.3f} steps {facts['steps']:3d} cutbacks {facts['cutbacks']:2d} Newton {facts['newton_iterations']:3d} "
        f"loose {facts['loose_steps']:2d} factorizations {facts['factorizations']:3d} penalty {100 * facts['penalty_error']:6.3f} % "
        f"{seconds:6.1f} s{rough}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], dest="extra")
    parser.add_argument("--only", type=int, nargs="*")
    arguments = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    optimum = {
        "mu": 1.49, "zeta": 4.68, "phi": 0.68, "friction": 0.5, "base": "sliding", "bulk_ratio": 1000.0, "edge_radius": 0.0,
        "strain": 0.20,
    }  # fmt: skip
    points = [*sample_points(arguments.points, arguments.seed), optimum | {"angle": 0}, optimum | {"angle": 90}]
    jobs = [(i, point, arguments.extra) for i, point in enumerate(points) if not arguments.only or i in arguments.only]
    failed, seconds = 0, []
    with ProcessPoolExecutor(arguments.workers) as pool:
        for result in pool.map(run, jobs):
            failed += result[2] is None
            seconds.append(result[4])
            print(line(result), flush=True)
    seconds.sort()
    print(
        f"{len(jobs)} runs, {failed} failed; seconds: median {seconds[len(seconds) // 2]:.1f}, largest {seconds[-1]:.1f}"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
