"""What a fit knows and what it doesn't, as plain numbers for the result: everything that follows once an optimum is found."""

import numpy as np

from indentfit.inference import inputs, profiles
from indentfit.inference.identifiability import MISFIT, NOTE, SMOOTH, identifiability, noise_of, verdict, widened
from indentfit.inverse.derivatives import curve_derivatives, evaluate_at_reference
from indentfit.inverse.exploration import MANY, facts_of
from indentfit.inverse.surrogate import learn, linearised

TRUSTED = 0.1  # error of a surrogate, as a share of the misfit, above which nothing is concluded from it
RIGHT = 0.15  # of a profile's limit: how well a run must meet what was predicted of it
SOLVES = 12  # sets of parameters that least squares may run, ends of profiles included
UNPROVED = (
    "profiles by a surrogate of the search's {runs} runs; {proved} of their {ends} ends confirmed by runs, since {solves} sets of "
    "parameters are allowed in all; `ga` confirms every end"
)
OF_RUNS = "profiles by a surrogate of the search's {runs} runs; {more} more sets of parameters were run to confirm them"
LINEARISED = (
    "profiles and bootstrap are of the curves linearised at the optimum: no surrogate can be trusted, or the parameters are many"
)


def certainty(case, problem, pool, optimum, exploration, progress):
    """Keys of the result, and the Identifiability (None where no derivatives were found): profiles, bootstrap, tests alone,
    weights, uncertain inputs, published values; parameters: name -> interval and verdict, by profile where there is one."""
    if not optimum.derivatives:
        return {}, None
    best, seed = optimum.best, case.fit.seed
    known = identifiability(problem, best, optimum.derivatives, exploration.equation_one)
    found = {"noise": noise_of(problem, known), "notes": _notes(known), "uncertain": {}}
    alone = known
    if case.fit.uncertain.given:
        progress(0.0, "uncertain inputs")
        known, found["uncertain"] = with_inputs(case, problem, pool, best, known)
        missing = found["uncertain"].pop("missing")
        found["notes"] += [f"the error by {name} is not in the intervals: {why}" for name, why in missing.items()]
    found["surrogate"] = exploration.facts or None
    if case.fit.profiles:
        progress(0.0, "profiles")
        surrogate = _learned(problem, pool, exploration)
        if surrogate is None:
            more = _linearised(problem, best, optimum.derivatives, known, seed)
        else:
            found["surrogate"] = exploration.facts or facts_of(surrogate)
            most = None if exploration.equation_one else max(SOLVES - pool.evaluations - bool(case.fit.published), 0)
            spent = pool.evaluations
            made = found["uncertain"].get("inputs", {})
            forces = np.hypot(*(made.get(name, {"sd": 0.0})["sd"] for name in ("mesh", "force")))
            more = _on_surrogate(problem, pool, surrogate, best, known, seed, progress, most, forces)
            if most is None and exploration.surrogate is None:
                more["notes"].append(OF_RUNS.format(runs=len(surrogate.samples), more=pool.evaluations - spent))
        found |= more | {"notes": found["notes"] + more["notes"]}
    found["rivals"] = [
        {"parameters": {name: one.parameters[name] for name in problem.free}, "objective": one.objective}
        for one in exploration.rivals
    ]
    found["parameters"] = _parameters(problem, best, known, found)
    found["published"] = _published(case, problem, pool, best, found["parameters"])
    found["summary"] = _summary(problem, found)
    return found, alone


def with_inputs(case, problem, pool, best, known):
    """The Identifiability whose intervals hold the errors of uncertain inputs too, and these in plain numbers."""
    shares = inputs.shares(case, problem, pool, best, known)
    wider = widened(problem, best, known, shares.covar)
    total = np.sqrt(np.diag(wider.errors.covar))
    stderr = {name: float(one) if np.isfinite(one) else None for name, one in zip(problem.free, total, strict=True)}
    found = {"inputs": shares.rows, "noise": {"share": shares.noise}, "stderr_total": stderr, "missing": shares.missing}
    return wider, found


def coverage(problem, surrogate, truth, sigma, draws, seed=0):
    """Whether the profile intervals of least-squares fits hold the truth: bool (draws, n_free).

    Curves are the surrogate's at the truth (name -> value) with white noise of sigma mN in each test.
    """
    exact = problem.scaled(truth, evaluate_at_reference(problem, surrogate, [truth])[0].forces)
    rng, x, inside = np.random.default_rng(seed), problem.units(truth), []
    for _ in range(draws):
        forces = [force + s * rng.standard_normal(force.size) for force, s in zip(exact, sigma, strict=True)]
        inside.append(holds(problem.measured(forces), surrogate, truth, x))
    return np.array(inside)


def holds(problem, surrogate, truth, x):
    """Whether each profile interval of a fit on the surrogate, started at x in units of the ranges, holds the truth."""
    weights = [test.weight / test.curve.force.size for test in problem.tests]
    parameters = problem.parameters(profiles.estimate(problem, surrogate, weights, x)[0])
    best = problem.judge(parameters, evaluate_at_reference(problem, surrogate, [parameters])[0].forces)
    known = identifiability(problem, best, curve_derivatives(problem, surrogate, problem.units(parameters)))
    return [
        profiles.chi2_at(problem, surrogate, best, known, name, truth[name]) <= known.quantile[n] ** 2
        for n, name in enumerate(problem.free)
    ]


def _learned(problem, pool, exploration):
    """The surrogate that all runs so far teach, None where it cannot be trusted or the parameters are too many for one."""
    surrogate = learn(problem, pool.known) if len(problem.free) <= MANY else None
    trusted = surrogate and (exploration.facts.get("reached") or surrogate.error <= TRUSTED)
    return surrogate if trusted else None


def _on_surrogate(problem, pool, surrogate, best, known, seed, progress, most, forces):
    """Profiles, proved by runs at their ends (sets of parameters, `most` of them where that is limited), and what follows; fits
    with one test alone and under other weights only where the search went all over the ranges, and runs are not limited."""
    first, found = profiles.profiles(problem, surrogate, best, known), {}
    if most is None:
        alone = profiles.alone(problem, pool, surrogate, seed, forces)
        found["tests_alone"] = alone if len(problem.tests) > 1 else {}
    report = lambda done, total: progress(0.9 * done / total, "runs at the ends of profiles")  # noqa: E731
    proofs = profiles.prove(problem, pool, surrogate, first, known, best, report, most)
    surrogate = learn(problem, pool.known)
    last = profiles.profiles(problem, surrogate, best, known)
    notes = []
    wrong = [name for name, rows in proofs.items() if not all(_right(row, last[name].limit) for row in rows)]
    if wrong:
        notes.append(f"the profiles of {', '.join(wrong)} were predicted badly at their ends, and corrected by the runs there")
    if most is not None:
        proved = sum(len(rows) for rows in proofs.values())
        notes.append(UNPROVED.format(runs=len(surrogate.samples), solves=SOLVES, proved=proved, ends=2 * len(last)))
    progress(0.95, "bootstrap")
    return found | {
        "notes": notes,
        "profiles": {name: {**_plain(one), "confirmed": proofs[name]} for name, one in last.items()},
        "bootstrap": profiles.bootstrap(problem, surrogate, best, known, seed),
        "weights_scan": profiles.scan_weights(problem, surrogate, seed) if most is None else [],
    }


def _linearised(problem, best, derivatives, known, seed):
    """Profiles and bootstrap without a run, of the curves linearised at the optimum: within the bounds, exact in the scale."""
    surrogate = linearised(problem, best, derivatives)
    found = profiles.profiles(problem, surrogate, best, known)
    return {
        "notes": [LINEARISED] if problem.searched else [],
        "profiles": {name: {**_plain(one), "confirmed": []} for name, one in found.items()},
        "bootstrap": profiles.bootstrap(problem, surrogate, best, known, seed),
    }


def _right(row, limit):
    if row["chi2"] is None or not np.isfinite(row["predicted"]):
        return False
    return abs(np.sqrt(row["chi2"]) - np.sqrt(row["predicted"])) <= RIGHT * np.sqrt(limit)


def _plain(profile):
    return {
        "values": profile.values.tolist(),
        "chi2": profile.chi2.tolist(),
        "limit": profile.limit if np.isfinite(profile.limit) else None,
        "interval": list(profile.interval),
    }


def _notes(known):
    smooth = any(one > SMOOTH for one in known.noise.autocorrelation)
    return [NOTE, *([MISFIT] if smooth else [])]


def _parameters(problem, best, known, found):
    """name -> interval and verdict, by profile where there is one, and the linear interval; wider by uncertain inputs."""
    rows = {}
    for n, (name, bounds) in enumerate(problem.free.items()):
        linear = known.interval[n].tolist()
        interval = found.get("profiles", {}).get(name, {}).get("interval", linear)
        said = verdict(best.parameters[name], interval, bounds, known.at_bound[n])
        rows[name] = {"interval": interval, "interval_linear": linear, "verdict": said}
        total = found["uncertain"].get("stderr_total", {}).get(name)
        if total is not None:
            rows[name]["stderr_total"] = total
    return rows


def _published(case, problem, pool, best, parameters):
    """The published parameters that the case names: their objective here, and whether each lies inside its interval."""
    if not case.fit.published:
        return None
    point = {**best.parameters, **case.fit.published}
    run = evaluate_at_reference(problem, pool, [point])[0]
    judged = problem.judge(point, run.forces) if run.forces else None
    inside = {
        name: bool(parameters[name]["interval"][0] <= value <= parameters[name]["interval"][1])
        for name, value in case.fit.published.items()
        if name in parameters
    }
    return {"parameters": dict(case.fit.published), "objective": judged and judged.objective, "inside": inside}


def _summary(problem, found):
    """Sentences: what these tests determine, with intervals, what they don't, and where published values lie."""
    kinds: dict = {"determined": [], "weakly determined": [], "not determined": []}
    for name, one in found["parameters"].items():
        said = one["verdict"].rpartition("; ")[2] if "bound" in one["verdict"] else one["verdict"]
        kind = next((kind for kind in kinds if said.startswith(kind)), "not determined")
        low, high = one["interval"]
        kinds[kind].append(f"{name} ({low:.3g} to {high:.3g})")
    number = {1: "this curve", 2: "these two curves"}.get(len(problem.tests), f"these {len(problem.tests)} curves")
    sentences = [f"{kind} by {number}: {', '.join(names)}" for kind, names in kinds.items() if names]
    published = found["published"]
    if published:
        said = [
            f"{name} = {published['parameters'][name]:g} {'inside' if inside else 'outside'}"
            for name, inside in published["inside"].items()
        ]
        value = published["objective"]
        objective = f"; together their objective is {value:.4g} mN" if value is not None else ""
        sentences.append(f"published values and the 95 % intervals: {', '.join(said)}{objective}")
    return sentences
