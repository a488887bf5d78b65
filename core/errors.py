"""The errors that coslobe raises on purpose: each carries its exit status and what to do next."""


class CoslobeError(Exception):
    """A failure with a message for a person, an exit status, and, where there is one, the next step.

    Attributes
    ----------
    hint : str or None
        What the user can do about it, one sentence.
    exit_status : int
        The status with which the command line ends (see the table in docs/commands.md).
    """

    exit_status = 1

    def __init__(self, message: str, hint: str | None = None) -> None:
        super().__init__(message)
        self.hint = hint


class UsageError(CoslobeError):
    """An option, argument or `--set` path that does not exist."""

    exit_status = 2


class InvalidInput(CoslobeError):
    """An input file that cannot be used; the message names file, place, value and the remedy."""

    exit_status = 3


class NoDevice(CoslobeError):
    """No usable OpenCL device."""

    exit_status = 4
