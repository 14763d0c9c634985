"""Errors in plain words, each kind with its exit code."""

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


class AnyfaceError(Exception):
    """What went wrong and what would help; `kind` is a key of `EXIT_CODES`.

    `mends` name what the panel offers as buttons, see `ui.mending`.
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
