"""Benchmarks of the forward solve. Not tests: nothing here fails, and times are only worth what the machine was quiet.

    python tests/benchmarks/forward.py solve --elements 1000 --elements 8000   phases, counts and memory of one configuration
    python tests/benchmarks/forward.py newton --elements 39312                 the same against a factorisation at each iteration
    python tests/benchmarks/forward.py loop --elements 39312                   element loop against forms and FElupe ([bench])
    python tests/benchmarks/forward.py default                                 both configurations of the shipped case as it is
    python tests/benchmarks/forward.py accuracy                                error against cost of both bricks (error_cost.svg)

Every measurement runs in a process of its own (memory is its peak), `--repeat` times; the median is shown. `--set KEY=VALUE`
changes the case.
The case is cases/white_matter_2017 at the published optimum, friction 0.5, 25 outputs to 10 %, with the paper's brick (q1p0).
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

CASE = Path(__file__).parents[2] / "cases" / "white_matter_2017" / "case.toml"
OPTIMUM = ("material.parameters={mu=1.49,zeta=4.68,phi=0.68}", "indenter.friction=0.5")
NEO_HOOKEAN = ("material.model='neo_hookean'", "material.parameters={mu=1.49}", "indenter.friction=0.5")
NEWTONS = "as shipped", "our factor at each iteration", "unsymmetric factor at each iteration"
PAPER = ("solver.element='q1p0'",)


@click.group()
def main():
    """Times, counts and memory of the forward solve."""


def _common(command):
    for option in (
        click.option("--elements", type=int, multiple=True, default=(1000,), help="Bricks of the quarter; may be repeated."),
        click.option("--set", "settings", multiple=True, help="KEY=VALUE of the case."),
        click.option("--angle", type=int, default=0),
        click.option("--repeat", type=int, default=1),
        click.option("--material", type=click.Choice(["white_matter", "neo_hookean"]), default="white_matter"),
    ):
        command = option(command)
    return command


@main.command()
@_common
def solve(elements, settings, angle, repeat, material):
    """Phases of one configuration, a line for each size."""
    for size in elements:
        _show(_median([_child("run", size, settings, angle, material) for _ in range(repeat)]))


@main.command()
@_common
def newton(elements, settings, angle, repeat, material):
    """One configuration as shipped and by full Newton, in turn: with our factor made at each iteration, and as finite-element
    codes do it with friction, the unsymmetric tangent factorised in double precision at each iteration, and no GMRES."""
    for size in elements:
        runs = [[_child("run", size, (*settings, kind), angle, material) for kind in NEWTONS] for _ in range(repeat)]
        ours, *others = (_median(list(each)) for each in zip(*runs, strict=True))
        _show(ours)
        for kind, full in zip(NEWTONS[1:], others, strict=True):
            _show(full)
            apart = abs(ours["force"] / full["force"] - 1)
            click.echo(f"{kind}: full Newton takes {full['wall'] / ours['wall']:.1f} times as long; forces {apart:.1e} apart")


@main.command()
@_common
def loop(elements, settings, angle, repeat, material):
    """Residual and tangent of the body on one thread: the compiled loop, scikit-fem forms, FElupe."""
    for size in elements:
        found = _child("loop", size, settings, angle, material)
        click.echo(f"{found['elements']} bricks, {found['dofs']} dofs (s): " + json.dumps(found["seconds"]))
        click.echo("times slower than the compiled tangent: " + json.dumps(found["ratios"]))


@main.command()
@click.option("--repeat", type=int, default=3)
@click.option("--set", "settings", multiple=True)
def default(repeat, settings):
    """The shipped case with its default mesh and element, both configurations."""
    for angle in (0, 90):
        _show(_median([_child("run", 0, ("default", *settings), angle, "white_matter") for _ in range(repeat)]))


SIZES = {"q2p1": (20, 60, 125, 245, 444), "q1p0": (300, 1000, 3000, 8000)}
REFERENCES = Path(__file__).parents[3] / "shared" / "references"


@main.command()
@click.option("--repeat", type=int, default=1)
def accuracy(repeat):
    """Error of the force at 10 % against ../shared/references and CPU time, a line for each mesh and brick; a figure."""
    rows = []
    for angle in (0, 90):
        reference = json.loads((REFERENCES / f"opt_{angle}deg_f0.5.json").read_text())
        exact = reference["force_mN"][-1]
        for brick, sizes in SIZES.items():
            for size in sizes:
                settings = ("default", f"solver.element='{brick}'", f"mesh.elements={size}")
                run = _median([_child("run", size, settings, angle, "white_matter") for _ in range(repeat)])
                error = 100 * (run["force"] / exact - 1)
                rows.append((angle, brick, run["elements"], run["cpu"], error, reference["error_percent"]))
                click.echo("{} deg {}: {} bricks, {:.2f} s CPU, error {:+.2f} % (reference +- {} %)".format(*rows[-1]))
    _draw(rows, Path(__file__).with_name("error_cost.svg"))


def _draw(rows, path):
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import FuncFormatter

    figure, axes = plt.subplots(1, 2, figsize=(7, 3), sharey=True, layout="constrained")
    for angle, axis in zip((0, 90), axes, strict=True):
        for brick, colour, mark in (("q2p1", "#0072b2", "o"), ("q1p0", "#d55e00", "s")):
            points = [(cpu, abs(error), bricks) for at, kind, bricks, cpu, error, _ in rows if (at, kind) == (angle, brick)]
            axis.plot(*zip(*[point[:2] for point in points], strict=True), mark + "-", color=colour, ms=4, lw=1, label=brick)
            for cpu, error, bricks in points:
                place = {"xytext": (3, 4)} if brick == "q1p0" else {"xytext": (-3, -9), "ha": "right"}
                axis.annotate(f"{bricks:,}", (cpu, error), textcoords="offset points", fontsize=6, color=colour, **place)
        own = next(row[-1] for row in rows if row[0] == angle)
        axis.axhspan(1e-3, own, color="0.9", lw=0, label=f"reference's own error, {own} %")
        axis.set(xscale="log", yscale="log", ylim=(0.1, 20), xlabel="CPU time of one configuration, s")
        axis.set_title(f"{angle}°, friction 0.5", fontsize=9)
        for scale in (axis.xaxis, axis.yaxis):
            scale.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.margins(x=0.12)
        axis.legend(fontsize=6, loc="upper right", frameon=False)
    axes[0].set_ylabel("error of the force at 10 %, %")
    figure.savefig(path, metadata={"Date": None})


def _child(task, *arguments):
    text = json.dumps(arguments)
    done = subprocess.run([sys.executable, __file__, "child", task, text], capture_output=True, text=True)
    if done.returncode:
        raise click.ClickException(done.stderr.strip().splitlines()[-1])
    return json.loads(done.stdout)


def _median(runs):
    """The run whose wall time is the (lower) median."""
    wanted = statistics.median_low([run["wall"] for run in runs])
    return next(run for run in runs if run["wall"] == wanted) | {"runs": len(runs)}


def _show(run):
    phases = ", ".join(f"{name} {seconds:.2f}" for name, seconds in run["phases"].items())
    click.echo(
        f"{run['elements']} bricks, {run['dofs']} dofs, {run['linear']}, {run['angle']} deg: {run['wall']:.2f} s wall "
        f"({run['runs']} runs), {run['cpu']:.1f} s CPU, {run['memory_GB']:.2f} GB; force {run['force']:.4f} mN; "
        f"{run['counts']}\n    {phases}"
    )


# ---- in the child ------------------------------------------------------------------------------------------------


@main.command(hidden=True)
@click.argument("task")
@click.argument("text")
def child(task, text):
    click.echo(json.dumps({"run": _run, "loop": _loop}[task](*json.loads(text))))


def _case(size, settings, material):
    from indentfit.experiment.measured import read_case

    given = [setting for setting in settings if "=" in setting]
    brick = () if "default" in settings else (*PAPER, f"mesh.elements={size}")
    return read_case(CASE, [*(OPTIMUM if material == "white_matter" else NEO_HOOKEAN), *brick, *given])


def _run(size, settings, angle, material):
    from indentfit.fem.linear.solver import LinearSolver
    from indentfit.fem.simulate import Model
    from indentfit.runs.points import press_of, setup_of

    case = _case(size, settings, material)
    _warm(case, angle)
    phases = {}
    started, cpu = time.perf_counter(), time.process_time()
    model = Model(setup_of(case))
    phases["set-up"] = time.perf_counter() - started
    _watch(model, phases)
    if NEWTONS[1] in settings:
        plain = LinearSolver.solve
        model.solver.solve = lambda *given, **named: (model.solver.forget(), plain(model.solver, *given, **named))[1]
    if NEWTONS[2] in settings:
        model.solver.solve = _factorising(model.solver, phases)
    law = case.law(**case.start_values())
    test = next(test for test in case.tests if test.angle == angle)
    result = model.run(press_of(case, test, law))
    wall = time.perf_counter() - started
    wanted = ("steps", "newton_iterations", "factorizations", "solves", "krylov_iterations", "tries")
    counts = {key: getattr(result.facts, key) for key in wanted}
    return {
        **model.mesh_facts().as_json(),
        "linear": model.solver.name,
        "angle": angle,
        "wall": wall,
        "cpu": time.process_time() - cpu,
        "memory_GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "force": float(result.force[-1]),
        "counts": counts,
        "phases": phases | {"rest": wall - sum(phases.values())},
    }


def _factorising(solver, phases):
    """A solve(tangent, b) by PARDISO's unsymmetric factors of the tangent, which has the contact and the bulk stiffness in it."""
    import pypardiso

    direct = pypardiso.PyPardisoSolver(mtype=11)

    def solve(tangent, b, *_, **named):
        started = time.perf_counter()
        solver.work = replace(solver.work, solves=solver.work.solves + 1, factorizations=solver.work.factorizations + 1)
        x = direct.solve(tangent.whole, b)
        phases["factorisation"] = phases.get("factorisation", 0.0) + time.perf_counter() - started
        return x

    return solve


def _warm(case, angle):
    """Compiles, or loads what was compiled, outside the time."""
    from indentfit.experiment.measured import read_case
    from indentfit.runs.forward import simulate

    simulate(read_case(CASE, [*OPTIMUM, f"solver.element='{case.solver.element}'", "mesh.elements=30"]))


def _watch(model, phases):
    """Adds up the time of what a solve is made of, by wrapping it."""
    from indentfit.fem.linear import direct, multigrid, pardiso

    def wrap(owner, name, phase):
        plain = getattr(owner, name)

        def timed(*given, **named):
            before, started = sum(phases.values()), time.perf_counter()
            try:
                return plain(*given, **named)
            finally:  # without what was counted inside
                phases[phase] = phases.get(phase, 0.0) + time.perf_counter() - started - (sum(phases.values()) - before)

        setattr(owner, name, timed)

    for name, phase in (("tangent", "tangent"), ("forces", "residual"), ("state", "kinematics"), ("dilatation_map", "dilatation")):
        wrap(model.body, name, phase)
    for name in ("touch", "add_tangent", "residual"):
        wrap(model.contact, name, "contact")
    wrap(model.solver._factoriser, "factorize", "factorisation")
    wrap(direct.DirectFactor, "preconditioner", "contact's dense factor")
    wrap(multigrid.MultigridFactor, "preconditioner", "contact's dense factor")
    wrap(pardiso._Library, "call", "PARDISO")
    plain, names = pardiso._Library.call, {pardiso.ANALYSIS: "analysis", pardiso.FACTOR: "factorisation"}

    def by_phase(self, phase, *given, **named):
        before = dict(phases)
        written = plain(self, phase, *given, **named)
        spent = phases.pop("PARDISO") - before.pop("PARDISO", 0.0)
        phases[names.get(phase, "back-substitution")] = phases.get(names.get(phase, "back-substitution"), 0.0) + spent
        return written

    pardiso._Library.call = by_phase
    wrap(model.solver, "_krylov", "GMRES")


def _loop(size, settings, angle, material):
    from threadpoolctl import threadpool_limits

    from indentfit.fem.element import Solid
    from indentfit.fem.forms import FormSolid
    from indentfit.fem.mesh import quarter

    case = _case(size, settings, material)
    mesh = quarter(case.sample, case.indenter, case.mesh, case.solver.element)
    law = case.law(**case.start_values())
    kappa, fibre = 1000 * law.shear_modulus, np.array([1.0, 0.0, 0.0])
    seconds = {}
    with threadpool_limits(1):
        solid, threaded = Solid(mesh, case.solver.element), Solid(mesh, case.solver.element)
        solid._threads = 1
        forms = FormSolid(mesh, case.solver.element)
        bodies = ("compiled", solid, 5), (f"on {threaded._threads} threads", threaded, 5), ("forms", forms, 1)
        u = 1e-3 * np.random.default_rng(0).standard_normal(solid.n_dofs)
        for name, body, times in bodies:

            def tangent(body=body):
                state = body.state(u, fibre)
                return body.tangent(u, state, law, body.pressure(state, kappa), kappa, fibre)

            def residual(body=body):
                state = body.state(u, fibre)
                return body.residual(u, state, law, body.pressure(state, kappa), fibre)

            seconds[f"{name} tangent"], seconds[f"{name} residual"] = _time(tangent, times), _time(residual, times)
        try:
            seconds["FElupe tangent"] = _felupe(mesh, law.shear_modulus, kappa)
        except ImportError:
            seconds["FElupe tangent"] = None
    ratios = {name: value / seconds["compiled tangent"] for name, value in seconds.items() if value and "tangent" in name}
    return {"elements": int(mesh.nelements), "dofs": int(solid.n_dofs), "seconds": seconds, "ratios": ratios}


def _felupe(mesh, mu, kappa):
    """FElupe's nearly incompressible body (three fields, two of them condensed), neo-Hookean, residual and tangent."""
    import felupe
    from skfem.io.meshio import to_meshio

    hexahedra = to_meshio(mesh.with_boundaries({})).cells_dict["hexahedron"]
    region = felupe.RegionHexahedron(felupe.Mesh(mesh.p.T, hexahedra, "hexahedron"))
    field = felupe.FieldContainer([felupe.Field(region, dim=3)])
    body = felupe.SolidBodyNearlyIncompressible(felupe.NeoHooke(mu=mu), field, bulk=kappa)

    def assemble():
        body.assemble.vector()
        return body.assemble.matrix()

    return _time(assemble, 3)


def _time(function, times):
    function()
    found = []
    for _ in range(times):
        started = time.perf_counter()
        function()
        found.append(time.perf_counter() - started)
    return statistics.median(found)


if __name__ == "__main__":
    os.environ.setdefault("PYTHONHASHSEED", "0")
    main()
