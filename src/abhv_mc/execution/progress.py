"""Progress display on standard error: a bar or clock on a terminal, otherwise lines."""

import contextlib
import sys
import threading
import time
from types import TracebackType
from typing import Any, TextIO

from abhv_mc.io.messages import grouped_digits

# intervals in s between plain progress lines and between updates of the clock
_PLAIN_INTERVAL, _CLOCK = 10.0, 1.0
_printed = [time.monotonic()]  # time in s of the last plain line of any task


def _print_plain(line: str, stream: TextIO | None) -> None:
    """Print a line unless another line was printed in the last ten seconds."""
    if (now := time.monotonic()) - _printed[0] >= _PLAIN_INTERVAL:
        _printed[0] = now
        with contextlib.suppress(OSError):  # A full or closed log must not stop a campaign.
            print(line, file=stream, flush=True)


class Progress:
    """Context manager that displays the progress of a task with ``total`` steps."""

    def __init__(self, label: str, total: int, stream: TextIO | None = None) -> None:
        self._label, self._total = label, total
        self._stream = stream or sys.stderr  # sys.stderr is None if it was closed before the start
        self._done = 0
        self._start = time.monotonic()
        self._bar: Any = None

    def __enter__(self) -> "Progress":
        if self._total and self._stream is not None and self._stream.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            self._bar = Bar(
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[rate]}"),
                TimeRemainingColumn(),
                console=Console(file=self._stream),
            )
            self._bar.start()
            self._task = self._bar.add_task(self._label, total=self._total, rate="")
        return self

    def add(self, number: int) -> None:
        """Count ``number`` completed steps."""
        self._done += number
        now = time.monotonic()
        if self._bar is not None:
            self._bar.update(self._task, advance=number, rate=f"{self._rate(now):.0f}/s")
        else:
            self._print(now)

    @property
    def counts(self) -> tuple[int, int]:
        """Number of completed steps, and of all steps."""
        return self._done, self._total

    @property
    def pace(self) -> tuple[float, float]:
        """Steps per s, and remaining time in s (0 before the first step)."""
        rate = self._rate(time.monotonic())
        return rate, (self._total - self._done) / rate if rate > 0.0 else 0.0

    def say(self, line: str) -> None:
        """Print a line above the bar."""
        if self._bar is not None:
            self._bar.console.print(line, soft_wrap=True, highlight=False, markup=False)
        elif self._stream is not None:
            with contextlib.suppress(OSError):
                print(line, file=self._stream, flush=True)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        elif self._total:
            self._print(time.monotonic())

    def _rate(self, now: float) -> float:
        return self._done / max(now - self._start, 1e-9)

    def _print(self, now: float) -> None:
        rate = self._rate(now)
        remaining = (
            f"{(self._total - self._done) / rate:.0f} s left" if rate > 0.0 else "time left unknown"
        )
        share = 100 * self._done // self._total
        done, total = grouped_digits(self._done), grouped_digits(self._total)
        line = f"{self._label}: {done} of {total} ({share} %), {rate:.0f}/s, {remaining}"
        _print_plain(line, self._stream)


class Waiting:
    """Context manager that displays a task and its elapsed time."""

    def __init__(self, label: str, stream: TextIO | None = None) -> None:
        self._label, self._stream = label, stream or sys.stderr
        self._over = threading.Event()
        self._start = time.monotonic()

    @property
    def seconds(self) -> float:
        """Elapsed time in s."""
        return time.monotonic() - self._start

    def __enter__(self) -> "Waiting":
        if self._stream is not None:
            self._has_clock = self._stream.isatty()
            self._write(self._label)
            self._thread = threading.Thread(target=self._update, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._stream is not None:
            self._over.set()
            self._thread.join()
            if self._has_clock:
                self._write("\n")

    def _update(self) -> None:
        while not self._over.wait(_CLOCK):
            self._write(f"\r{self._label}: {self.seconds:.0f} s so far")

    def _write(self, text: str) -> None:
        if not self._has_clock:
            _print_plain(text.lstrip("\r"), self._stream)
            return
        with contextlib.suppress(OSError):
            print(text, end="", file=self._stream, flush=True)
