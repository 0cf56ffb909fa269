"""What the command line says: tables and progress on a terminal, complaints in one sentence, exit statuses."""

import enum
import errno
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from spinor_geom.files import printable


class ExitStatus(enum.IntEnum):
    """What the shell is told; 1 for a mesh that was written but deserves a look."""

    DONE = 0
    IMPERFECT = 1
    BAD_INPUT = 2
    INTERRUPTED = 130


def ended_by(error: BaseException) -> ExitStatus:
    """What a command that ended by an error says, and its status; without a word where nobody reads any more."""
    if isinstance(error, KeyboardInterrupt):
        complain("interrupted")
        return ExitStatus.INTERRUPTED
    try:  # what standard output does not take any more the interpreter would complain of once more as it closes it
        sys.stdout.flush()
    except OSError:
        _discard_output()
    if isinstance(error, BrokenPipeError):
        return ExitStatus.DONE
    complain(sentence(error))
    return ExitStatus.BAD_INPUT


def _discard_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def sentence(error: BaseException) -> str:
    """An error as one line."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror is not None:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split()) or "there is not enough memory"


def complain(text: str) -> None:
    """Says one sentence on standard error."""
    with suppress(OSError):  # nobody can be told
        sys.stderr.write(f"spinor-geom: {printable(text)}\n")


def show_table(
    columns: Sequence[str], rows: Iterable[Sequence[str | Text]], *, piped: bool, optional: Sequence[str] = ()
) -> None:
    """Shows a table on standard output: ruled on a terminal, else tab-separated lines with a header if wanted piped.

    On a terminal that is too narrow for all columns the optional ones are left out, the first first.
    """
    console = Console()
    if console.is_terminal:
        rows = [list(row) for row in rows]
        widths = {name: max(map(len, (name, *column))) + 2 for name, *column in zip(columns, *rows, strict=True)}
        for name in optional:
            if sum(widths.values()) > console.width:
                widths.pop(name, None)
        table = Table(*widths, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        for row in rows:
            cells = [cell for name, cell in zip(columns, row, strict=True) if name in widths]
            # a bare string could hold what rich takes for markup
            table.add_row(*(cell if isinstance(cell, Text) else Text(cell) for cell in cells))
        console.print(table)
    elif piped:
        _write("".join("\t".join(map(str, row)) + "\n" for row in (columns, *rows)))


def show_lines(text: str, *, piped: bool) -> None:
    """Writes text to standard output: always on a terminal, on a pipe if wanted there."""
    if piped or sys.stdout.isatty():
        _write(text.rstrip("\n") + "\n")


def _write(text: str) -> None:
    """Writes to standard output at once, until nobody reads it any more; another OSError names it."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        if error.errno not in (errno.EPIPE, errno.EINVAL):  # the second on Windows
            error.filename = "standard output"
            raise
        _discard_output()


class ProgressBar:
    """A progress bar: called with the number of things done and of all, and a line of figures if there is one."""

    def __init__(self, bar: Progress, label: str) -> None:
        self._bar, self._label, self._task = bar, label, bar.add_task(label, total=None)

    def __call__(self, done: int, total: int, figures: str | None = None) -> None:
        """Shows how much is done."""
        self._bar.update(self._task, completed=done, total=total, description=figures)

    def stage(self, text: str) -> None:
        """Shows what is being done."""
        self._bar.update(self._task, description=f"{self._label} {text}")


@contextmanager
def progress(label: str) -> Iterator[ProgressBar]:
    """A progress bar on standard error while the block runs, on a terminal only."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        yield ProgressBar(bar, label)
