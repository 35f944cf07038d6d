"""The paper's numbers beside ours: every row of the tables in cases/white_matter_2017/README.md.

    python tests/campaigns/reproduction.py [-o DIR] [--workers 2] [--only PART ...] [--set KEY=VALUE ...]

Prints the tables as Markdown and writes sweeps, fields and their reports into DIR. Parts: forward, stresses, friction (what could
explain the difference of the friction effect), slip (the same, were sticking elastic) and fits (the two inversions, and refits at
other inputs; minutes each). Killed, it goes on where it stopped. The mesh study is `indentfit mesh-check` with the command in that
README.
"""

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

CASES = Path(__file__).parents[2] / "cases"
OPTIMUM = "material.parameters={mu=1.49,zeta=4.68,phi=0.68}"
PARAMETERS = [f"material.{name}=+-15%" for name in ("mu", "zeta", "phi")]
FRICTION = ["indenter.friction=0.2,0.25,0.3,0.4"]
UNKNOWN = [
    "material.bulk_ratio=20,100,5000",
    "indenter.friction=0,stick",
    "sample.base=bonded",
    "solver.element=q1p0",
    "indenter.edge_radius=0.1,0.05",  # the slow ones last
]
# The friction effect across the fibres, 0.5 -> 0.25 and 0.2, with each unknown input at other values.
EXPLANATIONS = [
    [],
    ["material.bulk_ratio=20"],
    ["material.bulk_ratio=100"],
    ["material.bulk_ratio=5000"],
    ["sample.base=bonded"],
    ["sample={shape='block',length=14,width=14,thickness=3.3,base='sliding'}"],
    ["solver.element=q1p0", "mesh.elements=300"],
    ["solver.penalty=0.1"],
    ["solver.penalty=10"],
    ["material.parameters={mu=0.60,zeta=4.0,phi=0.5}"],
    *([f"test.{name}.depth={depth}" for name in ("parallel", "perpendicular")] for depth in (0.165, 0.2875, 0.314, 0.3484)),
    ["indenter.edge_radius=0.1"],
    ["indenter.edge_radius=0.05"],
    ["solver.element=q1p0", "mesh.elements=1500"],  # the slow ones last
    ["solver.element=q1p0", "mesh.elements=3000"],
]
ELASTIC_SLIP = (0.005, 0.05)  # mm: 0.5 % of elements of 1 mm, the default of the paper's software, and ten times that
REFITS = ["indenter.friction=0.2", "material.bulk_ratio=100", "sample.base=bonded"]
PAPER = {"parallel": 72.9, "perpendicular": 170.5}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", default="reproduction")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--set", action="append", default=[], dest="extra")
    arguments = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    home = Path(arguments.output)
    home.mkdir(exist_ok=True)
    rows = [row for part in arguments.only for row in PARTS[part](home, arguments.workers, arguments.extra)]
    print("| what | paper | here |\n|---|---|---|")
    for row in rows:
        print(f"| {' | '.join(row)} |")


def command(home, name, words):
    """Run one command of indentfit into home/name, unless that is there, and return its result.json."""
    import json

    from click.testing import CliRunner

    from indentfit.cli import main as indentfit

    folder = home / name
    if not folder.exists():
        done = CliRunner().invoke(indentfit, [*words, "-o", str(folder)])
        if not folder.exists():
            sys.exit(f"{name}: {done.output}")
    file = next(folder / one for one in ("result.json", "simulation.json") if (folder / one).exists())
    return json.loads(file.read_text(encoding="utf-8"))


def swept(home, name, texts, workers, extra, options=(), optimum=(OPTIMUM,)):
    words = ["sweep", str(CASES / "white_matter_2017" / "case.toml"), "--workers", str(workers), *options]
    for text in (*optimum, *extra):
        words += ["--set", text]
    for text in texts:
        words += ["--vary", text]
    return command(home, name, words)


def forward(home, workers, extra):
    """Rows from sweeps: stiffness and objective at the optimum, parameters, friction, and what the paper does not say."""
    parameters = swept(home, "parameters", PARAMETERS, workers, extra)
    friction = swept(home, "friction", FRICTION, workers, extra)
    unknown = swept(home, "unknown", UNKNOWN, workers, extra)
    base = parameters["base"]["tests"]
    rows = [
        (f"stiffness at the paper's optimum, {name} (mN/mm)", f"{stiffness} measured", f"{base[name]['stiffness_mN_per_mm']:.1f}")
        for name, stiffness in PAPER.items()
    ]
    objective = sum(0.5 * one["rmse_mN"] for one in base.values())
    rows.append(("objective at the paper's optimum (mN)", "0.832", f"{objective:.2f}"))
    for one in parameters["sensitivities"]:
        rows.append(
            (
                f"spread of the force by {one['key']} +-15 %, {one['test']}",
                "mu > zeta > phi; 90 > 0 deg",
                f"{one['force_span']:.2%}",
            )
        )
    for point in friction["points"]:
        for name, said in (("parallel", "no effect"), ("perpendicular", "about -8 % at 0.2")):
            rows.append((f"force at 10 % by friction {point['values']['indenter.friction']}, {name}", said, change(point, name)))
    for point in unknown["points"]:
        what = ", ".join(f"{key} = {value}" for key, value in point["values"].items())
        rows.append(
            (
                f"{what}: force at 10 %, parallel; perpendicular",
                "not said",
                f"{change(point, 'parallel')}; {change(point, 'perpendicular')}",
            )
        )
    return rows


def change(point, name):
    return f"failed: {point['cause']}" if point["tests"] is None else f"{point['tests'][name]['force_change']:+.2%}"


def stresses(home, workers, extra):
    """Rows of the peak stresses, from the pictures' table."""
    import json

    words = ["simulate", str(CASES / "white_matter_2017" / "case.toml"), "--vtu"]
    for text in (OPTIMUM, *extra):
        words += ["--set", text]
    command(home, "stresses", words)
    listed = json.loads((home / "stresses" / "fields" / "pictures.json").read_text(encoding="utf-8"))
    said = {"parallel": "zz; yz", "perpendicular": "zz; xz"}
    rows = [(f"largest normal and shear stress, {one['test']}", said[one["test"]], one["words"]) for one in listed["peaks"]]
    first, second = ({row["component"]: row["usual"] for row in one["rows"]} for one in listed["peaks"])
    larger = [name for name in first if second[name] > first[name]]
    rows.append(("components that are larger at 90 deg", "all six", ", ".join(larger)))
    return rows


def friction(home, workers, extra):
    """Rows of the friction effect with each unknown input at other values: friction 0.5 -> 0.25 and 0.2, both configurations."""
    rows = []
    for n, texts in enumerate(EXPLANATIONS):
        result = swept(home, f"friction-{n:02d}", ["indenter.friction=0.25,0.2"], workers, [*extra, *texts])
        what, own = ", ".join(texts) or "as it is", result["base"]
        if own["tests"] is None:
            rows.append((f"friction from 0.5, {what}", "about -8 %", f"failed: {own['cause']}"))
            continue
        for point in result["points"]:
            slope = (point["tests"] or {}).get("perpendicular", {}).get("stiffness_change", float("nan"))
            words = f"{change(point, 'parallel')}; {change(point, 'perpendicular')}; stiffness {slope:+.2%}"
            rows.append((f"friction 0.5 to {point['values']['indenter.friction']}, {what}", "0; about -8 % at 0.2", words))
    return rows


def slip(home, workers, extra):
    """Rows of the friction effect where a point that sticks gives way elastically before it slips, as under the penalty friction
    of the paper's software: by ELASTIC_SLIP at the mean pressure of the last displacement."""
    from indentfit.experiment.measured import read_case
    from indentfit.fem import contact, contact_state, simulate
    from indentfit.runs import forward

    rows, own = [], (contact.ContactFace.touch, contact_state.ContactState.advanced, simulate.TANGENTIAL)

    def touch(self, u, depth, history, springs, derivative=True):
        found = own[0](self, u, depth, history, springs, derivative)
        object.__setattr__(found, "spring", springs.tangential)
        return found

    def advanced(self, rate=None, stride=contact_state.NO_STRIDE):
        """No multiplier takes over the friction: its spring has to be stretched by all of it."""
        found = own[1](self, rate, stride)
        return replace(found, friction=0 * found.friction, anchor=self.place - self.friction / self.spring)

    def forces(friction, elastic):
        case = read_case(CASES / "white_matter_2017" / "case.toml", [OPTIMUM, *extra, f"indenter.friction={friction}"])
        if elastic:
            pressure = 70 / (case.indenter.width * case.sample.diameter)  # kPa, at a force of 70 mN
            modulus = case.law(**case.start_values()).shear_modulus * simulate.SHARP
            simulate.TANGENTIAL = friction * pressure / elastic * case.sample.thickness / modulus
        return {test.name: test.force[-1] for test in forward.simulate(case).tests}

    for elastic in (None, *ELASTIC_SLIP):
        try:
            if elastic:
                contact.ContactFace.touch, contact_state.ContactState.advanced = touch, advanced
            rough, smooth = forces(0.5, elastic), forces(0.2, elastic)
        finally:
            contact.ContactFace.touch, contact_state.ContactState.advanced, simulate.TANGENTIAL = own
        words = "; ".join(f"{smooth[name] / rough[name] - 1:+.2%} from {rough[name]:.2f} mN" for name in PAPER)
        rows.append((f"friction 0.5 to 0.2, elastic slip {f'{1e3 * elastic:g} um' if elastic else 'none'}", "0; about -8 %", words))
    return rows


def fits(home, workers, extra):
    """Rows of the two inversions, and of refits with other inputs."""
    rows = []
    published = {"white_matter_2017": (1.49, 4.68, 0.68), "white_matter_small_strain": (0.60, 4.0, 0.5)}
    for name, values in published.items():
        words = ["fit", str(CASES / name / "case.toml"), "--workers", str(workers)]
        for text in extra:
            words += ["--set", text]
        result = command(home, f"fit-{name}", words)
        for (parameter, one), value in zip(result["parameters"].items(), values, strict=True):
            interval = one["interval"] and " to ".join(f"{x:.3g}" for x in one["interval"])
            rows.append((f"{name}: {parameter}", f"{value:g}", f"{one['value']:.3g} ({interval}; {one['verdict']})"))
        rows.append((f"{name}: objective (mN)", "0.832" if "2017" in name else "not said", f"{result['objective']:.3g}"))
    result = swept(home, "refits", REFITS, workers, extra, ["--refit"], ())
    for one in result["refits"]:
        values = ", ".join(f"{name} {p['value']:.3g}" for name, p in one["parameters"].items())
        rows.append((f"refitted: {one['label']}", "not said", one["cause"] or f"{values}; objective {one['objective']:.3g} mN"))
    return rows


PARTS = {"forward": forward, "stresses": stresses, "friction": friction, "slip": slip, "fits": fits}


if __name__ == "__main__":
    sys.exit(main())
