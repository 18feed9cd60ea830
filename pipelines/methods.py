"""The optimizer's settings from the command line, those of a method of the literature among them."""

from __future__ import annotations

from typing import Any

import typer

from rauca_core.attack import OptimizerSettings
from rauca_core.attack.methods import settings_of


def chosen_settings(context: typer.Context) -> dict[str, Any]:
    """What `make_settings` takes: the command's options by name.

    With ``--method``, that method's settings take the place of defaults; what the user typed stands.

    Raises:
        RaucaError: no method of that name.
    """
    params = context.params.items()
    given = {name: value for name, value in params if name in OptimizerSettings.model_fields and value is not None}
    given["weights"] = tuple(context.params["weight"]) if context.params["weight"] else None
    method = given.pop("method", None)
    if method is None:
        return given
    typed = {name for name in context.params if _typed(context, name)}
    return {**given, **settings_of(method, **{name: given[name] for name in typed & set(given)})}


def _typed(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
