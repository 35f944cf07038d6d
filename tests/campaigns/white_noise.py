"""Campaign of white noise with every input known: are the verdicts right, and do the 95 % intervals hold the truth?

    python tests/campaigns/white_noise.py FOLDER [--truths 20] [--draws 10] [--noises 0.001,0.01] [--seed 5]

A sphere on a gel (Ogden). The curves are those of a mesh of at least 200 elements, at random mu and alpha, with white noise of each
size. All fits share two sets of runs, of the case's own mesh and of the second mesh by which a fit corrects its curves; otherwise
each is a fit with its profiles and verdicts. Two things are counted apart. A verdict of a case names a wrong cause where a
parameter is said to be limited by the law's misfit, since there is none. An interval of 95 % misses the truth in 5 % of the cases
for each parameter, also where it is called determined: of cases with two parameters exact intervals leave a truth outside in 5 to
10 %, so that "no determined parameter outside" can hold in 90 to 95 % of the cases only. The folder keeps the runs.

Prints for each noise the share of cases whose cause is right and of those with every determined truth inside, and how often mu
and alpha lie in their intervals, with the exact binomial 99 % band about 95 %. Exit code 1 where a cause is wrong or a determined
truth is outside in more than 5 % of the cases together, which is stricter than exact intervals can promise, or where a coverage is
below the band.

Seen on 30 November 2026, 200 cases of each noise (band 181 to 197): at 1 % 199 verdicts name the right cause, 194 have every
determined truth inside, mu is inside in 195 and alpha in 198; at 0.1 % 199, 199, 199 and 199. Three of these coverages lie above
the band: at 0.1 % the error of the mesh limits both parameters. 280 s of CPU, of which 30 s for the runs. At 5 %, seen in an
earlier session, 198 name the right cause and 194 have every determined truth inside.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import binom, qmc

from indentfit.case import Case
from indentfit.curve import Curve
from indentfit.fem.mesh_error import second
from indentfit.fem.meshing import size
from indentfit.inference.certainty import certainty
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.exploration import Watched
from indentfit.inverse.mesh_correction import MeshCorrection
from indentfit.inverse.methods import solve
from indentfit.inverse.problem import inverse_problem
from indentfit.inverse.progress import SILENT
from indentfit.inverse.surrogate import learn
from indentfit.runs.ledger import Ledger
from indentfit.runs.mechanics import WIDER
from indentfit.runs.points import setup_of
from indentfit.runs.pool import RunPool

DEPTHS, TRAINED, FINE = np.linspace(0.06, 1.2, 20), 14, 200
TRUTHS = {"mu": (0.7, 1.5), "alpha": (2.0, 12.0)}
SPHERE = {
    "sample": {"shape": "disc", "diameter": 20.0, "thickness": 4.0, "base": "sliding"},
    "indenter": {"shape": "sphere", "radius": 2.0, "friction": 0.3},
    "material": {
        "model": "ogden",
        "bulk_ratio": 1000,
        "parameters": {"mu": {"start": 1.0, "min": 0.1, "max": 10.0}, "alpha": {"start": 5.0, "min": 1.0, "max": 16.0}},
    },
    "fit": {"method": "ga", "workers": 1},
}


class TwoMeshes:
    """A ForwardModel of two surrogates: of the case's mesh, and of points on its second mesh."""

    runs, failures = 0, ()

    def __init__(self, own, other):
        self.own, self.other = own, other

    def differentiable(self):
        return self.own.differentiable()

    def evaluate(self, points, report=None, sensitivities=()):
        found = []
        for point in points:
            bare = {name: value for name, value in point.items() if name != WIDER}
            known = (self.other if WIDER in point else self.own).evaluate([bare])[0]
            found.append(replace(known, parameters=dict(point)))
        return found


def case_of(force, mesh=None):
    return Case(**SPHERE, **({"mesh": mesh} if mesh else {}), tests=[{"name": "press", "curve": Curve(DEPTHS, force)}])


def runs_of(case, problem, folder, name, points):
    path = folder / f"{name}.sqlite"
    with Ledger(path, case, resume=path.exists()) as ledger, RunPool(case, ledger=ledger) as pool:
        return evaluate_at_reference(problem, pool, points)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--truths", type=int, default=20)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--noises", default="0.001,0.01")
    parser.add_argument("--seed", type=int, default=5, help="of the noise")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    case, rng = case_of(DEPTHS**1.5), np.random.default_rng(asked.seed)
    problem = inverse_problem(case)
    wider = {WIDER: float(f"{size(second(setup_of(case)).setup) / size(setup_of(case)):.12g}")}
    places = (1 - np.cos(np.pi * (np.arange(TRAINED) + 0.5) / TRAINED)) / 2
    low, high = case.fitted["alpha"].min, case.fitted["alpha"].max
    plain = [{**problem.start, "alpha": float(low + place * (high - low))} for place in places]
    own, other = (runs_of(case, problem, asked.folder, "runs", [{**point, **key} for point in plain]) for key in ({}, wider))
    other = [replace(run, parameters={k: v for k, v in run.parameters.items() if k != WIDER}) for run in other]
    fine = case_of(DEPTHS**1.5, {"elements": FINE})
    truths = [
        {name: float(a + unit * (b - a)) for unit, (name, (a, b)) in zip(row, TRUTHS.items(), strict=True)}
        for row in qmc.Sobol(2, seed=8).random(64)[: asked.truths]
    ]
    made = runs_of(fine, problem, asked.folder, "truths", [{**problem.start, "alpha": truth["alpha"]} for truth in truths])
    print(f"runs: {time.process_time():.0f} s of CPU", flush=True)
    good = True
    for noise in map(float, asked.noises.split(",")):
        rows = []
        for truth, run in zip(truths, made, strict=True):
            exact = problem.factor(truth) * run.forces[0]
            for _ in range(asked.draws):
                force = exact + noise * exact.max() * rng.standard_normal(exact.size)
                rows.append(judged(case_of(force), own, other, truth))
        good &= told(noise, rows)
    print(f"{time.process_time():.0f} s of CPU")
    return 0 if good else 1


def judged(case, own, other, truth):
    """Whether the verdicts are right, and for each parameter whether the truth is inside."""
    problem = inverse_problem(case)
    watched, correction = Watched(TwoMeshes(learn(problem, own), learn(problem, other))), MeshCorrection(case)
    solved = solve(problem, watched, case.fit, SILENT, correction)
    found = certainty(case, problem, solved.model or watched, solved)
    inside = {name: found.estimates[name].interval[0] <= truth[name] <= found.estimates[name].interval[1] for name in truth}
    words = {name: found.estimates[name].verdict for name in truth}
    spans = {name: found.estimates[name].interval for name in truth}
    wrong = [name for name in truth if words[name].startswith("determined") and not inside[name]]
    blamed = [name for name in truth if "misfit" in words[name]]
    if wrong or blamed:
        print(f"outside {wrong}, blames the law for {blamed}: {truth}, {spans}, {words}", flush=True)
    return inside, wrong, blamed, words


def told(noise, rows):
    number = len(rows)
    low, high = binom.interval(0.99, number, 0.95)
    right = sum(not blamed for _, _, blamed, _ in rows)
    held = {name: sum(inside[name] for inside, *_ in rows) for name in TRUTHS}
    said = ", ".join(f"{name} {count} inside" for name, count in held.items())
    sound = sum(not wrong for _, wrong, *_ in rows)
    print(f"noise {noise:.1%}: {right} of {number} verdicts name the right cause, {sound} have every determined truth inside; "
          f"{said}, band {low:.0f} to {high:.0f}; last: {rows[-1][3]}", flush=True)  # fmt: skip
    both = sum(not wrong and not blamed for _, wrong, blamed, _ in rows)
    return both >= 0.95 * number and all(count >= low for count in held.values())


if __name__ == "__main__":
    sys.exit(main())
