"""`indentfit init`: a commented case with curves, to be changed into one's own."""

from pathlib import Path

import click
import numpy as np

from ..curve import Curve, write_curve
from ..errors import OutputError

CASE = """\
# A case for indentfit. Change it to your experiment, then:
#     indentfit validate case.toml     every error at once
#     indentfit simulate case.toml     curves at the start values
#     indentfit fit case.toml          the parameters
#
# Lengths are in mm, forces in mN, pressures and moduli in kPa; a string may carry another unit: "330 um", "1490 Pa".

title = ""

[sample]
shape = "disc"       # disc with diameter, or block with length (mm, along x) and width (mm, along z)
diameter = 14        # mm
thickness = 3.3      # mm, along the axis of indentation
base = "sliding"     # sliding on its support, or bonded to it; it changes the force by half, so find out

[indenter]
shape = "strip"      # strip with width and length; cylinder (flat) or sphere with diameter (mm)
width = 2            # mm, along z
length = 20          # mm, along x; it may overhang the sample
edge_radius = 0      # mm; 0 is sharp
friction = 0.5       # coefficient, or "stick" for no slip at all

[mesh]
# size = 0.4         # mm, of the elements under the indenter
# elements = 3000    # or: about that many. Neither: the default mesh

[material]
model = "transversely_isotropic"   # `indentfit materials` lists them; or "my_model.py:MyModel", which runs that file
# energy = "mu/2*(I1 - 3)"         # or, instead of a model, an energy (kPa) in I1, I2, I4, I5 and the parameters
bulk_ratio = 1000                  # bulk modulus / shear modulus; or kappa = ... (kPa)

[material.parameters]              # a number is fixed; start, min and max make it free
mu = { start = 1, min = 0.1, max = 10 }   # kPa, shear modulus across the fibres
zeta = { start = 3, min = 0, max = 20 }   # fibre stretch stiffening
phi = { start = 1, min = 0, max = 5 }     # fibre shear stiffening

[[test]]
name = "parallel"
angle = 0                          # degrees between the fibres and x, the strip's long side: 0 or 90
curve = "curves/parallel.csv"      # displacement_mm,force_mN of the full sample; other units by header: force_N
# record = "records/parallel.csv"  # instead of a curve: the rig's own file, read as a table [record] says (see README)
# depth = 0.33                     # mm: instead of a curve, to simulate only
# points = 25                      # with a depth: how many points
# weight = 0.5                     # in the objective; by default 1 / number of tests

[[test]]
name = "perpendicular"
angle = 90
curve = "curves/perpendicular.csv"

[fit]
method = "ga"        # ga (genetic algorithm), least_squares, differential_evolution or cma
seed = 0             # of the random numbers
# direct = true      # search on the forward model itself, without a surrogate: hundreds of runs
# population = 80    # individuals of a generation
# generations = 60   # generations at most
# workers = 2        # processes; by default one for each core
# tolerance = 1e-6   # relative change of the objective below which the search ends
# profiles = false   # no profile likelihoods

# [fit.uncertain]    # inputs known with some error: a standard deviation, or {start, min, max} to fit them too
# friction = 0.1
# thickness = 0.05   # mm
# offset = 0.005     # mm, of the contact point
# bulk_ratio = 200
# force = 0.01       # relative, common to all forces of a test: calibration
# base = 0.3         # probability that the base is the other of sliding and bonded; true for even odds
# mesh = 1           # of the forces, in units of the change that half of the elements make; 0 leaves the mesh's error out

# [fit.published]    # to compare the result with
# mu = 1.49

[solver]             # the defaults suit every case known so far
# assembly = "compiled"   # or "forms", the readable and slow one
# linear = "auto"         # or pardiso, superlu, pyamg
# tolerance = 1e-6        # relative residual at equilibrium
# penalty = 1.0           # factor on the contact stiffness
# max_step = 0.05         # mm, largest step of the indenter
"""

STIFFNESS = {"parallel": 72.9, "perpendicular": 170.5}  # mN/mm, means of Feng et al. 2017


@click.command(short_help="Write a commented case to start from.")
@click.argument("folder", metavar="DIR", type=click.Path())
def command(folder):
    """Write case.toml and example curves into DIR, which must be new or empty."""
    folder = Path(folder)
    _require_free(folder)
    try:
        (folder / "curves").mkdir(parents=True, exist_ok=True)
        (folder / "case.toml").write_text(CASE, encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
    displacement = np.round(0.33 * np.arange(1, 26) / 25, 6)
    for name, stiffness in STIFFNESS.items():
        write_curve(folder / "curves" / f"{name}.csv", Curve(displacement, np.round(stiffness * displacement, 6)))
    click.echo(folder / "case.toml")
    click.echo("the curves are straight lines, an example only: put yours in their place", err=True)


def _require_free(folder):
    """Refuse a folder with something in it: nothing is ever overwritten."""
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder}: a file has that name; choose another folder")
        if folder.is_dir() and any(folder.iterdir()):
            raise OutputError(f"{folder}: the folder exists and is not empty; choose another one")
    except (OSError, ValueError) as error:
        raise OutputError(f"{folder}: cannot be used ({error}); choose another folder") from error
