"""Robustness of fibres and layers: the forward model at 200 points of angles, dips, families, layers, stretches and friction.

    python tests/campaigns/layers_and_fibres.py [--points 0:200] [--elements 60] [--seconds 120] [--output layers_and_fibres.jsonl]

A bar of 2 mm on a block of 14 x 14 x 3.3 mm; a Latin hypercube of: fibres at 0 to 180 degrees (a third along or across), dipping
by 0 to 90 degrees (a third of them), two families (a sixth), no layer, a layer bonded to or sliding on a gel, a stretch of 0
to 10 % along x (half), friction 0 to 1, either base, 2 to 30 % strain. A layer slides where it has a place of its own. Meshes have
`elements` in each quarter; a run may take `seconds` of CPU. Each point ends as a line of JSON; the campaign goes on where it was
stopped.

Seen (30 November 2026): with 60 elements and 120 s 199 of 200 points solved, in 1,900 s beside other work, the slowest in 109 s;
176, whose faces lie 3.4 % of the depth apart, fails with this cause.

Exit code 1 when less than 98 % are solved, or one failed in a way that nobody foresaw.
"""

import argparse
import json
import sys
import time
import traceback
from pathlib import Path

from scipy.stats import qmc

THICKNESS = 3.3
AXES = (
    "angle",
    "straight",
    "dip",
    "dips",
    "families",
    "layers",
    "share",
    "stiff",
    "stretch",
    "stretched",
    "friction",
    "base",
    "strain",
)
LAW = {"model": "holzapfel", "parameters": {"c": 1.0, "k1": 2.0, "k2": 1.0, "dispersion": 0.1}}
TWO = {"model": "holzapfel_two_families", "parameters": LAW["parameters"]}


def all_points(number=200, seed=0):
    """The points, as dicts of what is drawn."""
    points = []
    for row in qmc.LatinHypercube(len(AXES), seed=seed).random(number):
        draw = dict(zip(AXES, row, strict=True))
        taut = draw["stretched"] < 0.5
        angle = 90.0 * round(draw["angle"]) if draw["straight"] < 1 / 3 else 180.0 * draw["angle"]
        two = draw["families"] < 1 / 3 and not taut
        dip = 0.0 if two or draw["dips"] < 2 / 3 else 90.0 * draw["dip"]
        angle, dip = (0.0, 0.0) if taut else (angle, dip)  # a sample is stretched along its one family of fibres
        point = {
            "angle": angle,
            "dip": dip,
            "families": 20 + 50 * draw["dip"] if two else None,
            "layers": ("none", "bonded", "sliding")[int(3 * draw["layers"])],
            "share": 0.15 + 0.6 * draw["share"],
            "stiff": 10 ** (2 * draw["stiff"] - 1),
            "stretch": 1 + 0.1 * draw["stretch"] if taut else None,
            "friction": draw["friction"],
            "base": "bonded" if draw["base"] < 0.5 else "sliding",
            "strain": 0.02 + 0.28 * draw["strain"],
        }
        if point["layers"] == "sliding" and (angle % 90 or dip):
            point["base"] = "bonded"  # where no quarter is solved, the lower layer must have a place
        points.append(point)
    return points


def case_of(point, elements):
    """The Case of a point."""
    from indentfit import Case, Test
    from indentfit.case.tables import Indenter, Layer, Mesh, Sample

    law = TWO if point["families"] else LAW
    upper = round(point["share"] * THICKNESS, 6)
    sample = {"shape": "block", "length": 14.0, "width": 14.0, "thickness": THICKNESS, "base": point["base"]}
    sample |= {"prestretch": point["stretch"]} if point["stretch"] else {}
    sample |= {"families": (point["families"], -point["families"])} if point["families"] else {}
    given = {"material": {**law, "bulk_ratio": 1000.0}}
    if point["layers"] != "none":
        gel = {"model": "neo_hookean", "parameters": {"mu": point["stiff"]}, "bulk_ratio": 1000.0}
        top = Layer(name="top", thickness=upper, interface=point["layers"], bulk_ratio=1000.0, **law)
        sample |= {"layer": [top, Layer(name="gel", thickness=THICKNESS - upper, **gel)]}
        given = {}
    return Case(
        sample=Sample(**sample),
        indenter=Indenter(shape="strip", width=2.0, length=20.0, friction=point["friction"]),
        mesh=Mesh(elements=elements),
        tests=[Test("run", angle=point["angle"], dip=point["dip"], depth=point["strain"] * THICKNESS, points=6)],
        **given,
    )


def run(point, elements, seconds):
    """The record of one point."""
    from indentfit.errors import IndentfitError
    from indentfit.fem.deadline import Deadline
    from indentfit.fem.simulate import Model
    from indentfit.runs.mechanics import mechanics_of
    from indentfit.runs.points import press_of

    started, record = time.process_time(), {"point": point, "cause": None, "unforeseen": None, "force_mN": None}
    try:
        case = case_of(point, elements)
        mechanics = mechanics_of(case)
        model = Model(mechanics.setup)
        material = mechanics.law(**case.start_values())
        record["symmetry"] = mechanics.setup.symmetry
        test = model.run(press_of(case, case.tests[0], material), deadline=Deadline(seconds))
        record |= {"force_mN": test.force.tolist(), "tries": test.facts.tries}
    except IndentfitError as error:
        record["cause"] = " ".join(str(error).split())
    except Exception:
        record["unforeseen"] = traceback.format_exc()
    return record | {"seconds": round(time.process_time() - started, 2)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", default="0:200", metavar="A:B")
    parser.add_argument("--elements", type=int, default=60)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--output", type=Path, default=Path("layers_and_fibres.jsonl"))
    arguments = parser.parse_args()
    first, _, last = arguments.points.partition(":")
    every = list(enumerate(all_points()))[int(first or 0) : int(last or 200)]
    done = [json.loads(text) for text in arguments.output.read_text().splitlines()] if arguments.output.exists() else []
    known = {one["number"]: one for one in done if one["elements"] == arguments.elements}
    records = []
    for number, point in every:
        record = known.get(number)
        if record is None:
            record = run(point, arguments.elements, arguments.seconds) | {"number": number, "elements": arguments.elements}
            with arguments.output.open("a") as output:
                output.write(json.dumps(record) + "\n")
        records.append(record)
        end = record["unforeseen"] or record["cause"] or f"F {record['force_mN'][-1]:.3f} tries {record['tries']}"
        words = " ".join(f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in point.items())
        print(f"{number:3d} {record.get('symmetry', '')} {words}: {end} ({record['seconds']:.1f} s)", flush=True)
    solved = sum(record["force_mN"] is not None for record in records)
    print(f"{solved} of {len(records)} solved ({solved / len(records):.1%})")
    sys.exit(solved < 0.98 * len(records) or any(record["unforeseen"] for record in records))


if __name__ == "__main__":
    main()
