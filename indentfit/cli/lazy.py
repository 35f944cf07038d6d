"""Choices of options that come from the case's model, which is only imported when a value is looked at."""

from functools import cached_property
from typing import Any

import click
from click.shell_completion import CompletionItem


class KeyChoice(click.ParamType):
    """The words that a key of the case may have, such as "fit.method"."""

    name = "word"

    def __init__(self, key: str) -> None:
        self.key = key

    @cached_property
    def choice(self) -> "click.Choice[str]":
        from indentfit.case.keys import choices

        return click.Choice(choices(self.key))

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str | None:
        return self.choice.get_metavar(param, ctx)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return self.choice.convert(value, param, ctx)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return self.choice.shell_complete(ctx, param, incomplete)
