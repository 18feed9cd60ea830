"""The one exception a user may see as a plain sentence."""


class RaucaError(Exception):
    """A mistake or a fault the user can act on.

    The message is one line that names the file or option, says what is wrong and what to do.
    Command lines print it without a traceback and exit with code 2.
    """


class StoppedError(RaucaError):
    """Long work was asked to stop and kept what is done.

    Args:
        where: the folder, and how far it came.
    """

    def __init__(self, where: str) -> None:
        super().__init__(f"{where}; run the same command again to go on")
