"""Coverage campaign where every input is known exactly: do 95 % intervals hold the truth at 5, 1 and 0.1 % noise?

    python tests/campaigns/known_inputs.py [--truths 6] [--elements 1000] [--draws 25] [--ledger known_inputs.sqlite]

The curves are those of the shipped white matter on a mesh of at least 1,000 bricks, at random zeta and phi and at the isotropic
sample (zeta = phi = 0), with white noise. All fits share two surrogates, of the case's own mesh and of the second mesh by which a
fit corrects its curves; otherwise each fit is a fit: optimum of equation (1), correction for the mesh, errors, profiles. The ledger
keeps the runs, so that a campaign goes on where it was stopped.

Prints how often mu, zeta and phi lie inside their intervals, with the exact binomial 99 % band about 95 % (draws at one truth share
the error of its mesh, so that the band is that of as many independent fits only where the noise dominates), and the median of half
an interval. Exit code 1 where a coverage lies below the band of the truths.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import binom, qmc

from indentfit.case import Case
from indentfit.curve import Curve
from indentfit.experiment.measured import read_case
from indentfit.fem.mesh_error import second
from indentfit.fem.meshing import size
from indentfit.inference import profiles
from indentfit.inference.certainty import with_inputs
from indentfit.inference.estimate import best_on
from indentfit.inference.identifiability import identifiability
from indentfit.inference.inputs import Solution
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.exploration import Watched
from indentfit.inverse.generations import parameters_of
from indentfit.inverse.mesh_correction import MeshCorrection
from indentfit.inverse.polish import polish
from indentfit.inverse.polynomials import design_points
from indentfit.inverse.problem import inverse_problem
from indentfit.inverse.surrogate import learn
from indentfit.runs.ledger import Ledger
from indentfit.runs.mechanics import WIDER
from indentfit.runs.points import setup_of
from indentfit.runs.pool import RunPool

CASE = Path(__file__).parents[2] / "cases" / "white_matter_2017" / "case.toml"
NOISES = (0.05, 0.01, 0.001)  # of each test's largest force
MOST = {"zeta": 9.0, "phi": 3.0}  # of the truths
MU, TRAINED, DEPTHS = 1.49, 16, np.linspace(0.0275, 0.33, 12)


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


def the_case():
    """The shipped case with curves of other depths, whose forces do not matter."""
    case = read_case(CASE, ["fit.workers=1"])
    tests = [test.model_copy(update={"curve": Curve(DEPTHS, 10 * DEPTHS), "path": None}) for test in case.tests]
    given = {name: getattr(case, name) for name in ("sample", "indenter", "mesh", "solver", "material", "fit")}
    return Case(**given, tests=tests)


def truths(number, seed=11):
    """zeta and phi of the isotropic sample, and of a sequence that fills the ranges evenly."""
    places = qmc.Sobol(2, seed=seed).random(64)[: number - 1]
    return [(0.0, 0.0), *((round(MOST["zeta"] * a, 3), round(MOST["phi"] * b, 3)) for a, b in places)]


def trained(problem, pool, key):
    """The surrogate of one mesh."""
    places = design_points(2, True, 0, betas=problem.betas)
    places = np.vstack([places, qmc.Sobol(2, seed=3).random(32)])[:TRAINED]
    points = [{**parameters_of(problem, place), **key} for place in places]
    known = evaluate_at_reference(problem, pool, points)
    return learn(problem, [replace(run, parameters={n: v for n, v in run.parameters.items() if n not in key}) for run in known])


def fitted(case, problem, two):
    """Optimum and errors of a fit, and the surrogate of its corrected curves."""
    watched, correction = Watched(two), MeshCorrection(case if case.fit.uncertain.mesh else None)
    first = best_on(problem, two.own, 0)
    model = correction.of(problem, watched, first.parameters)
    end = polish(problem, model, first)
    known = identifiability(problem, end.best, end.derivatives, equation_one=True)
    factors = 1 + np.concatenate(correction.error.correction) if correction.error else 1.0
    polynomial = replace(two.own.fitted, coefficients=two.own.fitted.coefficients * factors)
    if correction.error:
        known = with_inputs(Solution(case, problem, model, end.best, known))[0].known
    return end.best, known, replace(two.own, fitted=polynomial)


def held(case, problem, two, truth):
    """Whether each profile interval holds the truth, and half of each linear interval."""
    best, known, surrogate = fitted(case, problem, two)
    inside = [
        profiles.chi2_at(problem, surrogate, best, known, name, truth[name]) <= known.quantile[n] ** 2
        for n, name in enumerate(problem.free)
    ]
    return inside, np.ptp(known.interval, axis=1) / 2, problem.values(best.parameters)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truths", type=int, default=6)
    parser.add_argument("--elements", type=int, default=1000)
    parser.add_argument("--draws", type=int, default=25)
    parser.add_argument("--ledger", default="known_inputs.sqlite")
    asked, rng = parser.parse_args(), np.random.default_rng(0)
    case = the_case()
    base = inverse_problem(case)
    with Ledger(asked.ledger, case) as ledger, RunPool(case, ledger=ledger) as pool:
        other = {WIDER: float(f"{size(second(setup_of(case)).setup) / size(setup_of(case)):.12g}")}
        two = TwoMeshes(trained(base, pool, {}), trained(base, pool, other))
        print(f"surrogates of degree {two.own.degree} and {two.other.degree}, errors {two.own.error:.3f}, {two.other.error:.3f}")
        curves = []
        for zeta, phi in truths(asked.truths):
            point = base.at_reference({"mu": MU, "zeta": zeta, "phi": phi})
            run = pool.evaluate([{**point, "mesh.elements": asked.elements}])[0]
            good = run.forces is not None and all(facts.get("tries", 1) == 1 for facts in run.facts)
            print(f"truth zeta {zeta:g}, phi {phi:g}: {'made' if good else run.cause or 'only at a second try'}", flush=True)
            if good:
                curves.append(({"mu": MU, "zeta": zeta, "phi": phi}, [MU / base.reference * force for force in run.forces]))
    return judged(case, base, two, curves, asked.draws, rng)


def judged(case, base, two, curves, draws, rng):
    names, good = list(base.free), True
    for noise in NOISES:
        rows, halves = [], []
        for truth, forces in curves:
            parts = []
            for _ in range(draws):
                noisy = [force + noise * force.max() * rng.standard_normal(force.size) for force in forces]
                inside, half, values = held(case, base.measured(noisy), two, truth)
                parts.append(inside)
                halves.append(half)
            rows.append(np.mean(parts, axis=0))
            print(f"  noise {noise:.1%}, zeta {truth['zeta']:g}, phi {truth['phi']:g}: inside {np.round(rows[-1], 2)}, "
                  f"last {np.round(values, 3)} +- {np.round(half, 3)}", flush=True)  # fmt: skip
        shares, number = np.mean(rows, axis=0), len(curves) * draws
        low, high = binom.interval(0.99, number, 0.95)
        fewest = binom.ppf(0.005, len(curves), 0.95) / len(curves)
        said = ", ".join(f"{name} {share:.1%}" for name, share in zip(names, shares, strict=True))
        print(f"noise {noise:.1%}: {said} of {number} ({len(curves)} truths); band {low / number:.1%} to {high / number:.1%}; "
              f"median half interval {np.round(np.median(halves, axis=0), 3)}", flush=True)  # fmt: skip
        good = good and bool(np.all(shares >= fewest))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
