"""Call a function in a process of its own, which never imports the caller's main module."""

import pickle
import subprocess
import sys
from collections.abc import Callable
from subprocess import CalledProcessError
from typing import TypeVar

from rattle.numerics import child_process_environment

__all__ = ["CalledProcessError", "answer_call_from_stdin", "call_in_subprocess"]

Answer = TypeVar("Answer")


def call_in_subprocess(function: Callable[..., Answer], *arguments: object) -> Answer:
    """Call a function of a module in a process of its own.

    The call waits for the process: use a thread for each process that shall run at the same time.

    Parameters
    ----------
    function : Callable[..., Answer]
        A function at the top level of a module: pickle sends only the name of the module and the name of the function.
    *arguments : object
        The arguments of the function, which are pickled too.

    Returns
    -------
    Answer
        The result of the function.

    Raises
    ------
    Exception
        The error that the function raises.
    CalledProcessError
        The process was killed, or cannot import the function.
    """
    command = [sys.executable, "-c", f"from {__name__} import answer_call_from_stdin; answer_call_from_stdin()"]
    given = pickle.dumps((function, arguments))
    ran = subprocess.run(command, input=given, stdout=subprocess.PIPE, env=child_process_environment(), check=True)
    succeeded, found = pickle.loads(ran.stdout)
    if not succeeded:
        raise found
    answer: Answer = found
    return answer


def answer_call_from_stdin() -> None:
    """Read a pickled function and its arguments from stdin, call the function, write its result or error to stdout."""
    output, sys.stdout = sys.stdout.buffer, sys.stderr  # text that a library prints must not mix with the answer
    function, arguments = pickle.load(sys.stdin.buffer)
    try:
        answer = True, function(*arguments)
    except Exception as error:
        answer = False, error
    pickle.dump(answer, output)
