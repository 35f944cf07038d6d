"""The examples of the guide, run as they stand in its pages; the pictures that pages show are taken from their results."""

import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from indentfit.errors import InputError
from indentfit.report.guide import PAGES
from indentfit.report.page import Picture, image, vector_image

TUTORIALS = ("gel_and_sphere", "punch_on_cartilage", "bar_on_fibres", "raw_records", "several_samples")
BLOCK = re.compile(r"```(python|sh)\n(.*?)```", re.DOTALL)
PICTURE = re.compile(r"^!\[([^\]]+)\]\(([^)]+)\)$", re.MULTILINE)
LONGEST = 600  # seconds of a command


@dataclass(frozen=True)
class Ran:
    """A command of a page, what it printed, and the CPU seconds that it took."""

    line: str
    said: str
    seconds: float


def run_page(page: str, cases: Path, folder: Path) -> list[Ran]:
    """Run the blocks of a page in a folder, with the folder `cases` of the source beside them: lines of `sh` are run, a block of
    `python` becomes the file that its first line names. Raises InputError where a command fails."""
    (folder / "cases").symlink_to(cases.resolve())
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    ran = []
    for language, text in BLOCK.findall((PAGES / f"{page}.md").read_text(encoding="utf-8")):
        if language == "python":
            named = re.match(r"# file: ([\w.-]+)", text)
            assert named is not None, f"{page}: the first line of a Python block names its file"
            (folder / named[1]).write_text(text, encoding="utf-8")
            continue
        ran += [_run(line, folder, {**os.environ, "PATH": path, "COLUMNS": "200"}) for line in text.splitlines()]
    return ran


def _run(line: str, folder: Path, environment: dict[str, str]) -> Ran:
    before = os.times()
    done = subprocess.run(
        shlex.split(line), cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST, stdin=subprocess.DEVNULL
    )
    after = os.times()
    if done.returncode:
        raise InputError(f"{line}: ended with {done.returncode}: {done.stdout}{done.stderr}")
    return Ran(line, done.stdout, sum(after[2:4]) - sum(before[2:4]))


def pictures_of(page: str, folder: Path) -> dict[str, Picture]:
    """The pictures of a page whose examples were run in `folder`, by their addresses in the page."""
    pictures = {}
    for words, address in PICTURE.findall((PAGES / f"{page}.md").read_text(encoding="utf-8")):
        make = vector_image if address.endswith(".svg") else image
        pictures[address] = make(folder / address, f"{words}.", words)
    return pictures
