"""The ledger: every run of the forward model, in one SQLite file, so that no run is lost and no run is computed twice.

A stored run is found again by its key (runs/key.py), a hash of everything that decides its curve.

Durability: a run takes seconds and a transaction milliseconds, so each run is committed alone, with the plain rollback journal and
synchronous = EXTRA. A committed run survives kill -9 and a power cut, and the ledger is one file that works on network drives,
where the shared memory of a write-ahead log does not. The ledger holds its lock from opening to closing, and the lock ends with its
process, so two commands cannot write to one folder.
"""

import contextlib
import copy
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from indentfit.case import Case, Test, Uncertain
from indentfit.errors import LedgerError
from indentfit.runs import rows
from indentfit.runs.key import FORMAT, Inputs, as_json, code
from indentfit.runs.relaxing import elastic_case
from indentfit.runs.run import Run

FILE_OF_JOURNAL = "{}-journal"  # SQLite's name for what it needs to undo a transaction
APPLICATION = 0x696E6474  # "indt", in the file's header: tells a ledger from other SQLite files


class InUse(LedgerError):
    """Another process holds the ledger's lock."""


class Unreadable(LedgerError):
    """A ledger that is damaged, or of another format."""


class Ledger:
    """The runs of a case, and of `others` like it, in a file that is locked from opening to `close`; to be used in a `with` block.

    Parameters
    ----------
    path : path of the file
    case : Case
    resume : bool
        With `resume` the file must belong to this case (settings that matter only after the search may differ) and to these
        versions; all of its runs are used, also those that failed because of the machine. Without `resume`, runs that failed
        because of the machine are dropped and computed again, the file then belongs to this case, and an unreadable file is
        replaced.
    others : iterable of Case
        Further cases whose runs are kept in the same file.

    Attributes
    ----------
    remarks : list of str
        Lines for the user.

    Raises
    ------
    LedgerError
        The file cannot be used or written. The error's text is one line.
    """

    def __init__(self, path: str | Path, case: Case, resume: bool = False, others: Iterable[Case] = ()) -> None:
        self.path, self.case, self.inputs = Path(path), case, Inputs(case)
        whole = (case, *others)
        elastic = (elastic_case(known) for known in whole if known.relaxation is not None)  # the runs of their fits
        self.origins = {Inputs(known).origin.encode() for known in (*whole, *elastic)}
        self.remarks: list[str] = []
        self._file: Any = None
        try:
            self._open(resume)
        except Unreadable as error:
            if resume:
                raise
            self.remarks.append(f"{str(error).partition('; ')[0]}; its runs are not used")
            for name in (FILE_OF_JOURNAL.format(self.path.name), self.path.name):
                self.path.with_name(name).unlink(missing_ok=True)
            self._open(resume)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        """The number of runs that this case and the others can use."""
        return sum(len(runs) for runs in self._runs.values())

    @property
    def has_own(self) -> bool:
        """Whether this ledger holds runs that are in no other ledger."""
        return bool(self._own)

    def of(self, case: Case) -> "Ledger":
        """The same file for another case, one of the `others`: the returned ledger finds and adds the runs of that case."""
        other = copy.copy(self)
        other.case, other.inputs = case, Inputs(case)
        return other

    def close(self) -> None:
        """Close the file, which holds all added runs already."""
        if self._file is not None:
            with contextlib.suppress(sqlite3.Error):
                self._file.close()
        self._file = None

    def find(self, parameters: Mapping[str, Any], test: Test, names: Iterable[str] = ()) -> Run | None:
        """The Run of a test of the case at parameters (name -> value) that has the sensitivities `names`, or None.

        The earliest suitable run is returned, so that a resumed fit, which knows later runs from the start, uses the same runs.
        """
        runs = self._runs.get(self.inputs.hash(self.inputs.of(parameters, test)), ())
        return next((run for run in runs if run.serves(names)), None)

    def add(self, parameters: Mapping[str, Any], test: Test, run: Run) -> None:
        """Write a Run durably before returning."""
        inputs = self.inputs.of(parameters, test)
        row = rows.row_of(self.inputs.hash(inputs), self.inputs.origin, test.name, inputs, run)
        if not self.path.exists():  # SQLite would go on writing to a removed file
            raise LedgerError(f"{self.path}: the ledger was removed while it was in use; give the command again")
        with _in_words_of_the_ledger(self.path), _transaction(self._file):
            rows.insert(self._file, row)
        self._runs.setdefault(row.hash.decode(), []).append(run)
        self._own.append(row.hash)

    def take_over(self, path: str | Path) -> int:
        """Add those runs of another ledger that this case can use and that this ledger lacks.

        Runs that failed because of the machine are not added.

        Parameters
        ----------
        path : path of the other ledger

        Returns
        -------
        int
            The number of runs that were added.

        Raises
        ------
        LedgerError
        """
        read = [(stored.row, stored.run) for stored in _rows_of(Path(path))]
        damaged = sum(run is None for _, run in read)
        if damaged:
            self.remarks.append(f"{path}: {damaged} damaged runs are not used")
        known = set(self._runs)
        taken = [
            (row, run) for row, run in read
            if run and not run.lost and row.origin in self.origins and row.hash.decode() not in known
        ]  # fmt: skip
        with _in_words_of_the_ledger(self.path), _transaction(self._file):
            for row, run in taken:
                rows.insert(self._file, row)
                self._runs.setdefault(row.hash.decode(), []).append(run)
        return len(taken)

    def _open(self, resume: bool) -> None:
        self._runs: dict[str, list[Run]] = {}
        self._own: list[bytes] = []
        try:
            with _in_words_of_the_ledger(self.path):
                self._file = _locked(self.path)
                self._begin(resume)
        except BaseException:
            self.close()
            raise

    def _begin(self, resume: bool) -> None:
        """Check the file, or create its tables, and read its runs."""
        empty = not self._file.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        with _transaction(self._file):
            if empty:
                if resume:
                    self.remarks.append(f"{self.path}: holds no run yet; the fit starts from its beginning")
                _create(self._file)
            else:
                _refuse_other_format(self._file, self.path)
                _refuse_damage(self._file, self.path)
                if resume:
                    _refuse_other_case(_about(self._file, self.path), self._own_facts(), self.path)
            self._read(keep_lost=resume)
            self._own += [key.encode() for key in self._runs]
            if empty or not resume:
                self._write_about()

    def _read(self, keep_lost: bool) -> None:
        damaged = 0
        for stored in rows.stored(self._file):
            run = stored.run
            damaged += run is None
            if run is None or (run.lost and not keep_lost):
                self._file.execute("DELETE FROM runs WHERE id = ?", (stored.number,))
            elif stored.row.origin in self.origins:
                self._runs.setdefault(stored.row.hash.decode(), []).append(run)
        if damaged:
            self.remarks.append(f"{self.path}: {damaged} damaged runs were thrown away; they are run again if needed")

    def _own_facts(self) -> dict[str, str]:
        facts = {"case": _searched(self.case).hash, "origin": self.inputs.origin, "title": self.case.title}
        return facts | {"versions": as_json(self.inputs.versions | {"code": code()})}

    def _write_about(self) -> None:
        self._file.execute("DELETE FROM about")
        for name, value in self._own_facts().items():
            row = (name.encode(), value.encode())
            self._file.execute("INSERT INTO about VALUES (CAST(? AS TEXT), CAST(? AS TEXT), ?)", (*row, rows.checksum(row)))


def refuse_in_use(path: str | Path) -> None:
    """Raise LedgerError where another process holds the lock of a ledger."""
    path = Path(path)
    try:
        with _in_words_of_the_ledger(path):
            _locked(path).close()
    except InUse:
        raise
    except LedgerError:
        pass  # opening the ledger reports every other fault


def _searched(case: Case) -> Case:
    """The case without the settings that matter only after its search: a fit that is resumed may change them."""
    uncertain = Uncertain.model_validate(case.fit.uncertain.fitted)
    ended = case.fit.model_copy(update={"uncertain": uncertain, "published": {}, "profiles": True})
    return case.model_copy(update={"fit": ended})


# The file


def _locked(path: Path) -> sqlite3.Connection:
    """A connection that holds the file's lock until it is closed."""
    file = sqlite3.connect(path, timeout=0, isolation_level=None)
    try:
        file.text_factory = bytes  # damaged text need not be UTF-8
        file.execute("PRAGMA trusted_schema = OFF")
        file.execute("PRAGMA locking_mode = EXCLUSIVE")
        file.execute("BEGIN EXCLUSIVE")
        file.execute("COMMIT")
        file.execute("PRAGMA journal_mode = DELETE")
        file.execute("PRAGMA synchronous = EXTRA")
        if not path.exists():
            raise LedgerError(f"{path}: another run, which has just ended, has moved the ledger; look at the result of that run")
    except BaseException:
        file.close()
        raise
    return file


def _rows_of(path: Path) -> list[rows.Stored]:
    """The rows of a ledger that is only read."""
    if not path.is_file():
        raise LedgerError(f"{path}: no such ledger; name a result folder of `indentfit fit`, `sweep` or `mesh-check`")
    uri = f"{path.resolve().as_uri()}?mode=ro"
    with _in_words_of_the_ledger(path), contextlib.closing(sqlite3.connect(uri, uri=True, timeout=0, isolation_level=None)) as file:
        file.text_factory = bytes
        file.execute("PRAGMA trusted_schema = OFF")
        _refuse_other_format(file, path)
        _refuse_damage(file, path)
        return rows.stored(file)


def _create(file: sqlite3.Connection) -> None:
    for table in rows.TABLES:
        file.execute(table)
    file.execute(f"PRAGMA application_id = {APPLICATION}")
    file.execute(f"PRAGMA user_version = {FORMAT}")


@contextlib.contextmanager
def _transaction(file: sqlite3.Connection) -> Iterator[None]:
    file.execute("BEGIN IMMEDIATE")
    try:
        yield
        file.execute("COMMIT")
    except BaseException:
        with contextlib.suppress(sqlite3.Error):
            file.execute("ROLLBACK")
        raise


def _refuse_other_format(file: sqlite3.Connection, path: Path) -> None:
    if file.execute("PRAGMA application_id").fetchone()[0] != APPLICATION:
        raise Unreadable(f"{path}: not a ledger of indentfit, or damaged; {_remedy(path)}")
    written = file.execute("PRAGMA user_version").fetchone()[0]
    if written != FORMAT:
        raise Unreadable(
            f"{path}: a ledger of format {written}; this indentfit reads format {FORMAT}: use the version that wrote it, "
            f"or {_remedy(path)}"
        )


def _refuse_damage(file: sqlite3.Connection, path: Path) -> None:
    tables = sorted(sql or b"" for (sql,) in file.execute("SELECT sql FROM sqlite_master"))
    if tables != sorted(table.encode() for table in rows.TABLES):  # nor views or triggers, which could do anything
        raise Unreadable(f"{path}: damaged (its tables are not those of a ledger); {_remedy(path)}")
    verdict = file.execute("PRAGMA quick_check(1)").fetchone()[0].decode("utf-8", "replace")
    if verdict != "ok":
        raise Unreadable(f"{path}: damaged ({verdict.splitlines()[-1]}); {_remedy(path)}")


def _refuse_other_case(written: Mapping[str, str], own: Mapping[str, str], path: Path) -> None:
    if written["case"] != own["case"]:
        title = f" ({written['title']!r})" if written["title"] != own["title"] else ", or this case has been changed since"
        raise LedgerError(f"{path}: belongs to another case{title}; {_remedy(path)}")
    if written["origin"] != own["origin"]:
        changes = ", ".join(_changes(json.loads(written["versions"]), json.loads(own["versions"]))) or "code of the material"
        raise LedgerError(f"{path}: was written with another {changes}; install that again, or {_remedy(path)}")


def _changes(written: Mapping[str, str], own: Mapping[str, str]) -> Iterator[str]:
    for name in sorted(own):
        if written.get(name) != own[name]:
            yield "state of indentfit's code" if name == "code" else f"{name} ({written.get(name)}, now {own[name]})"


def _remedy(path: Path) -> str:
    return f"remove the folder {path.parent} and begin anew" if path.parent.name.endswith(".unfinished") else "leave out --reuse"


def _about(file: sqlite3.Connection, path: Path) -> dict[str, str]:
    facts = {}
    for name, value, checksum in file.execute("SELECT name, value, checksum FROM about"):
        if checksum != rows.checksum((name, value)).encode():
            raise LedgerError(f"{path}: damaged (its first lines fail their checksum); {_remedy(path)}")
        facts[name.decode()] = value.decode()
    if not {"case", "origin", "title", "versions"} <= set(facts):
        raise LedgerError(f"{path}: damaged (the ledger does not state its case); {_remedy(path)}")
    return facts


# Errors


@contextlib.contextmanager
def _in_words_of_the_ledger(path: Path) -> Iterator[None]:
    """Context that turns SQLite's errors into LedgerErrors that say what to do."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        raise _in_words(error, code, path) from error


def _in_words(error: sqlite3.Error, code: int, path: Path) -> LedgerError:
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return InUse(f"{path}: in use by another run; wait until it has ended, or choose another folder")
    if code == sqlite3.SQLITE_FULL:
        return LedgerError(f"{path}: the disk is full; make room, then go on with --resume")
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
        return Unreadable(f"{path}: damaged ({error}); {_remedy(path)}")
    return LedgerError(f"{path}: cannot be used ({error}); choose another folder")
