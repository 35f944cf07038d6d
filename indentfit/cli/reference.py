"""The reference of the commands, generated from their options: a part of the guide."""

from collections.abc import Iterator

import click


def commands_page() -> str:
    """Markdown: each command with its help, arguments and options."""
    from indentfit.cli import COMMANDS, main  # the group, which imports each command's module by its name

    context = click.Context(main, info_name="indentfit", help_option_names=["-h", "--help"])
    parts = ["## Options before a command\n", *_options(main, context)]
    for name in COMMANDS:
        known = main.get_command(context, name)
        assert known is not None
        parts += _command(name, known, context)
    return "\n".join(parts)


def _command(name: str, known: click.Command, group: click.Context) -> Iterator[str]:
    context = click.Context(known, info_name=name, parent=group)
    usage = " ".join(known.collect_usage_pieces(context))
    yield f"## {name}\n"
    yield f"```text\nindentfit {name} {usage}\n```\n"
    yield (known.help or "").replace("\b\n", "").replace("\n    ", "\n") + "\n"
    yield from _options(known, context)


def _options(known: click.Command, context: click.Context) -> Iterator[str]:
    yield "| option | meaning |\n|---|---|"
    for parameter in known.get_params(context):
        if isinstance(parameter, click.Option) and (record := parameter.get_help_record(context)):
            yield f"| `{record[0].replace('|', ', ')}` | {record[1].replace('|', ', ')} |"
    yield ""
