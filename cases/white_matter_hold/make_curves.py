"""Write the curves of this case: the viscoelastic model at known parameters, and a little noise.

python cases/white_matter_hold/make_curves.py

Each test is pressed twice, at the paper's rate with a hold after the ramp, and ten times slower without one. The ramps at the
paper's rate are written on their own too. The mesh is finer than that of a fit. Run it again only when the forward model has
changed on purpose; the case's README states the truth and the noise.
"""

from pathlib import Path

import numpy as np

from indentfit.case import Case, Indenter, MaterialChoice, Mesh, Sample, Test
from indentfit.case.relaxation import Relaxation
from indentfit.curve import Curve, write_curve
from indentfit.runs.forward import simulate

CURVES = Path(__file__).parent / "curves"
TRUTH = {"mu": 1.2, "zeta": 3.0, "phi": 0.8}  # long-term moduli; mu in kPa
RELAXATION = Relaxation(g=(0.8, 0.5), tau=(0.8, 12.0))  # tau in s
RAMPS = {"": {"ramp": 0.5, "hold": 60.0}, "_slow": {"ramp": 5.0}}  # s; 10 % of the thickness at 0.2 /s and at 0.02 /s
ANGLES = {"parallel": 0, "perpendicular": 90}
NOISE = 0.005  # standard deviation, of a curve's largest force
SEED = 2017
POINTS = 25  # of a ramp


def main():
    case = Case(
        sample=Sample(shape="disc", diameter=14, thickness=3.3, base="sliding"),
        indenter=Indenter(shape="strip", width=2, length=20, friction=0.5),
        mesh=Mesh(error=0.003),
        material=MaterialChoice(model="transversely_isotropic", parameters=TRUTH, bulk_ratio=1000, relaxation=RELAXATION),
        tests=[
            Test(name + ending, angle=angle, depth=0.33, points=POINTS, **keys)
            for name, angle in ANGLES.items()
            for ending, keys in RAMPS.items()
        ],
    )
    rng = np.random.default_rng(SEED)
    for name, curve in simulate(case, mesh_error=False).in_time.items():
        noisy = curve.force + NOISE * curve.force.max() * rng.standard_normal(curve.force.size)
        displacement, force, time = (np.round(values, 6) for values in (curve.displacement, noisy, curve.time))
        write_curve(CURVES / f"{name}.csv", Curve(displacement, force, time=time))
        if name in ANGLES:
            write_curve(CURVES / f"{name}_ramp.csv", Curve(displacement[:POINTS], force[:POINTS], time=time[:POINTS]))


if __name__ == "__main__":
    main()
