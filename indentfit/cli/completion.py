"""What a shell completes after TAB: names of materials, and keys of a case, without waiting for the numerical libraries."""

import importlib.metadata

import click


def laws(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Names of installed materials that begin so."""
    names = {entry.name for entry in importlib.metadata.entry_points(group="indentfit.materials")}
    return sorted(name for name in names if name.startswith(incomplete))
