"""Whether the contact point's 95 % interval holds the truth, and the peak is right within 1 %, in every kind of record.

    python tests/campaigns/records.py --trials 200 --kinds wavy,clipped

Each kind draws records with their own law (flat punch, sphere, cone), stiffness, depth, noise, sampling and offsets. A record is
`held` where the interval holds the truth, `flagged` where a note of `process` speaks of contact, zero, baseline or peak, `refused`
where it cannot be used. A kind passes where the held share of the records without a flag lies in the binomial 99 % band about
95 %, the stated interval of the peak holds it as often at least, and no peak without a flag is off by more than 1 %.
tests/test_instruments.py reruns it in short.

Half of the laws are outside of what is fitted (`law`). Notes that put nothing in doubt are no flags (`TOLD`).

On commit c9cb075 (nine kinds on one before it), seed 13013, never used before, 200 records of each kind: records without a flag,
held of them, binomial 99 % band; in brackets, kinds that are nearly always flagged: of all not refused. Every kind is within its
band, and no peak without a flag is off by over 1 %:

    approach           173  167  156-171  preload            172  168  155-170
    end_not_known      171  163  154-169  stages             162  150  146-160
    short_approach      81   79   71- 81  relaxing_stages    111  110   99-110
    in_contact         125  124  112-124  soft_turn          123  117  110-122
    hold               167  157  151-165  creep              176  165  159-174
    rest_first         170  164  153-168  cycles             160  149  144-158
    two_speeds         171  161  154-169  slight_drift        90   84   79- 90
    retract            174  171  157-172  drift               11   11    8- 11  (187: 183)
    retract_chosen     173  166  156-171  slope                9    9    6-  9  (176: 169)
    reversed_rows      176  173  159-174  curved_drift        51   48   44- 51
    uneven             166  161  150-164  wavy              (166: 155, band 150-164)
    coarse_approach    162  152  146-160  small_waves       (195: 188, band 177-192)
    doubled_times      181  174  164-179  slow_noise          26   25   21- 26  (195: 186, band 177-192)
    blocks             166  159  150-164  ringing            148  146  133-146
    noisy_travel       167  157  151-165  adhesion          (170: 169, band 153-168)
    coarse_travel      191  181  173-188  clipped            all 200 refused
    steps              144  134  129-143  clipped_hold       189 refused, 8 of 11
    clipped_travel       8    8    5-  8

slow_noise held 531 of 594 (seeds 31 and 32), flagged or not, and a sample that stiffens steeply under a slow noise 46 of 65,
before contact was as far in doubt there as it moves with the fitted depth; since then 557 of 591 (band 548-575).

Of ordinary records (approach), seeds 8008, 13013 and 77, 72 of 600 are flagged: 27 as noise leaves the peak uncertain (3 standard
errors above 1 %), 44 as a drift that the approach cannot rule out may change it by over 1 % (95 %). Without the second, 7 of 600
records of slight_drift have a peak off by 1.1 to 2.7 % and no flag; by the drifts that are common alone (`HiddenDrift.beyond`),
54 are flagged and one peak is off by 1.4 %; with 1.64 standard errors in place of 1.96, 61 and the same one.

Earlier: creep, since a held force ends the loading, seeds 10010, 41 and 42, 157 of 160, 159 of 167 and 154 of 159; seed 10010 on
commits 6b7d875 and 851e7b6, 200 records each, had every kind but soft_turn and slow_noise within its band, and three peaks off by
1.08 to 1.27 % without a flag. Seeds 3003, 5005 and 8008, with all laws inside of what is fitted, had 25 of 31 kinds or more
within their bands, and one or two peaks of some 2,800 off by 1.06 to 1.63 %.
"""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.stats import binom

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.processed import process_record
from indentfit.experiment.reading import read_records
from indentfit.experiment.record import RawRecord

BAND = 0.99  # of binomial draws
PEAK = 0.01  # share by which a peak may be off
FLAGS = ("contact", "zero", "baseline", "approach", "adhesion", "peak", "saturated", "drift")
TOLD = (
    "read backwards",
    "the loading has a pause",
    "in pauses of the loading",
    "the record has no approach: the zero of the force is",
)  # no doubts
POWERS = {"flat": (1.0, 2.0), "sphere": (1.5, 2.5), "cone": (2.0, 1.5)}


@dataclass(frozen=True)
class Truth:
    """What is known of a drawn record: displacement at contact, mm, largest force, mN, and the end of the indenter."""

    contact: float
    peak: float
    end: str


@dataclass(frozen=True, eq=False)
class Drawn:
    """A drawn record with its truth: time s, displacement mm, force mN, the elastic force, and settings that the kind needs."""

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray
    truth: Truth
    noise: float
    depth: float
    settings: dict
    elastic: np.ndarray
    stages: tuple[str, ...] | None = None
    timed: bool = True

    def raw(self):
        return RawRecord(self.time, self.displacement, self.force, "drawn", stages=self.stages, timed=self.timed)


def law(rng, end):
    """The elastic force over the depth (0 to 1), its largest value 1: that of an end, as no sample, or some samples, have it.

    Half of the laws are the first power of the end and a little of the second, as the fit has it. The others are outside of what is
    fitted: a thin bonded layer under a sphere (Dimitriadis et al. 2002, Biophys J 82:2798), a column between plates under a flat
    end, a sample that stiffens or softens, and one that relaxes while it is loaded.
    """
    others = {"sphere": "layer", "flat": "column"}
    kind = rng.choice(["powers"] * 4 + ["stiff", "soft", "relaxing", others.get(end, "soft")])
    share = rng.uniform()
    force = LAWS[kind](POWERS[end], share)
    return lambda x: force(np.maximum(x, 0.0)) / force(np.ones(1))[0]


def _powers(powers, share):
    more = 0.3 * share
    return lambda x: (1 - more) * x ** powers[0] + more * x ** powers[1]


def _layer(powers, share):
    chi = 0.2 + share  # sqrt(radius * depth) over the thickness, at the largest depth
    return lambda x: x**1.5 * np.polyval([0.0975, 0.769, 1.283, 1.133, 1], chi * np.sqrt(x))


def _column(powers, share):
    strain = 0.1 + 0.4 * share
    return lambda x: (1 - strain * x) ** -2 - (1 - strain * x)


def _stiff(powers, share):
    return lambda x: x ** powers[0] * np.exp(2 * share * x)


def _soft(powers, share):
    return lambda x: x ** powers[0] / (1 + 0.5 * share * x)


def _relaxing(powers, share):
    """Half of the force relaxes, in a tenth to three durations of the loading: an integral over the loading by its midpoints."""
    x = np.linspace(0, 1, 1001)
    rate, age = np.diff(x ** powers[0]), 0.1 * 30**share
    middle = 0.5 * (x[1:] + x[:-1])
    relaxed = np.cumsum(rate * np.exp(middle / age))
    force = np.append(0.0, 0.5 * x[1:] ** powers[0] + 0.5 * relaxed * np.exp(-x[1:] / age))
    return lambda depth: np.interp(depth, x, force)


LAWS = {"powers": _powers, "layer": _layer, "column": _column, "stiff": _stiff, "soft": _soft, "relaxing": _relaxing}


def drawn(rng, end=None, travel=None, path=None, noise=None, samples=None):
    """A record: approach, loading and a short rest, of which kinds change something.

    path: corners (time, position) in depths and ramp durations; by default approach and ramp at one velocity.
    """
    end = end or rng.choice(list(POWERS))
    depth, peak = 10 ** rng.uniform(-3, 0.5), 10 ** rng.uniform(-2, 4)
    samples = samples or int(10 ** rng.uniform(2.3, 3.5))
    duration = 10 ** rng.uniform(-1, 2)
    travel = rng.uniform(0.3, 2.5) if travel is None else travel
    corners = path or [(0, -travel), (travel + 1, 1.0)]
    times, places = np.array(corners).T
    t = np.arange(int(times[-1] * samples)) / samples
    x = np.interp(t, times, places)
    force = law(rng, end)
    noise = 10 ** rng.uniform(-3, -1.7) if noise is None else noise
    zero, start = rng.uniform(-0.5, 0.5), rng.uniform(-2, 2)
    f = peak * (force(x) + noise * rng.standard_normal(t.size) + zero)
    truth = Truth(start * depth, peak * float(force(x.max())), end)
    return Drawn(t * duration, (x + start) * depth, f, truth, noise * peak, depth, {"indenter": end}, peak * force(x))


# ---- kinds -------------------------------------------------------------------------------------------------------


def approach(rng):
    return drawn(rng)


def end_not_known(rng):
    """The settings do not say whether the end is flat, a sphere or a cone."""
    return replace(drawn(rng), settings={})


def in_contact(rng):
    """The record begins at a trigger force; the sensor's zero is right, and the end is known."""
    record = drawn(rng, travel=0.0)
    begin = int(np.argmax(record.displacement >= record.truth.contact + rng.uniform(0.0, 0.25) * record.depth))
    part = slice(begin, None)
    offset = float(np.median(record.force - record.elastic))
    return replace(record, time=record.time[part], displacement=record.displacement[part], force=record.force[part] - offset)


def hold(rng):
    record = drawn(rng, path=[(0, -0.8), (1.8, 1.0), (3.5, 1.0)])
    return record


def retract(rng):
    return drawn(rng, path=[(0, -1.0), (2.0, 1.0), (4.0, -1.0)])


def retract_chosen(rng):
    record = retract(rng)
    return replace(record, settings={**record.settings, "segment": "retract"})


def reversed_rows(rng):
    record = drawn(rng, path=[(0, -1.0), (2.0, 1.0)])
    back = slice(None, None, -1)
    return replace(
        record,
        displacement=record.displacement[back],
        force=record.force[back],
        timed=False,
        time=np.arange(record.time.size) * 1.0,
    )


def preload(rng):
    """Approach, preload, hold, load."""
    level = rng.uniform(0.15, 0.4)
    return drawn(rng, path=[(0, -0.8), (0.8 + level, level), (1.6 + level, level), (2.6, 1.0)], samples=int(rng.uniform(300, 1500)))


def stages(rng):
    return drawn(
        rng,
        path=[(0, -0.8), (1.05, 0.25), (1.5, 0.25), (1.75, 0.5), (2.2, 0.5), (2.7, 1.0), (3.0, 1.0)],
        samples=int(rng.uniform(300, 1500)),
    )


def relaxing_stages(rng):
    """Steps of one height, with holds in which the sample relaxes toward a part of its force: the peak is that of the last step."""
    steps, hold = int(rng.integers(2, 6)), rng.uniform(0.3, 2.0)
    corners = [(0.0, -0.8)]
    for height in np.arange(1, steps + 1) / steps:
        corners.append((corners[-1][0] + height - corners[-1][1], height))
        corners.append((corners[-1][0] + hold, height))
    return _relaxing_in_time(drawn(rng, path=corners, samples=int(rng.uniform(300, 1500))), rng)


def _relaxing_in_time(record, rng):
    """The record of a sample of which a part of the force relaxes, at one rate, however the stage moves."""
    relaxed, left = rng.uniform(0.2, 0.6), np.exp(-np.diff(record.time, prepend=0.0) / (record.time[-1] * 10 ** rng.uniform(-2, 0)))
    excess = np.zeros(record.time.size)
    for n in range(1, excess.size):
        excess[n] = left[n] * excess[n - 1] + relaxed * (record.elastic[n] - record.elastic[n - 1])
    elastic = (1 - relaxed) * record.elastic + excess
    force = record.force + elastic - record.elastic
    return replace(record, force=force, elastic=elastic, truth=replace(record.truth, peak=float(elastic.max())))


def soft_turn(rng):
    """The stage slows down evenly through 1 to 30 % of the ramp before it stops or turns, and the sample relaxes."""
    slows, turns, travel = 10 ** rng.uniform(-2, -0.5), rng.uniform() < 0.5, rng.uniform(0.3, 2.0)
    begin = travel + 1 - 0.5 * slows
    t = np.linspace(0, begin + slows + 1.0, 4000)
    speed = np.interp(t, [0, begin, begin + slows, begin + 2 * slows], [1, 1, 0, -1 if turns else 0])
    place = np.concatenate([[0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))]) - travel
    return _relaxing_in_time(drawn(rng, path=list(zip(t, place / place.max() if place.max() > 0 else place, strict=True))), rng)


def creep(rng):
    """A force that rises at one rate is then held, while the displacement creeps by 2 to 40 % of the depth."""
    record = drawn(rng, travel=rng.uniform(0.3, 1.5), path=None, samples=int(rng.uniform(300, 2000)))
    x = (record.displacement - record.truth.contact) / record.depth
    rising = x <= 1 - 1e-9
    force, held = record.elastic / record.truth.peak, int(np.count_nonzero(x > 0) * rng.uniform(0.5, 2))
    last = int(np.count_nonzero(rising))
    # the loading again at even steps of force
    count = int(np.count_nonzero(x[:last] > 0))
    level = np.linspace(0, 1, count)
    inner = np.interp(level, force[last - count : last] / force[last - 1], x[last - count : last])
    age = np.arange(1, held + 1) / count
    far, pace = rng.uniform(0.02, 0.4), 10 ** rng.uniform(-1, 0.5)
    place = np.concatenate([x[: last - count], inner, inner[-1] + far * (1 - np.exp(-age / pace))])
    elastic = record.truth.peak * np.concatenate([np.zeros(last - count), level, np.ones(held)])
    noise = record.noise * rng.standard_normal(place.size) + float(np.median(record.force - record.elastic))
    interval = record.time[1] - record.time[0]
    return replace(
        record,
        time=np.arange(place.size) * interval,
        displacement=record.truth.contact + place * record.depth,
        force=elastic + noise,
        elastic=elastic,
    )


def cycles(rng):
    path = [(0, -0.8), (1.7, 0.9), (3.4, -0.8), (5.1, 0.95), (6.8, -0.8), (8.6, 1.0), (10.4, -0.8)]
    record = drawn(rng, path=path, samples=int(rng.uniform(200, 1000)))
    return replace(record, settings={**record.settings, "cycle": "last"})


def _with(record, extra):
    return replace(record, force=record.force + extra * record.truth.peak)


def drift(rng):
    record = drawn(rng)
    return _with(record, rng.uniform(-0.2, 0.2) * record.time / np.ptp(record.time) * 2)


def slight_drift(rng):
    """A drift that the noise nearly hides: 0.2 to 3 % of the peak during the loading."""
    record = drawn(rng, noise=10 ** rng.uniform(-2.5, -1.7))
    drifted = rng.choice([-1, 1]) * 10 ** rng.uniform(-2.7, -1.5)
    loading = np.ptp(record.time) * record.depth / np.ptp(record.displacement)
    return _with(record, drifted * record.time / loading)


def slope(rng):
    """A baseline that slopes with the travel, as interference or viscous drag give it."""
    record = drawn(rng, travel=rng.uniform(0.5, 2))
    return _with(record, rng.uniform(-0.25, 0.25) * (record.displacement - record.displacement[0]) / record.depth)


def curved_drift(rng):
    """A drift that dies out, as after immersion."""
    record = drawn(rng)
    span = np.ptp(record.time)
    return _with(record, rng.uniform(-0.2, 0.2) * np.exp(-record.time / (rng.uniform(0.2, 1) * span)))


def wavy(rng):
    """A wavy baseline in liquid, over 20 % of the peak from top to bottom, throughout the record."""
    record = drawn(rng, travel=rng.uniform(1, 3), noise=10 ** rng.uniform(-3, -2))
    x = record.displacement / record.depth
    return _with(record, rng.uniform(0.1, 0.2) * np.sin(2 * np.pi * x / rng.uniform(0.3, 1.5) + rng.uniform(0, 7)))


def small_waves(rng):
    record = drawn(rng, travel=rng.uniform(1, 3), noise=10 ** rng.uniform(-3, -2))
    x = record.displacement / record.depth
    return _with(record, rng.uniform(0.01, 0.05) * np.sin(2 * np.pi * x / rng.uniform(0.2, 0.8) + rng.uniform(0, 7)))


def slow_noise(rng):
    record = drawn(rng, noise=1e-3)
    pole = np.exp(-1 / rng.uniform(5, 60))
    noise = lfilter([1], [1, -pole], rng.standard_normal(record.time.size + 500))[500:]
    return _with(record, 10 ** rng.uniform(-2.5, -1.7) * noise * np.sqrt(1 - pole**2))


def ringing(rng):
    """The load cell rings while the stage moves."""
    record = drawn(rng, noise=1e-3)
    pole, angle = rng.uniform(0.95, 0.995), rng.uniform(0.1, 1.0)
    shake = lfilter([1], [1, -2 * pole * np.cos(angle), pole**2], rng.standard_normal(record.time.size + 1000))[1000:]
    return _with(record, 10 ** rng.uniform(-2.5, -1.5) * shake / shake.std())


def adhesion(rng):
    """The sample pulls the indenter in before contact: a dip of 2 to 20 % of the peak."""
    record = drawn(rng, noise=10 ** rng.uniform(-3, -2.3))
    x = (record.displacement - record.truth.contact) / record.depth
    reach = rng.uniform(0.01, 0.06)
    dip = np.where(x < 0, np.exp(x / (0.3 * reach)), np.exp(-x / reach))
    return _with(record, -rng.uniform(0.02, 0.2) * dip)


def uneven(rng):
    """Samples at times of their own, as programs store them that thin a record."""
    record = drawn(rng, samples=int(rng.uniform(600, 3000)))
    kept = np.sort(rng.choice(record.time.size - 1, int(rng.uniform(0.2, 0.6) * record.time.size), replace=False))
    kept = np.append(kept, record.time.size - 1)
    return replace(record, time=record.time[kept], displacement=record.displacement[kept], force=record.force[kept])


def coarse_approach(rng):
    """A tenth of the samples before contact, as programs record that speed up there."""
    record = drawn(rng, samples=int(rng.uniform(600, 3000)))
    kept = (record.displacement > record.truth.contact - rng.uniform(0, 0.2) * record.depth) | (
        np.arange(record.time.size) % 10 == 0
    )
    return replace(record, time=record.time[kept], displacement=record.displacement[kept], force=record.force[kept])


def clipped(rng):
    record = drawn(rng, noise=10 ** rng.uniform(-3, -2))
    top = record.force.max() - rng.uniform(0.1, 0.4) * record.truth.peak
    return replace(record, force=np.minimum(record.force, top))


def clipped_hold(rng):
    """The sensor's range ends in a record that then holds."""
    record = hold(rng)
    top = record.force.max() - rng.uniform(0.05, 0.4) * record.truth.peak
    return replace(record, force=np.minimum(record.force, top))


def clipped_travel(rng):
    record = drawn(rng, noise=10 ** rng.uniform(-3, -2))
    top = record.displacement.max() - rng.uniform(0.1, 0.4) * record.depth
    return replace(record, displacement=np.minimum(record.displacement, top))


def noisy_travel(rng):
    record = drawn(rng)
    return replace(
        record, displacement=record.displacement + rng.uniform(0.0005, 0.005) * record.depth * rng.standard_normal(record.time.size)
    )


def steps(rng):
    """A converter with coarse steps."""
    record = drawn(rng)
    size = rng.uniform(0.002, 0.02) * record.truth.peak
    return replace(record, force=np.round(record.force / size) * size)


def coarse_travel(rng):
    """A converter of the displacement with coarse steps, each of several samples."""
    record = drawn(rng, samples=int(rng.uniform(1000, 3000)))
    size = rng.uniform(0.005, 0.03) * record.depth
    return replace(record, displacement=np.round(record.displacement / size) * size)


def short_approach(rng):
    return drawn(rng, travel=rng.uniform(0.03, 0.15))


def two_speeds(rng):
    """A fast approach, then a slow loading that begins before contact."""
    return drawn(rng, path=[(0, -2.0), (0.4, -0.3), (1.7, 1.0)], samples=int(rng.uniform(400, 2000)))


def rest_first(rng):
    return drawn(rng, path=[(0, -0.4), (0.5, -0.4), (1.9, 1.0), (2.5, 1.0)])


def _through_file(records, header, row, settings):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.txt"
        lines = []
        for n, record in enumerate(records, start=1):
            lines += [f"Test {n}", header]
            lines += [row.format(t=t, d=d, f=f) for t, d, f in zip(record.time, record.displacement, record.force, strict=True)]
            lines.append("")
        path.write_text("\n".join(lines))
        return read_records(path, Record(**settings))


def doubled_times(rng):
    """Time stamps of half the resolution: every time is given twice."""
    record = drawn(rng, samples=int(rng.uniform(300, 1500)))
    time = record.time[(np.arange(record.time.size) // 2) * 2]
    read = _through_file([replace(record, time=time)], "Time (s),Displacement (mm),Load (mN)", "{t:.9g},{d:.9g},{f:.9g}", {})
    return record, read[0]


def blocks(rng):
    """The second of three tests in a file."""
    records = [drawn(rng, samples=int(rng.uniform(200, 600))) for _ in range(3)]
    read = _through_file(records, "Time (s);Weg (um);Kraft (uN)", "{t:.9g};{d:.9g};{f:.9g}", {})
    second = records[1]
    truth = Truth(1e-3 * second.truth.contact, 1e-3 * second.truth.peak, second.truth.end)
    return replace(second, truth=truth, depth=1e-3 * second.depth), read[1]


KINDS: dict[str, Callable] = {
    kind.__name__: kind
    for kind in (
        approach, end_not_known, short_approach, in_contact, hold, rest_first, two_speeds, retract, retract_chosen, reversed_rows,
        preload, stages, relaxing_stages, soft_turn, creep, cycles,
        drift, slight_drift, slope, curved_drift, wavy, small_waves, slow_noise, ringing,
        adhesion, uneven,
        coarse_approach, doubled_times, blocks, clipped, clipped_hold, clipped_travel, noisy_travel, coarse_travel, steps,
    )
}  # fmt: skip


@dataclass
class Tally:
    """Counts of a kind: of the records without a flag those held (contact, peak) and those with a peak that is off; the others."""

    plain: int = 0
    held: int = 0
    flagged: int = 0
    flagged_held: int = 0
    refused: int = 0
    peak_off: int = 0
    peak_held: int = 0
    width: float = 0.0

    def band(self):
        """The smallest and the largest count that the binomial band allows."""
        low, high = binom.interval(BAND, self.plain, 0.95)
        return int(low), int(high)

    def passes(self):
        low, high = self.band()
        return low <= self.held <= high and self.peak_held >= low and not self.peak_off


def is_flag(note):
    """Whether a note puts contact, zero or peak in doubt; that contact was sought before a pause is no doubt."""
    told = any(words in note for words in TOLD) and "cannot be told" not in note
    return not told and any(word in note for word in FLAGS)


def tally(kind, trials, seed=0, verbose=False):
    """The Tally of a kind."""
    counts = Tally()
    widths = []
    for n in range(trials):
        made = KINDS[kind](np.random.default_rng([seed, n]))
        record, raw = made if isinstance(made, tuple) else (made, made.raw())
        try:
            done = process_record(raw, settings=Record(**record.settings))
        except RecordError as error:
            counts.refused += 1
            if verbose:
                print("   refused", n, str(error)[:150])
            continue
        held = abs(done.contact.displacement - record.truth.contact) <= done.contact.uncertainty
        off = done.peak / record.truth.peak - 1
        flagged = any(is_flag(note) for note in done.notes)
        widths.append(done.contact.uncertainty / record.depth)
        if verbose and ((not flagged and (not held or abs(off) > PEAK)) or (verbose == 2 and not held)):
            miss = (done.contact.displacement - record.truth.contact) / record.depth
            noise = record.noise / record.truth.peak
            print(
                f"   {n} {record.truth.end} {done.contact.form} miss {miss:.4f} +- {widths[-1]:.4f} depth, peak {off:+.2%},",
                end=" ",
            )
            print(f"{done.contact.method}, noise {noise:.2%} {done.notes}")
        counts.flagged += flagged
        counts.flagged_held += flagged and held
        counts.plain += not flagged
        counts.held += held and not flagged
        counts.peak_off += abs(off) > PEAK and not flagged
        counts.peak_held += abs(done.peak - record.truth.peak) <= done.peak_uncertainty and not flagged
    counts.width = float(np.median(widths)) if widths else 0.0
    return counts


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--verbose", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    choice = parser.parse_args()
    print(
        f"{'kind':16} {'plain':>5} {'held':>5} {'band':>9} {'peaks':>5} {'off':>4} {'flagged':>7} {'held':>5} {'refused':>7} "
        f"{'width':>7}"
    )
    for kind in choice.kinds.split(","):
        counts = tally(kind, choice.trials, choice.seed, choice.verbose)
        low, high = counts.band()
        print(
            f"{kind:16} {counts.plain:5} {counts.held:5} {low:4}-{high:4} {counts.peak_held:5} {counts.peak_off:4} "
            f"{counts.flagged:7} {counts.flagged_held:5} {counts.refused:7} {counts.width:7.2%} {'' if counts.passes() else '<-'}",
            flush=True,
        )


if __name__ == "__main__":
    main()
