"""Samples of a posterior as files: netCDF that ArviZ reads, and a figure of all pairs."""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from indentfit.curve import Curve
from indentfit.inference.sampling import PosteriorSamples
from indentfit.report.plots import Place, save
from indentfit.report.style import COLOURS, COLUMN, STYLE

BINS, CELLS = 40, 30  # of a histogram, and of each side of a density of two coordinates
PANEL = 0.42  # width of a panel, over that of a column


def write_netcdf(samples: PosteriorSamples, measured: dict[str, Curve], path: Path) -> None:
    """Write samples in the layout of ArviZ: groups `posterior`, `sample_stats` and `observed_data`.

    Parameters
    ----------
    samples : PosteriorSamples
    measured : dict of test -> Curve
    path : Path
        Read it with `xarray.open_datatree(path)`, which ArviZ 1 works on, or with `from_netcdf` of ArviZ 0.
    """
    import h5netcdf  # with the extra that brings emcee too

    with h5netcdf.File(path, "w") as file:
        file.attrs["creation_library"] = "indentfit"
        group = file.create_group("posterior")
        chains, draws = samples.log_density.shape
        for name, size in (("chain", chains), ("draw", draws)):
            group.dimensions[name] = size
            group.create_variable(name, (name,), data=np.arange(size))
        for n, (name, unit) in enumerate(zip(samples.names, samples.units, strict=True)):
            group.create_variable(variable(name), ("chain", "draw"), data=samples.values[..., n]).attrs["units"] = unit
        for n, name in enumerate(samples.tests):
            group.create_variable(variable(f"noise {name}"), ("chain", "draw"), data=samples.noise[..., n]).attrs["units"] = (
                measured[name].shown.up_unit if name in measured else "mN"
            )
        if len(samples.alternatives) > 1:
            known = group.create_variable("alternative", ("chain", "draw"), data=samples.alternative)
            known.attrs["meaning"] = ", ".join(f"{n}: {name}" for n, name in enumerate(samples.alternatives))
        stats = file.create_group("sample_stats")
        for name, size in (("chain", chains), ("draw", draws)):
            stats.dimensions[name] = size
            stats.create_variable(name, (name,), data=np.arange(size))
        stats.create_variable("lp", ("chain", "draw"), data=samples.log_density)
        observed = file.create_group("observed_data")
        for name, curve in measured.items():
            size = variable(f"displacement {name}")
            observed.dimensions[size] = curve.force.size
            axes = curve.shown
            for known, unit, values in (
                (size, axes.across_unit, curve.displacement),
                (variable(f"force {name}"), axes.up_unit, curve.force),
            ):
                observed.create_variable(known, (size,), data=values).attrs["units"] = unit


def variable(name: str) -> str:
    """A name without spaces and brackets, such as "offset (parallel)" as "offset_parallel"."""
    return "_".join("".join(letter if letter.isalnum() else " " for letter in name).split())


def corner(samples: PosteriorSamples, path: Place = None) -> Figure:
    """The densities of all parameters and inputs, and of all pairs of them; saved as SVG and PNG where a path is given."""
    n = len(samples.names)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(PANEL * COLUMN * n, PANEL * COLUMN * n), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(n, n, squeeze=False)
        for i in range(n):
            for j in range(n):
                _panel(axes[i][j], samples, i, j)
        save(figure, path)
    return figure


def _panel(ax: Axes, samples: PosteriorSamples, i: int, j: int) -> None:
    """The panel in row i and column j."""
    if j > i:
        ax.set_axis_off()
        return
    n, names = len(samples.names), samples.names
    x = samples.of(names[j])
    if i == j:
        ax.hist(x, BINS, color=COLOURS[0], alpha=0.5, density=True)
        ax.axvspan(*samples.interval(names[j]), color=COLOURS[0], alpha=0.12, linewidth=0)
        ax.set_yticks([])
    else:
        ax.hist2d(x, samples.of(names[i]), CELLS, cmap="Blues", rasterized=True)
    ax.xaxis.set_major_locator(MaxNLocator(3))
    if i != j:
        ax.yaxis.set_major_locator(MaxNLocator(3))
    ax.tick_params(labelbottom=i == n - 1, labelleft=j == 0 and i > 0)
    if i == n - 1:
        ax.set_xlabel(_with_unit(samples, j))
    if j == 0 and i > 0:
        ax.set_ylabel(_with_unit(samples, i))


def _with_unit(samples: PosteriorSamples, n: int) -> str:
    unit = samples.units[n]
    return samples.names[n] + (f"\n({unit})" if unit != "1" else "")
