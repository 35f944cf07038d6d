"""What a study has finished, kept in a file beside its result, so that a killed study goes on where it stopped."""

import contextlib
import hashlib
import json
import os
from collections.abc import MutableMapping
from pathlib import Path

from indentfit.errors import OutputError


class Kept(MutableMapping):
    """Key -> record of a finished piece of work, each on disk, as a line of JSON, before the next one starts.

    A line that was cut short by the end of a process, or changed since, is left out when the file is read again. Raises
    OutputError where the file cannot be written.
    """

    def __init__(self, path):
        self.path = Path(path)
        self._records = dict(self._read())

    def __getitem__(self, key):
        return self._records[key]

    def __setitem__(self, key, record):
        line = json.dumps([key, record, _checksum(key, record)], allow_nan=False)
        try:
            with self.path.open("a+b") as file:
                file.write((b"" if self._ends_with_line(file) else b"\n") + line.encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written ({error.strerror or error}); choose another folder") from error
        self._records[key] = json.loads(line)[1]

    def __delitem__(self, key):
        raise TypeError("what is finished stays finished")

    def __iter__(self):
        return iter(self._records)

    def __len__(self):
        return len(self._records)

    def forget(self):
        """Take the file away: the study's result is whole."""
        self.path.unlink(missing_ok=True)

    def _read(self):
        try:
            lines = self.path.read_bytes().splitlines()
        except FileNotFoundError:
            return
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be read ({error.strerror or error}); remove it") from error
        for line in lines:
            with contextlib.suppress(ValueError, TypeError, RecursionError):
                key, record, checksum = json.loads(line)
                if checksum == _checksum(key, record):
                    yield key, record

    @staticmethod
    def _ends_with_line(file):
        """Whether the file is empty or its last line is whole."""
        if not file.seek(0, os.SEEK_END):
            return True
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"


def _checksum(key, record):
    """SHA-256 of what a line says: a number that was damaged on the disk is computed again, not believed."""
    return hashlib.sha256(json.dumps([key, record], sort_keys=True).encode()).hexdigest()


def place_beside(folder):
    """The file of what is finished, for a result folder to be: hidden, beside it."""
    folder = Path(folder)
    return folder.with_name(f".{folder.name[:60]}.unfinished.jsonl")
