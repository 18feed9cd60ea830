"""``python -m pipelines`` is the ``rauca`` command, for programs that start it as a module, such as torchrun."""

from .cli import run

run()
