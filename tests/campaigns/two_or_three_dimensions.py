"""Campaign of two against three dimensions: the meridian plane and the quarter of bricks, both made for an error of 0.3 %.

    python tests/campaigns/two_or_three_dimensions.py [--cases 0:10] [--error 0.003]

Ten round contacts of 5 to 30 % of the thickness: spheres, punches with a rounded edge and a sharp one, cones; sliding and bonded
bases; with and without friction. The two solutions share the energy and the law of contact, but neither elements, nor the points of
contact, nor linear algebra of the same size. Each line states both forces at the full depth, their difference, which should be at
most 0.5 %, the stated error of the bricks' mesh where it is asked for (--band), and the processor time of each. Exit code 1 where a
difference is larger.

Measured on 29 November 2026 (7 to 91 s of processor time for bricks, 0.3 to 1.9 s for the plane): without friction -0.005, +0.07,
-0.10, +0.11, -0.03 and -0.01 % (spheres, punches, cones); with friction 0.5 -0.05 and -0.11 % (spheres), +0.36 % (rounded punch)
and +0.05 % (cone). Before bricks anchored a point that comes to touch within a step where it touches, the spheres and the punch
had +0.34, +0.58 and +0.42 %: points rubbed along the indenter before they touched it. Of 8 and 12 steps the worst case has 0.4699
and 0.4705 mN now (it had 0.4732 with 8 and 0.4719 with 16), the plane of 48 steps 0.4708.
On the plane mesh of ten elements along the contact, cases 4 to 7: -0.10, +0.42, +0.11 and -0.02 %.
On 30 November 2026 (commit 956a9ba, bonded bases with their own elements, narrower ones towards a cone's axis), cases 0, 4, 6,
8 and 9: -0.009, -0.098, +0.110, +0.006 and +0.085 % (8 to 60 s of processor time for bricks).
"""

import argparse
import sys
import time

import numpy as np

from indentfit.case import Indenter, Mesh, Sample, Solver
from indentfit.errors import IndentfitError
from indentfit.fem.mesh_error import with_mesh_errors
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.material import load

LIMIT, KAPPA = 5e-3, 100.0
GEL = load("neo_hookean")(mu=1.0)


def sphere(radius):
    return {"shape": "sphere", "diameter": 2 * radius}


def punch(radius, edge):
    return {"shape": "cylinder", "diameter": 2 * radius, "edge_radius": edge}


def cone(angle, tip):
    return {"shape": "cone", "half_angle": angle, "tip_radius": tip}


CASES = [  # indenter, friction, base, depth over thickness, diameter of the sample over thickness
    (sphere(1.0), 0.0, "bonded", 0.3, 6.0),
    (sphere(1.0), 0.5, "sliding", 0.2, 6.0),
    (sphere(3.0), 0.0, "sliding", 0.1, 8.0),
    (sphere(0.5), 0.5, "bonded", 0.2, 4.0),
    (punch(0.6, 0.15), 0.0, "bonded", 0.1, 6.0),
    (punch(0.6, 0.15), 0.5, "sliding", 0.1, 6.0),
    (punch(0.6, 0.0), 0.0, "sliding", 0.05, 6.0),
    (cone(70.0, 0.1), 0.0, "bonded", 0.2, 6.0),
    (cone(60.0, 0.2), 0.0, "sliding", 0.3, 5.0),
    (cone(70.0, 0.1), 0.5, "bonded", 0.2, 6.0),
]


def solved(symmetry, case, error, band=False):
    """Force at the full depth, elements, processor time, and the stated error where it is asked for."""
    indenter, friction, base, depth, diameter = case
    sample = Sample(shape="disc", diameter=diameter, thickness=1.0, base=base)
    setup = Setup(sample, Indenter(**indenter, friction=friction), Mesh(error=error), Solver(), depth, symmetry)
    presses, started = [Press(GEL, KAPPA, 0, np.array([0.5, 1.0]) * depth)], time.process_time()
    simulation = Model(setup).simulate(presses)
    if band:
        simulation = with_mesh_errors(simulation, setup, presses)
    (test,) = simulation.tests
    stated = f", stated {test.mesh_error.share(test.force):.2%}" if band else ""
    return test.force[-1], f"{test.facts.elements} elements, {time.process_time() - started:.1f} s{stated}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", default="0:10", help="a:b, or a:b:step")
    parser.add_argument("--error", type=float, default=0.003)
    parser.add_argument("--band", action="store_true")
    asked, good = parser.parse_args(), True
    for case in CASES[slice(*map(int, asked.cases.split(":")))]:
        indenter, friction, base, depth, _ = case
        name = f"{indenter}, friction {friction:g}, {base}, {depth:.0%}"
        try:
            plane, in_plane = solved("axisymmetric", case, asked.error)
            print(f"{name}: plane {plane:.5g} mN ({in_plane})", flush=True)
            bricks, in_space = solved("quarter", case, asked.error, asked.band)
        except IndentfitError as failure:
            print(f"{name}: {failure}", flush=True)
            good = False
            continue
        print(f"{name}: bricks {bricks:.5g} mN ({in_space}): {bricks / plane - 1:+.3%}", flush=True)
        good = good and abs(bricks / plane - 1) <= LIMIT
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
