"""Writes the raw records of this case: simulated curves, recorded by a simulated rig with the noise of a real one.

    python cases/rig_records/make_records.py            # records/ and truth.csv, one sample, as shipped
    python cases/rig_records/make_records.py --all DIR  # 12 samples in two directions with the paper's means and spread

The elastic curves are those of indentfit's own forward model at the parameters of Feng et al. 2017, scaled to each sample's
stiffness at the rig's velocity (the force is linear in mu); indentfit.experiment.rig adds approach, ramp, hold, relaxation, drift,
vibration and the converter's steps.
"""

import argparse
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from indentfit.curve import Curve
from indentfit.experiment.measured import read_case
from indentfit.experiment.rig import Rig, SensorNoise
from indentfit.runs.forward import simulate

HERE = Path(__file__).parent
WHITE_MATTER = HERE.parent / "white_matter_2017" / "case.toml"
OPTIMUM = {"mu": 1.49, "zeta": 4.68, "phi": 0.68}  # kPa, 1, 1: Feng et al. 2017
MEANS = {0: 72.9, 90: 170.5}  # mN/mm, stiffness of 12 samples: the same
RATIO = (2.83, 1.32)  # mean and standard deviation of the samples' ratios 90 / 0: the same
THICKNESS, DIAMETER = 3.3, 14.0  # mm, means
STRAIN = 0.1
RELAXATION = ((0.05, 0.7), (0.1, 8.0))  # shares and time constants, s: invented
GAIN = {"displacement": 6.0, "force": 24.0}  # mm/V, mN/V
SEED = 2017
NAMES = {0: "parallel", 90: "perpendicular"}


def elastic_curves(elements=60):
    """Direction -> Curve of the forward model at the paper's optimum to 12 % strain."""
    depth = 0.12 * THICKNESS
    keys = [f"mesh.elements={elements}", "material.kappa=1490", *(f"test.{name}.depth={depth}" for name in NAMES.values())]
    return {test.angle: test.curve for test in simulate(read_case(WHITE_MATTER, keys), OPTIMUM).tests}


def stiffnesses(n=12, seed=SEED):
    """(n, 2) stiffnesses in the two directions, mN/mm, with the paper's means, and mean and standard deviation of the ratios.

    Random draws, moved as little as possible until the four moments are met.
    """
    rng = np.random.default_rng(seed)
    start = np.log([72.9, 2.6]) + rng.standard_normal((n, 2)) * [0.28, 0.4]

    def misses(logs):
        k0, ratio = np.exp(logs.reshape(n, 2)).T
        moments = [k0.mean() / MEANS[0], (k0 * ratio).mean() / MEANS[90], ratio.mean() / RATIO[0], ratio.std(ddof=1) / RATIO[1]]
        return np.concatenate([1e4 * (np.array(moments) - 1), 0.1 * (logs - start.ravel())])

    k0, ratio = np.exp(least_squares(misses, start.ravel(), xtol=1e-14, ftol=1e-14).x.reshape(n, 2)).T
    return np.column_stack([k0, k0 * ratio])


def write_records(folder, samples, hold, seed=SEED):
    """Write records/*.csv in volts, manifest.csv and truth.csv. samples: list of (name, thickness, stiffness at 0, at 90)."""
    folder = Path(folder)
    (folder / "records").mkdir(parents=True, exist_ok=True)
    rng, curves = np.random.default_rng(seed), elastic_curves()
    manifest, truth = [["sample", "direction", "file", "thickness_mm", "diameter_mm"]], []
    for name, thickness, *values in samples:
        for direction, stiffness in zip(NAMES, values, strict=True):
            place, depth = f"records/{name}_{NAMES[direction]}.csv", STRAIN * thickness
            contact = _write_record(folder / place, curves[direction], stiffness, depth, hold, rng)
            manifest.append([name, direction, place, thickness, DIAMETER])
            truth.append([name, direction, f"{stiffness:.6g}", f"{contact:.6g}", f"{depth:.6g}"])
    _write(folder / "manifest.csv", manifest)
    _write(folder / "truth.csv", [["sample", "direction", "stiffness_mN_per_mm", "contact_mm", "depth_mm"], *truth])


def _write_record(path, curve, stiffness, depth, hold, rng):
    """One record in volts, both channels falling under load; returns the displacement at contact, mm."""
    gap = float(np.round(rng.uniform(0.15, 0.3), 3))
    rig = Rig(velocity=0.2 * depth / STRAIN, gap=gap, hold=hold, noise=SensorNoise(drift=0.05))
    d = np.linspace(0, depth, 60)[1:]
    elastic = np.interp(d, np.append(0, curve.displacement), np.append(0, curve.force))
    scale = stiffness / _stiffness_of_ramp(Curve(d, elastic), rig)
    record, contact = rig.run(Curve(d, scale * elastic), rng, RELAXATION)
    volts = [5 - record.displacement / GAIN["displacement"], 5 - record.force / GAIN["force"]]
    rows = [f"{a:.3f},{b:.3f}\n" for a, b in zip(*volts, strict=True)]
    path.write_text("displacement_V,force_V\n" + "".join(rows), encoding="utf-8")
    return contact


def _stiffness_of_ramp(curve, rig):
    """Slope of the straight line, mN/mm, through what a rig without noise records at this velocity: with relaxation in it."""
    still = SensorNoise(force=0, displacement=0, vibration=(0, 0), resolution=(0, 0))
    record, contact = replace(rig, noise=still).run(curve, np.random.default_rng(0), RELAXATION)
    ramp = (record.displacement > contact) & (np.gradient(record.displacement) > 0)
    return np.polyfit(record.displacement[ramp], record.force[ramp], 1)[0]


def _write(path, rows):
    with open(path, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def _to_the_strain():
    """Curve, and which of its points lie within the strain of the records, for each direction."""
    return [(curve, curve.displacement <= 1.001 * STRAIN * THICKNESS) for curve in elastic_curves().values()]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--all", metavar="DIR", help="write the 12 samples there")
    folder = parser.parse_args().all
    if folder is None:
        elastic = (np.polyfit(curve.displacement[within], curve.force[within], 1)[0] for curve, within in _to_the_strain())
        write_records(HERE, [("S1", THICKNESS, *elastic)], hold=3.0)
        return
    rng = np.random.default_rng(SEED)
    thicknesses = np.round(THICKNESS + 0.2 * rng.standard_normal(12), 2)
    write_records(folder, [(f"S{n + 1}", h, *k) for n, (h, k) in enumerate(zip(thicknesses, stiffnesses(), strict=True))], hold=0.3)


if __name__ == "__main__":
    main()
