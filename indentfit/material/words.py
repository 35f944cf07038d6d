"""Words that messages about materials share."""

from collections.abc import Iterable

from indentfit.errors import suggestion


def nearest(name: str, known: Iterable[str]) -> str:
    """The end of a message that suggests the known name, in quotes, nearest to the given name; empty where no name is near."""
    return suggestion(name, known, quoted=True)


def one_line(error: BaseException) -> str:
    """An exception's type and text on one line, for messages."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:200]}" if text else type(error).__name__
