"""Output of the command line: tables, progress bars, messages on standard error, and exit statuses."""

import enum
import errno
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, Task, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from spinor_geom.files import printable

_WRAPPED = 20  # characters, the least width of a column that is broken into lines if it is wider


class ExitStatus(enum.IntEnum):
    """Exit statuses. `IMPERFECT` means that the results were written, but some need a check."""

    DONE = 0
    IMPERFECT = 1
    BAD_INPUT = 2
    INTERRUPTED = 130


def report_error(error: BaseException) -> ExitStatus:
    """Writes the message of an error that ended a command, and returns the exit status."""
    if isinstance(error, KeyboardInterrupt):
        complain("interrupted")
        return ExitStatus.INTERRUPTED
    try:  # otherwise the interpreter would report the same error again when it closes standard output
        sys.stdout.flush()
    except OSError:
        _discard_output()
    if isinstance(error, BrokenPipeError):
        return ExitStatus.DONE
    if isinstance(error, OSError) and error.filename is not None and error.strerror is not None:
        complain(f"{error.filename}: {error.strerror}")
    else:
        complain(" ".join(str(error).split()) or "there is not enough memory")
    return ExitStatus.BAD_INPUT


def _discard_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def complain(text: str) -> None:
    """Writes a message to standard error."""
    with suppress(OSError):  # closed
        sys.stderr.write(f"spinor-geom: {printable(text)}\n")


def show_table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str | Text]],
    *,
    piped: bool,
    optional: Sequence[str] = (),
    wrapped: str = "",
) -> None:
    """Writes a table to standard output: ruled on a terminal, else tab-separated lines if `piped`.

    If the terminal is too narrow, optional columns are left out, in the order of `optional`. The column `wrapped` is
    broken into lines.
    """
    console = Console()
    if console.is_terminal:
        rows = [list(row) for row in rows]
        widths = {name: max(map(len, (name, *column))) + 2 for name, *column in zip(columns, *rows, strict=True)}
        widths |= {wrapped: min(widths[wrapped], _WRAPPED)} if wrapped else {}
        for name in optional:
            if sum(widths.values()) > console.width:
                widths.pop(name, None)
        table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        for name in widths:
            table.add_column(name, no_wrap=name != wrapped)
        for row in rows:
            cells = [cell for name, cell in zip(columns, row, strict=True) if name in widths]
            # rich would interpret markup in a string
            table.add_row(*(cell if isinstance(cell, Text) else Text(cell) for cell in cells))
        # lines that are still too long are broken by the terminal. Rich would cut their numbers
        console.width = max(console.width, sum(widths.values()))
        console.print(table)
    elif piped:
        _write("".join("\t".join(map(str, row)) + "\n" for row in (columns, *rows)))


def show_lines(text: str, *, piped: bool) -> None:
    """Writes text to standard output: always on a terminal, else if `piped`."""
    if piped or sys.stdout.isatty():
        _write(text.rstrip("\n") + "\n")


def _write(text: str) -> None:
    """Writes to standard output. A closed pipe is no error, and any other OSError names standard output."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        if error.errno not in (errno.EPIPE, errno.EINVAL):  # EINVAL for a closed pipe on Windows
            error.filename = "standard output"
            raise
        _discard_output()


class _Count(MofNCompleteColumn):
    """The number done of the total, if the total is known."""

    def render(self, task: Task) -> Text:
        return Text() if task.total is None else super().render(task)


class ProgressBar:
    """A progress bar."""

    def __init__(self, bar: Progress, label: str) -> None:
        self._bar, self._label, self._task = bar, label, bar.add_task(label, total=None)

    def __call__(self, done: int, total: int, figures: str | None = None) -> None:
        """Shows the number done of the total, and optionally another label."""
        self._bar.update(self._task, completed=done, total=total, description=figures)

    def stage(self, text: str) -> None:
        """Adds the current stage to the label."""
        self._bar.update(self._task, description=f"{self._label} {text}")


@contextmanager
def progress(label: str) -> Iterator[ProgressBar]:
    """A progress bar on standard error while the context is open, and nothing without a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), _Count(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        yield ProgressBar(bar, label)
