"""Errors in plain words, each kind with its exit code."""

import errno
import re
import sys
import traceback

# Exit code of each kind, the same as those of the `anyface` command;
# nothing_moved and shots are our own.
EXIT_CODES = {
    "input": 3,
    "audio": 4,
    "mesh": 5,
    "face": 6,
    "weights": 7,
    "file": 8,
    "cancelled": 9,
    "internal": 10,
    "nothing_moved": 11,
    "shots": 12,
    "memory": 13,
}

# Control characters other than tabs and line breaks, and those that turn the direction of writing.
_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


class AnyfaceError(Exception):
    """What went wrong and what would help; `kind` is a key of `EXIT_CODES`.

    `mends` name the remedies that the panel offers as buttons, see `ui.mending`.
    """

    def __init__(self, kind: str, message: str, mends: tuple[str, ...] = ()):
        super().__init__(message)
        self.kind, self.mends = kind, mends

    @property
    def exit_code(self) -> int:
        """The exit code of the command for this kind of error."""
        return EXIT_CODES[self.kind]


class Cancelled(AnyfaceError):
    """The artist asked to stop."""

    def __init__(self):
        super().__init__("cancelled", "cancelled")


_NO_ROOM = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
_LONGEST = 400


def plain(error: BaseException) -> AnyfaceError:
    """Turns any exception into an error that says what happened and what to do next.

    The traceback of a fault goes to the console, so that it can be reported.
    """
    if isinstance(error, AnyfaceError):
        return error
    known = _known(error)
    if known is None:
        _show(error)
        text = f"{type(error).__name__}: {readable(error)}"
        known = AnyfaceError(
            "internal",
            f"{text}: a fault of Anyface; try it again, and if it comes back report it with what "
            "the console says",
        )
    known.__cause__ = error
    return known


def details(error: AnyfaceError) -> str:
    """The traceback of a fault that `plain` has put into words; "" for any other error."""
    cause = error.__cause__
    if error.kind != "internal" or cause is None:
        return ""
    lines = "".join(traceback.format_exception(cause))
    return lines.replace("\0", " ").encode("utf-8", "backslashreplace").decode("utf-8")


def readable(value) -> str:
    """`value` as text that can be shown and written anywhere, even if `value` is broken."""
    try:
        text = str(value)
    except Exception:
        text = f"a {type(value).__name__} without a text"
    text = text.replace("\0", " ").encode("utf-8", "backslashreplace").decode("utf-8").strip()
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def say(line: str, stream) -> None:
    """Prints a line in letters that the stream can encode; ignores a stream that cannot print.

    Nothing in it can steer a terminal, because names of files and objects may hold such characters.
    """
    try:
        encoding = getattr(stream, "encoding", None) or "utf-8"
        line = _STEERING.sub(lambda found: f"\\u{ord(found[0]):04x}", line)
        text = line.encode(encoding, "backslashreplace").decode(encoding)
        print(text, file=stream, flush=True)
    except (OSError, ValueError):
        return


def _known(error: BaseException) -> AnyfaceError | None:
    """An error in words of its own if the program is not at fault, otherwise None."""
    if isinstance(error, MemoryError):
        text = "the memory is full: close other programs, or take a shorter sound or a lighter mesh"
        return AnyfaceError("memory", text)
    if isinstance(error, KeyboardInterrupt):
        return AnyfaceError("cancelled", "interrupted: start it again when you like")
    if isinstance(error, SystemExit):
        return AnyfaceError("internal", f"the job stopped by itself ({error.code}): try it again")
    if isinstance(error, ReferenceError):
        text = "an object or a data-block of this job was deleted or undone: start again"
        return AnyfaceError("mesh", text)
    if isinstance(error, UnicodeError):
        text = f"a text holds letters that cannot be read or written ({readable(error)}): rename it"
        return AnyfaceError("input", text)
    return _of_file(error) if isinstance(error, OSError) else None


def _of_file(error: OSError) -> AnyfaceError:
    where = f"{readable(error.filename)}: " if error.filename is not None else ""
    what = readable(error.strerror or error)
    if error.errno in _NO_ROOM:
        return AnyfaceError("file", f"{where}{what}: make room on the disk, then try again")
    remedy = "see that it is there, and that it may be read and written"
    return AnyfaceError("file", f"{where}{what}: {remedy}")


def _show(error: BaseException) -> None:
    try:
        traceback.print_exception(error)
        sys.stderr.flush()
    except Exception:
        # A program without a console has nowhere to show it.
        return
