"""Processed records in numbers: as text, as a table of stiffnesses, as JSON."""

import csv
from dataclasses import asdict

COLUMNS = {
    "stiffness_mN_per_mm": lambda one: one.line.slope,
    "stiffness_stderr": lambda one: one.line.stderr,
    "r_squared": lambda one: one.line.r_squared,
    "quadratic_mN_per_mm2": lambda one: one.parabola.curvature,
    "quadratic_slope_mN_per_mm": lambda one: one.parabola.slope,
    "quadratic_r_squared": lambda one: one.parabola.r_squared,
    "contact_mm": lambda one: one.contact.displacement,
    "contact_uncertainty_mm": lambda one: one.contact.uncertainty,
    "velocity_mm_per_s": lambda one: one.velocity,
    "strain_rate_per_s": lambda one: one.strain_rate,
    "depth_mm": lambda one: one.depth,
    "peak_mN": lambda one: one.peak,
    "modulus_ratio": lambda one: one.relaxation and one.relaxation.ratio,
}


def write_stiffness(path, outcomes, strains, outlying):
    """Write a row for each Outcome, failed ones with their problem; strains: those with a column of forces; outlying: names."""
    forces = [f"force_mN_at_{strain:g}" for strain in strains]
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(
            ["sample", "direction", "file", "status", "thickness_mm", "diameter_mm", *COLUMNS, *forces, "outlier", "notes"]
        )
        for one in outcomes:
            entry, done = one.entry, one.processed
            values = [""] * (len(COLUMNS) + len(forces))
            if done:
                values = [_blank(column(done)) for column in COLUMNS.values()]
                values += [_blank(done.forces.get(strain)) for strain in strains]
            where = [entry.sample, _blank(entry.direction), str(entry.path), "ok" if done else "failed"]
            lengths = [_blank(entry.thickness), _blank(entry.diameter)]
            notes = one.problem or "; ".join(done.notes)
            table.writerow([*where, *lengths, *values, "yes" if one.name in outlying else "", notes])


def write_means(path, means):
    """Write the mean curves, direction -> MeanCurve, with their standard deviations, as one CSV."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["direction", "displacement_mm", "force_mN", "sd_mN", "n"])
        for direction, mean in means.items():
            columns = (mean.displacement.tolist(), mean.force.tolist(), mean.sd.tolist())
            table.writerows([direction, *row, mean.count] for row in zip(*columns, strict=True))


def outlier_names(statistics):
    """Names of the outcomes whose stiffness lies far from those of their direction."""
    return {f"{sample} {direction}°" for direction, spread in statistics.stiffness.items() for sample in spread.outliers}


def record_facts(outcome):
    """One Outcome as the JSON holds it."""
    entry, done = outcome.entry, outcome.processed
    facts = {
        "sample": entry.sample,
        "direction": entry.direction,
        "file": str(entry.path),
        "thickness_mm": entry.thickness,
        "diameter_mm": entry.diameter,
        "status": "ok" if done else "failed",
        "problem": outcome.problem,
    }
    if not done:
        return facts
    return {
        **facts,
        "contact": asdict(done.contact),
        "window_s": [float(done.record.time[done.window.start]), float(done.record.time[done.window.stop - 1])],
        "velocity_mm_per_s": done.velocity,
        "strain_rate_per_s": done.strain_rate,
        "depth_mm": done.depth,
        "peak_mN": done.peak,
        "filter_s": done.ramp.length * done.record.interval,
        "linear": asdict(done.line),
        "quadratic": asdict(done.parabola),
        "force_mN_at_strain": {f"{strain:g}": force for strain, force in done.forces.items()},
        "relaxation": done.relaxation and asdict(done.relaxation),
        "notes": list(done.notes),
    }


def statistics_facts(statistics, means):
    """Statistics and mean curves as the JSON holds them."""
    return {
        "stiffness_mN_per_mm": {str(direction): asdict(spread) for direction, spread in statistics.stiffness.items()},
        "ratio_90_to_0": statistics.ratio and asdict(statistics.ratio),
        "differences": [asdict(one) for one in statistics.differences],
        "mean_curves": {
            str(direction): {
                "displacement_mm": mean.displacement,
                "force_mN": mean.force,
                "sd_mN": mean.sd,
                "n": mean.count,
                "linear": asdict(mean.line),
                "quadratic": asdict(mean.parabola),
            }
            for direction, mean in means.items()
        },
    }


def record_lines(outcomes, outlying):
    """Outcomes in words: a line for each, those with a problem without numbers."""
    rows = [["record", "stiffness", "R2", "contact", "velocity", "depth", "peak", ""]]
    rows.append(["", "mN/mm", "", "mm", "mm/s", "mm", "mN", ""])
    for one in outcomes:
        done = one.processed
        if done is None:
            rows.append([one.name, "failed", "", "", "", "", "", ""])
            continue
        stiffness = f"{done.line.slope:.4g} +- {done.line.stderr:.2g}"
        contact = f"{done.contact.displacement:.4f} +- {done.contact.uncertainty:.4f}"
        numbers = [f"{done.line.r_squared:.4f}", contact, f"{done.velocity:.3g}", f"{done.depth:.4f}", f"{done.peak:.4g}"]
        rows.append([one.name, stiffness, *numbers, "outlier?" if one.name in outlying else ""])
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def relaxation_lines(outcomes):
    """The Prony series of the holds, a line for each."""
    for one in outcomes:
        if one.processed and (series := one.processed.relaxation):
            terms = ", ".join(
                f"{share:.3g} +- {share_error:.1g} at {tau:.3g} +- {tau_error:.1g} s"
                for share, share_error, tau, tau_error in zip(
                    series.shares, series.shares_stderr, series.times, series.times_stderr, strict=True
                )
            )
            others = ", ".join(f"{ratio:.3f} with {n}" for n, ratio in series.by_terms.items() if n != len(series.shares))
            yield (
                f"relaxation  {one.name}: Ginf/G0 = {series.ratio:.3f} +- {series.ratio_stderr:.1g} with "
                f"{len(series.shares)} Prony terms ({others}); shares {terms}"
            )


def statistics_lines(statistics):
    """Statistics in words."""
    for direction, spread in statistics.stiffness.items():
        yield f"stiffness   {direction}°: {_mean(spread)} mN/mm, n = {spread.n}{_interval(spread.interval)}{_outliers(spread)}"
    if statistics.ratio:
        spread = statistics.ratio
        yield f"ratio       90° / 0°, per sample: {_mean(spread)}, n = {spread.n}{_interval(spread.interval)}{_outliers(spread)}"
    for one in statistics.differences:
        n = f"{one.n[0]} pairs" if one.test.startswith(("paired", "Wilcoxon")) else f"{one.n[0]} + {one.n[1]}"
        difference = f"; difference{_interval(one.interval)[1:]} mN/mm" if one.interval else ""
        yield f"difference  {one.test}, {n}: p = {one.p:.3g}{difference}"


def _mean(spread):
    return f"{spread.mean:.4g}" + (f" +- {spread.sd:.3g} (SD)" if spread.n > 1 else "")


def _interval(interval):
    return f", 95 % interval {interval[0]:.4g} to {interval[1]:.4g}" if interval[0] == interval[0] else ""


def _outliers(spread):
    return f"; outliers, counted all the same: {', '.join(spread.outliers)}" if spread.outliers else ""


def _blank(value):
    return "" if value is None else f"{value:.10g}" if isinstance(value, float) else value
