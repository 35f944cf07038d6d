"""Campaign of the exact elastic layer: every point of ../shared/oracles/elastic_layer.json by finite elements.

    python tests/campaigns/elastic_layer.py [--cases 0:92] [--symmetry quarter] [--worst 0.003] [--shallow 0.1] [--wider 2]

56 flat punches and 36 paraboloids on layers, bonded and sliding, nu 0.3 to 0.5, default settings, small strain: punches at a depth
of 0.001 radii, paraboloids as spheres of 100 times the radius at a hundredth of the depth (their force depends on the product of
both only). --shallow multiplies these depths, and divides the spheres' radii. nu = 0.5 is solved as exactly
incompressible, as a case's poisson_ratio = 0.5 is. The sample is 24 contact radii wide and at least 20 thicknesses; --wider
multiplies that. Each line states the error of the force and the processor time; the last one counts the points within --worst, and
within 0.1 % more, the file's own error. Exit code 1 where a point lies outside of that.

Measured in the meridian plane, 92 of 92 solved: from -0.28 to +0.11 % at a tenth of the depths, median size 0.06 %. At the depths
themselves two of 92 lie above 0.3 %, the widest punch on a bonded layer, nu 0.49 and 0.5, at +0.37 and +0.41 %. That is no error of
the mesh (finer ones: +0.39 %): the layer under it gets thinner by 0.2 %, and stiffer, and a tenth of the depth leaves +0.067 and
+0.069 % on the same mesh (commit 956a9ba: +0.368 and +0.413 % at the depths themselves).
With ten elements along the contact the 36 spheres err by -0.14 to +0.08 %, and the 56 punches by -0.23 to +0.41 % as before (54
within 0.3 %, median size 0.067 %). All 92 at commit 956a9ba: -0.225 to +0.413 %, 90 within 0.3 %, median size 0.051 %.
On quarters of bricks (--symmetry quarter --worst 0.01) the 56 punches err by +0.06 to +0.996 %, those narrower than a 24th of the
sample on meshes that grow with that ratio (the same 375 elements for all were up to 2.9 % off).
"""

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

from indentfit.case import Indenter, Mesh, Sample, Solver
from indentfit.case.materials import LARGEST_BULK_RATIO
from indentfit.errors import IndentfitError
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.material import load

FILE = Path(__file__).resolve().parents[3] / "shared" / "oracles" / "elastic_layer.json"
GEL, OWN = load("neo_hookean")(mu=1.0), 1e-3


def points(wider=1.0, shallow=1.0):
    """(name, sample, indenter, depth, bulk ratio, exact force) of each point, in the file's order."""
    known = json.loads(FILE.read_text())
    for base, nu, a, stiffness in known["flat"]:
        punch, depth = Indenter(shape="cylinder", diameter=2 * a, friction=0), shallow * 1e-3 * a
        yield f"punch {base} nu {nu:g} a/h {a:g}", disc(base, a, wider), punch, depth, ratio(nu), stiffness * a * depth
    for base, nu, radius, depth, force, contact in known["sphere"]:
        name = f"sphere {base} nu {nu:g} R/h {radius:g} depth/h {depth:g}"
        sphere = Indenter(shape="sphere", diameter=200 * radius / shallow, friction=0)
        yield name, disc(base, contact, wider), sphere, shallow * depth / 100, ratio(nu), shallow * force / 100


def disc(base, contact, wider):
    return Sample(shape="disc", diameter=wider * 2 * max(12 * contact, 10.0), thickness=1.0, base=base)


def ratio(nu):
    return LARGEST_BULK_RATIO if nu == 0.5 else 2 * (1 + nu) / (3 * (1 - 2 * nu))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", default=":", help="a:b, or a:b:step")
    parser.add_argument("--symmetry", default="axisymmetric", choices=["axisymmetric", "quarter"])
    parser.add_argument("--worst", type=float, default=0.003)
    parser.add_argument("--shallow", type=float, default=1.0)
    parser.add_argument("--wider", type=float, default=1.0)
    asked, errors, failed = parser.parse_args(), [], 0
    part = slice(*(int(n) if n else None for n in asked.cases.split(":")))
    for name, sample, indenter, depth, bulk_ratio, exact in list(points(asked.wider, asked.shallow))[part]:
        started = time.process_time()
        setup = Setup(sample, indenter, Mesh(), Solver(), depth, asked.symmetry)
        try:
            test = Model(setup).run(Press(GEL, bulk_ratio, 0, np.array([0.25, 0.5, 1.0]) * depth))
        except IndentfitError as failure:
            print(f"{name}: {failure}", flush=True)
            failed += 1
            continue
        error, seconds = test.force[-1] / exact - 1, time.process_time() - started
        errors.append(error)
        print(f"{name}: {error:+.3%}, {test.facts.elements} elements, {seconds:.1f} s", flush=True)
    sizes = np.abs(errors)
    held = int(np.sum(sizes <= asked.worst + OWN))
    strictly = int(np.sum(sizes <= asked.worst))
    print(f"{len(errors)} of {len(errors) + failed} solved; {held} within {asked.worst + OWN:.2%}, {strictly} ", end="")
    print(f"within {asked.worst:.2%}; from {min(errors):+.3%} to {max(errors):+.3%}, median size {np.median(sizes):.3%}")
    sys.exit(0 if held == len(errors) and not failed else 1)


if __name__ == "__main__":
    main()
