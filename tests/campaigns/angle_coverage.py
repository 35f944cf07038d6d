"""Coverage campaign of the fitted direction of fibres: do the 95 % intervals hold the true angle as often as they say?

    python tests/campaigns/angle_coverage.py FOLDER [--truths 200] [--trained 96] [--white] [--seed 22]

The case is corpus_callosum_angles, a bar at 0, 45 and 90 degrees to where the fibres seem to run. Each truth draws mu, zeta, phi
and the angle by which the fibres are turned evenly; its curves are runs of the same model with noise of 0.5, 1 or 2 % in turn, as
fits suppose it: white in three quarters of the tests, of one of their correlations in the others (--white: white in all). All fits
are made on one surrogate, learnt from runs at other places. The folder keeps runs and rows, so that a campaign goes on where it
was stopped (`--seconds`). Prints for each parameter how often its interval holds the truth, with the exact binomial 99 % band about
95 %; exit code 1 where the angle is outside of the band.

Seen (30 November 2026, --seed 31, 200 truths): mu 196, zeta 191, phi 192, the angle 190 inside, band 181 to 197. With white noise
(29 November 2026) 199, 195, 196 and 196 of 200: too wide, because fits allow for correlated noise too. The mean of profiles at 120
truths, which is 1 for chi2, is 0.67, 0.78, 0.82 and 0.76 there; where fits take all noise for white (noise.WHITE 0.9999) it is
1.10, 1.31, 1.26 and 1.21, and with noise as they suppose it 0.84, 0.77, 0.91 and 0.91.
"""

import argparse
import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from fixtures.supposed_noise import supposed_noise
from scipy.stats import binom, qmc

from indentfit.experiment.measured import read_case
from indentfit.inference.certainty import holds
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.exploration import Watched
from indentfit.inverse.problem import inverse_problem
from indentfit.inverse.surrogate import learn
from indentfit.runs.ledger import Ledger
from indentfit.runs.pool import RunPool

CASE = Path(__file__).parents[2] / "cases" / "corpus_callosum_angles" / "case.toml"
TRUTHS = {"mu": (0.4, 1.2), "zeta": (1.0, 10.0), "phi": (0.2, 2.0), "fibre_angle": (-35.0, 35.0)}
NOISES = (0.005, 0.01, 0.02)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--truths", type=int, default=200)
    parser.add_argument("--trained", type=int, default=96)
    parser.add_argument("--white", action="store_true", help="white noise in all tests")
    parser.add_argument("--seed", type=int, default=22, help="of the noise")
    parser.add_argument("--seconds", type=float, default=440.0, help="processor time after which this piece ends")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    case = read_case(CASE, ["fit.workers=1"])
    problem, kept, runs = inverse_problem(case), asked.folder / "rows.jsonl", asked.folder / "runs.sqlite"
    rows = [json.loads(row) for row in kept.read_text().splitlines()] if kept.exists() else []
    with Ledger(runs, case, resume=runs.exists()) as ledger, RunPool(case, ledger=ledger) as pool:
        model = Watched(pool)
        places = qmc.Sobol(len(problem.searched), seed=3).random(asked.trained)
        for place in places:
            x = problem.units(problem.start)
            x[problem.searched_numbers] = place
            evaluate_at_reference(problem, model, [problem.parameters(x)])
            if time.process_time() > asked.seconds:
                return 0
        surrogate = learn(problem, model.known)
        for n, truth in enumerate(truths(asked.truths)):
            if n < len(rows):
                continue
            exact = problem.scaled(truth, evaluate_at_reference(problem, pool, [truth])[0].forces)
            rng, noise = np.random.default_rng([asked.seed, n]), NOISES[n % len(NOISES)]
            forces = [force + noise * force.max() * supposed_noise(rng, force.size, asked.white) for force in exact]
            inside = holds(problem.measured(forces), surrogate, truth, problem.units(truth))
            rows.append({"truth": truth, "noise": noise, "inside": dict(zip(problem.free, inside, strict=True))})
            with kept.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
            if time.process_time() > asked.seconds:
                break
    print(f"{time.process_time():.0f} s of CPU")
    return told(rows)


def truths(number):
    """Truths, drawn evenly."""
    rng = np.random.default_rng(2211)
    for _ in range(number):
        yield {name: float(rng.uniform(*span)) for name, span in TRUTHS.items()}


def told(rows):
    low, high = (int(binom.ppf(share, len(rows), 0.95)) for share in (0.005, 0.995))
    counts = {name: sum(row["inside"][name] for row in rows) for name in TRUTHS}
    for name, count in counts.items():
        each = ", ".join(
            f"{sum(row['inside'][name] for row in rows if row['noise'] == noise)}/{sum(row['noise'] == noise for row in rows)}"
            for noise in NOISES
        )
        print(f"{name}: {count} of {len(rows)} inside (band {low} to {high}); by noise {each}")
    return 0 if low <= counts["fibre_angle"] <= high else 1


if __name__ == "__main__":
    sys.exit(main())
