"""Campaign of designs: does a further test bring the interval that `design` promises, and is the pair ranked first among the best?

    python tests/campaigns/design.py [--truths 50] [--draws 3] [--seed 0] [--estimate] [--kept runs.npz] [--output design.jsonl]

The case is cases/quickstart (strip, forces along and across the fibres). At each truth of a Latin hypercube `design` ranks further
tests by the case's own tests at the truth, with noise of 1 % of the largest force and 5 um in side views. Synthetic curves of the
case and of each pair that it keeps, with that noise, are then fitted by least squares, and the 95 % profile interval of the worst
parameter is compared with the promised one. With --estimate designs are made at what the
case's own curves gave, as a laboratory has to. Shared runs (tests/fixtures/shared_runs.py) stand in the place of the mechanics,
for the truths and for the fits; their error is printed beside the noise.

Seen (29 November 2026, 50 truths, 3 draws): achieved over promised 1.08 for the first test and 1.03 for the first pair in the
median; off by 8.8 and 5.9 % in the median; the first pair among the best two in 92 %, its interval over the best 1.00 in the
median, 1.07 at most. Error of shared runs 0.11 % of the largest force, beside 1 % noise. With --estimate 1.07 and 1.08, off by
24.5 and 19.7 %, because two force curves leave phi open; the first pair among the best two in 88 %.

Seen (30 November 2026, 50 truths of --seed 12, --estimate, after the rule was chosen on others): achieved over promised 0.92 and
0.92, off by 24.2 and 19.4 % in the median; the first pair among the best two in 94 %, its interval over the best 1.00 in the
median, 1.33 at most. The spans that are told (90 %) held 92 and 91 % of single fits. The same truths without
--estimate: 1.00 and 0.99, off by 7.7 and 6.4 %; the first pair among the best two in 94 %.

Exit code 1 where the achieved interval is more than 25 % off the promised one in the median of the truths, or where the pair that
is ranked first is among the best two in less than 80 % of them.
"""

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from fixtures.shared_runs import Basis, Exact, SharedRuns, along, learned
from scipy.stats import qmc

from indentfit.case import Test
from indentfit.case.field_tests import with_field_tests
from indentfit.case.measured_field import MeasuredField
from indentfit.curve import Curve
from indentfit.displacements import Displacements
from indentfit.experiment.measured import read_case
from indentfit.inference import profiles
from indentfit.inference.estimate import estimate
from indentfit.inference.identifiability import identifiability
from indentfit.inverse.derivatives import curve_derivatives, evaluate_at_reference
from indentfit.inverse.problem import inverse_problem
from indentfit.runs.pool import RunPool
from indentfit.study import design as asking
from indentfit.study import further, views

QUICKSTART = Path(__file__).parents[2] / "cases" / "quickstart" / "case.toml"
SEEN, PAIRS = 0.005, 6  # mm, of a displacement in a view; pairs that are fitted, without outlines
BASIS = Basis({"zeta": (0.0, 20.0), "phi": (0.0, 5.0)}, {"zeta": 7, "phi": 5}, "mu")
TRUTHS = {"mu": (0.5, 3.0), "zeta": (1.0, 8.0), "phi": (0.2, 3.0)}


class Shared:
    """The shared runs of all variants of a case that `design` tries."""

    def __init__(self, case, kept):
        self.case, self.runs = case, {}
        self.depths = None
        stored = dict(np.load(kept)) if kept and kept.exists() else {}
        for change, variant in further._variants(case):
            tried, depths = self.tried(change, variant)
            self.depths = depths
            known = {test.name: stored[f"{change}|{test.name}"] for test in tried.tests if f"{change}|{test.name}" in stored}
            if len(known) < len(tried.tests):
                print(f"runs of {change or 'the case'}", flush=True)
                known = learned(tried, BASIS)
                stored |= {f"{change}|{name}": row for name, row in known.items()}
                if kept:
                    np.savez(kept, **stored)
            self.runs[_indenter(variant)] = known
        specimens = tuple(further._specimens(case))
        known = learned(case.model_copy(update={"tests": specimens, "curves": (None,) * len(specimens)}), BASIS)
        self.specimens = {_kind(test): known[test.name] for test in specimens}

    def error(self, points=3):
        """Largest difference to runs of the case as it is, over the largest force, or displacement, of its test."""
        tried, _ = self.tried("", self.case)
        rng, names = np.random.default_rng(1), list(BASIS.ranges)
        low, high = np.array([TRUTHS[name] for name in names]).T
        truths = [
            {"mu": 1.0, **dict(zip(names, row, strict=True))} for row in (low + rng.random((points, 2)) * (high - low)).tolist()
        ]
        with RunPool(tried, 1) as pool:
            pairs = zip(pool.evaluate(truths), self.pool(tried).evaluate(truths), strict=True)
        off, number = [], 6 * further.POINTS
        for exact, known in pairs:
            for right, row in zip(exact.forces, known.forces, strict=True):
                parts = zip(np.split(right, [number]), np.split(row, [number]), strict=True)
                off += [np.abs(a - b).max() / np.abs(a).max() for a, b in parts]
        return float(max(off))

    def tried(self, change, variant):
        """The tests of a variant as `design` makes them, and the depths of views."""
        deepest = max(float(variant.outputs(test)[-1]) for test in variant.indentations)
        depths = [factor * deepest for factor in further.DEPTHS if factor * deepest <= further.DEEPEST * variant.sample.thickness]
        points = 6 * further.POINTS
        tests = tuple(Test(name=f"{angle}", angle=angle, depth=depths[-1], points=points) for angle in further.ANGLES)
        tried = variant.model_copy(update={"tests": tests, "curves": (None,) * len(tests)})
        return (tried if change else views.with_views(tried, depths)), depths

    def pool(self, case, *_):
        """A model of the tests of a case, in the place of a RunPool."""
        return SharedRuns(BASIS, [self.rows(case, test) for test in case.tests])

    def rows(self, case, test):
        """Coefficients of the forces of a test at its depths, and of its displacements, and the number of forces."""
        if test.kind != "indentation":
            return self.specimens[_kind(test)], case.outputs(test).size
        indenter = case.indenter_of(test)
        known = self.runs[_indenter(case.model_copy(update={"indenter": indenter}))][f"{test.angle:.0f}"]
        number = 6 * further.POINTS
        own = self.depths[-1] * np.arange(1, number + 1) / number
        parts, forces = [known[:, :number] @ along(own, case.outputs(test)).T], case.outputs(test).size
        if test.field:
            sides = np.split(known[:, number:], 2, axis=1)
            parts += [self._seen(sides, seen.points) for seen in test.field]
        return np.concatenate(parts, axis=1), forces

    def _seen(self, sides, points):
        """Coefficients of the displacements of a field on one side at some of the depths."""
        side = sides[0] if abs(points.points[0, 0]) > 0 else sides[1]
        wanted = sorted({round(float(depth), 9) for depth in points.depths})
        parts = np.split(side, len(self.depths), axis=1)
        return np.concatenate([parts[int(np.argmin(np.abs(np.array(self.depths) - depth)))] for depth in wanted], axis=1)


def _kind(test):
    return test.kind, test.fibres, test.loading, test.plates


def _indenter(case):
    return repr(sorted(case.indenter.model_dump(mode="json", exclude_none=True).items()))


def own_case(case, told):
    """The case with further tests behind its own, as `told` of a design, without curves; views have a field."""
    tests = [test.model_copy(update={"weight": 1.0}) for test in case.tests]
    for n, (test, variant) in enumerate(told):
        if test.angle is None:
            tests.append(variant.model_copy(update={"name": f"further {n}", "weight": 1.0}))
            continue
        own = Test(name=f"further {n}", angle=test.angle, depth=test.depth, points=further.POINTS, weight=1.0)
        changed = variant.indenter.model_dump(exclude_none=True)
        keys = {key: value for key, value in changed.items() if case.indenter.model_dump(exclude_none=True).get(key) != value}
        tests.append(own.model_copy(update={"indenter": Test(name="x", angle=0, depth=1, indenter=keys).indenter}) if keys else own)
    return case.model_copy(update={"tests": tuple(tests), "curves": (*case.curves, *(None,) * len(told))})


def field_of(case, words, depth, rng, moved=None):
    """The measured field of a side view, with noise where displacements (2 m,) are given."""
    axis = words[-1]
    (field,) = [seen for side, seen in zip(views.AXES, views.with_views(case, [depth]).tests[0].field, strict=True) if side == axis]
    points = field.points
    values = points.values if moved is None else moved
    sd = np.full(values.size, SEEN)
    return MeasuredField(file=Displacements(points.points, points.directions, values, sd, points.depths, points.file))


def achieved(shared, case, told, truth, noise, draws, seed, worst):
    """Half widths (draws,) of the 95 % intervals of a parameter, by fits to the case's tests and further ones."""
    whole, widths = own_case(case, told), []
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw])
        measured = measure(shared, whole, told, truth, noise, rng)
        problem = inverse_problem(with_field_tests(measured))
        model = Exact(problem, shared.pool(measured))
        parameters = problem.parameters(estimate(problem, model, problem.weights, problem.units(truth))[0])
        best = problem.judge(parameters, evaluate_at_reference(problem, model, [parameters])[0].forces)
        known = identifiability(problem, best, curve_derivatives(problem, model, problem.units(parameters)))
        n = problem.number(worst)
        x = estimate(problem, model, known.weights, problem.units(parameters))[0]
        walk = profiles._Walk(problem, model, known, n, x)
        low, high = (profiles.end_of_profile(walk.chi2, float(x[n]), bound, walk.limit) for bound in (0.0, 1.0))
        widths.append((problem.value(worst, high) - problem.value(worst, low)) / 2)
    return np.array(widths)


def own_estimate(shared, case, truth, noise, seed):
    """What a fit of the case's own synthetic curves gives."""
    measured = measure(shared, own_case(case, []), [], truth, noise, np.random.default_rng([seed, 1000]))
    problem = inverse_problem(measured)
    model = Exact(problem, shared.pool(measured))
    starts = [problem.units({**truth, "phi": phi}) for phi in (0.5, 1.5, 3.0)]
    ends = [estimate(problem, model, problem.weights, start) for start in starts]
    return problem.parameters(min(ends, key=lambda end: end[1])[0])


def measure(shared, case, told, truth, noise, rng):
    """A case with synthetic curves of all tests, with noise."""
    seen = {f"further {n}": test for n, (test, _) in enumerate(told) if test.kind == "side view"}
    with_fields = tuple(
        test.model_copy(update={"field": (field_of(case, seen[test.name].change, test.depth, rng),)}) if test.name in seen else test
        for test in case.tests
    )
    case = case.model_copy(update={"tests": with_fields})
    exact = shared.pool(case).evaluate([truth])[0].forces
    largest = max(float(exact[n].max()) for n in range(2))
    curves, tests = [], []
    for test, row in zip(case.tests, exact, strict=True):
        number = case.outputs(test).size
        sd = noise * (largest if test.kind == "indentation" else float(np.abs(row).max()))
        force = row[:number] + sd * rng.standard_normal(number)
        axes = Curve(case.outputs(test), force).axes if test.kind == "indentation" else further_axes(test)
        curves.append(Curve(case.outputs(test), force, axes=axes))
        if test.field:
            moved = row[number:] + SEEN * rng.standard_normal(row.size - number)
            words = seen[test.name].change
            if words.startswith("outline"):
                moved = None
            test = test.model_copy(update={"field": (field_of(case, words, test.depth, rng, moved),)})
        tests.append(test)
    return case.model_copy(update={"tests": tuple(tests), "curves": tuple(curves)})


def further_axes(test):
    from indentfit.case.specimen import axes_of

    return axes_of(test)


def told_by(case):
    """whole words of a further test -> what it is made of: the variant of the case, or the test of another kind."""
    variants = {change: variant for change, variant in further._variants(case)}
    specimens = {}
    for test in further._specimens(case):
        tried = further._of_specimen.__globals__["WORDS"].get(test.kind or "", f"compression between {test.plates} plates")
        specimens[f"{tried}, fibres {test.fibres}, to a strain of {test.strain:g}"] = test

    def made(test):
        if test.angle is None:
            return test, specimens[test.change]
        return test, variants["" if test.kind == "side view" else test.change]

    return made


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truths", type=int, default=50)
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=0, help="of the truths and of their noise")
    parser.add_argument("--kept", type=Path, help="file in which shared runs are kept")
    parser.add_argument("--output", type=Path, help="file of JSON lines; the campaign goes on where it was stopped")
    parser.add_argument("--estimate", action="store_true", help="design at the estimate of the case's own curves")
    asked = parser.parse_args()
    case = read_case(QUICKSTART)
    shared = Shared(case, asked.kept)
    print(f"largest error of shared runs, over the largest force or displacement: {shared.error():.1e}", flush=True)
    for place in (asking, further):
        place.RunPool = shared.pool
    low, high = np.array(list(TRUTHS.values())).T
    rows = low + qmc.LatinHypercube(len(TRUTHS), seed=asked.seed).random(50) * (high - low)
    made, records = told_by(case), kept_records(asked.output)
    for number in range(min(asked.truths, 50)):
        key = f"{number} {'estimate' if asked.estimate else 'truth'}"
        if key not in records:
            truth = dict(zip(TRUTHS, rows[number].tolist(), strict=True))
            records[key] = {"key": key} | record_of(shared, case, made, truth, 1000 * asked.seed + number, asked)
            if asked.output:
                with asked.output.open("a") as output:
                    output.write(json.dumps(records[key]) + "\n")
            print(key, json.dumps(records[key]), flush=True)
    return summary([record for key, record in records.items() if key.endswith("estimate") == asked.estimate])


def kept_records(path):
    lines = path.read_text().splitlines() if path and path.exists() else []
    return {record["key"]: record for record in map(json.loads, lines)}


def record_of(shared, case, made, truth, number, asked):
    """Of one truth: the achieved half width over the promised one of the first test and of the first pair, and its rank."""
    at = own_estimate(shared, case, truth, asked.noise, number) if asked.estimate else truth
    designed = asking.design(case, at, None, None, SEEN, asked.estimate)
    by_words, worst = {test.whole_words: test for test in designed.candidates}, designed.worst
    best = next(test for test in designed.candidates if not test.change.startswith("outline"))
    pairs = [pair for pair in designed.pairs if "outline" not in pair.first + pair.second][:PAIRS]
    common = truth, asked.noise, asked.draws, number, worst
    singles = achieved(shared, case, [made(best)], *common)
    rows = [achieved(shared, case, [made(by_words[words]) for words in (pair.first, pair.second)], *common) for pair in pairs]
    single, firsts, widths = float(np.median(singles)), rows[0], [float(np.median(row)) for row in rows]
    return {
        "truth": truth,
        "worst": worst,
        "test": best.whole_words,
        "pair": [pairs[0].first, pairs[0].second],
        "of_test": single / best.half_width[worst],
        "of_pair": widths[0] / pairs[0].half_width[worst],
        "spans": [within(singles, best, worst), within(firsts, pairs[0], worst)],
        "rank": int(np.argsort(np.argsort(widths))[0]) + 1,
        "over_best": widths[0] / min(widths),
    }


def within(widths, judged, worst):
    """The share of half widths in the span that a design at an estimate tells; None without one."""
    if judged.between is None:
        return None
    low, high = judged.between[worst]
    return float(np.mean((low <= widths) & (widths <= high)))


def summary(records):
    """Print what the campaign shows; 0 where it holds what the issue asks."""
    of_test, of_pair, ranks, losses = (
        np.array([record[key] for record in records]) for key in ("of_test", "of_pair", "rank", "over_best")
    )
    near, share = [float(np.median(np.abs(ratios - 1))) for ratios in (of_test, of_pair)], float(np.mean(ranks <= 2))
    print(
        f"{len(records)} truths; achieved over promised: first test {np.median(of_test):.3f}, first pair {np.median(of_pair):.3f}"
    )
    print(f"|achieved / promised - 1|, median: {near[0]:.3f} and {near[1]:.3f}; first pair among the best two in {share:.0%}")
    told = [record["spans"] for record in records if record.get("spans", [None])[0] is not None]
    if told:
        inside = np.mean(told, axis=0)
        print(f"single fits within the span that is told: first test {inside[0]:.0%}, first pair {inside[1]:.0%}")
    print(f"its interval over the best: median {np.median(losses):.3f}, largest {max(losses):.3f}")
    return 0 if max(near) <= 0.25 and share >= 0.8 else 1


if __name__ == "__main__":
    sys.exit(main())
