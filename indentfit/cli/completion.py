"""What a shell completes after TAB: names of materials, keys of a case and their values, without the numerical libraries."""

import importlib.metadata

import click
from click.shell_completion import CompletionItem


def laws(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Names of installed materials that begin so."""
    names = {entry.name for entry in importlib.metadata.entry_points(group="indentfit.materials")}
    return sorted(name for name in names if name.startswith(incomplete))


def keys(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Keys of a case with their meaning, as KEY= of --set; after the equals sign, the values of a key that has choices."""
    from indentfit.case.keys import keys as known_keys  # the tables of the case take a quarter of a second

    name, equals, value = incomplete.partition("=")
    known = {known.key: known for known in known_keys()}
    if equals:
        values = [str(choice) for choice in known[name].choices] if name in known else []
        return [CompletionItem(f"{name}={other}") for other in values if other.startswith(value)]
    return [CompletionItem(f"{key}=", help=facts.meaning) for key, facts in known.items() if key.startswith(name)]


def listed_laws(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """The last of several names of installed materials, which are parted by commas."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in laws(context, parameter, last)]
