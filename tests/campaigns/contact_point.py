"""The evidence for the default contact point: every method on simulated records with known truth, in several kinds of trouble.

    python tests/campaigns/contact_point.py --trials 500

Prints, for each kind of record and each method, the median and the 95 % quantile of the error, its mean, the median stated
uncertainty (half of a 95 % interval) and how often the interval holds the truth. tests/test_contact_point.py reruns it in short.
Elastic curves: the forward model's for white matter, along and across, and the slightly curved one of a flat cylinder on gelatin.
"""

import argparse
from dataclasses import replace

import numpy as np

from indentfit.curve import Curve
from indentfit.errors import RecordError
from indentfit.experiment.contact_point import METHODS, find_contact_point
from indentfit.experiment.loading import find_ramp
from indentfit.experiment.rig import Rig, SensorNoise

SAMPLES = {  # slope at contact mN/mm, curvature mN/mm^2, depth mm: close to the forward model's curves
    "along": (82.0, 17.0, 0.33),
    "across": (172.0, 127.0, 0.33),
    "gelatin": (55.0, 5.0, 0.44),
}
RIGS = {
    "phantom noise": Rig(),
    "drift 0.5 mN/s": Rig(rest=1.0, noise=SensorNoise(drift=0.5)),
    "slow approach": Rig(approach_velocity=0.2),
    "stick (adhesion)": Rig(adhesion=0.3),
    "no approach": Rig(gap=0.0),
    "quiet": Rig(noise=SensorNoise(vibration=(0.05, 0.0))),
    "white noise": Rig(noise=SensorNoise(force=0.5, vibration=(0.0, 0.0))),
    "long rest and hold": Rig(rest=5.0, hold=20.0),
    "half the rate": replace(Rig(), rate=500.0),
}


def sample_curve(name):
    """Elastic Curve of a sample of SAMPLES, or under a sphere by Hertz, 20 mN at 0.33 mm."""
    if name == "sphere":
        d = 0.33 * (np.arange(1, 201) / 200) ** 2
        return Curve(d, 20 * (d / 0.33) ** 1.5)
    slope, curvature, depth = SAMPLES[name]
    d = np.linspace(0, depth, 41)[1:]
    return Curve(d, (slope + curvature * d) * d)


def trials(curve, rig, method, count, seed=0, indenter="flat"):
    """Errors and stated uncertainties, mm, (count, 2) of a method on records of their own; nan where it finds no contact."""
    errors = np.full((count, 2), np.nan)
    for n in range(count):
        record, truth = rig.run(curve, np.random.default_rng([seed, n]))
        try:
            contact = find_contact_point(find_ramp(record), method, indenter)
        except RecordError:
            continue
        errors[n] = contact.displacement - truth, contact.uncertainty
    return errors


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=100)
    count = parser.parse_args().trials
    columns = " ".join(f"{word:>7}" for word in ("median", "95 %", "mean", "stated"))
    print(f"{'sample':8} {'record':20} {'method':15} {columns} {'held':>6}  um, {count} trials")
    for name in SAMPLES:
        for kind, rig in RIGS.items():
            for method in METHODS:
                error, stated = 1e3 * trials(sample_curve(name), rig, method, count).T
                size = np.abs(error)
                held = np.mean(size <= stated)
                values = (np.nanmedian(size), np.nanquantile(size, 0.95), np.nanmean(error), np.nanmedian(stated))
                numbers = " ".join(f"{value:7.2f}" for value in values)
                print(f"{name:8} {kind:20} {method:15} {numbers} {held:6.1%}", flush=True)


if __name__ == "__main__":
    main()
