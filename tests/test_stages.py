"""Loadings in steps and holds: contact lies in the first stage, also where noise hides it and the sample relaxes in the holds."""

import numpy as np
import pytest

from indentfit.case import Record
from indentfit.experiment.processed import process_record
from indentfit.experiment.record import RawRecord

RATE = 300  # samples, 1/s


def stepped(heights, holds, relaxed=0.5, age=0.3, power=1.5, noise=0.003, seed=0):
    """A sphere's force 100 x^1.5 in mN under steps to `heights`, mm, a part of which relaxes in a time, s; contact at 0.

    The part that relaxes is summed over the exact change of the elastic force in each sample.
    """
    corners = [(0.0, -0.6)]
    for height, hold in zip(heights, holds, strict=True):
        corners.append((corners[-1][0] + (height - corners[-1][1]), height))
        corners.append((corners[-1][0] + hold, height))
    time = np.arange(int(corners[-1][0] * RATE)) / RATE
    place = np.interp(time, *np.array(corners).T)
    elastic = 100 * np.maximum(place, 0) ** power
    excess, kept = np.zeros(time.size), np.exp(-1 / RATE / age)
    for n in range(1, time.size):
        excess[n] = kept * excess[n - 1] + relaxed * (elastic[n] - elastic[n - 1])
    force = (1 - relaxed) * elastic + excess
    return RawRecord(time, place, force + noise * force.max() * np.random.default_rng(seed).standard_normal(time.size) + 3.0)


def processed(record):
    return process_record(record, settings=Record(indenter="sphere"))


def test_contact_is_sought_before_the_first_pause_though_a_later_one_is_longer():
    done = processed(stepped([0.4, 0.7, 1.0], [0.8, 2.0, 1.0], noise=0.002))
    paused = next(float(note.split("pause at ")[1].split()[0]) for note in done.notes if "pause at" in note)
    assert paused == pytest.approx(1.0, abs=0.03)
    assert abs(done.contact.displacement) <= done.contact.uncertainty < 0.05


@pytest.mark.parametrize("seed", range(6))
def test_a_first_step_under_the_noise_does_not_move_the_contact_point(seed):
    """The first step reaches 3 % of the peak, under the noise; later steps show contact, and holds in it relax by half."""
    done = processed(stepped([0.12, 0.5, 1.0], [1.0, 1.0, 0.5], noise=0.02, seed=seed))
    assert abs(done.contact.displacement) <= 1.5 * done.contact.uncertainty < 0.3  # of six 95 % intervals one may miss a little


def test_the_force_that_pauses_lose_is_named():
    """By the exact relaxation: a hold of ten times the relaxation time loses all of the part that is left of it."""
    relaxing = processed(stepped([0.5, 1.0], [3.0, 1.0], relaxed=0.3))
    still = processed(stepped([0.5, 1.0], [3.0, 1.0], relaxed=0.0))
    assert any("in pauses of the loading" in note for note in relaxing.notes)
    assert not any("in pauses of the loading" in note for note in still.notes)
