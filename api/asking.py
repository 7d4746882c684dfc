"""What the form of a page asks, and what is wrong with it."""

from collections.abc import Container
from typing import Any

from fastapi import Request
from pydantic import ValidationError

from api.errors import worded
from bella.exceptions import InputError


def asked_of(request: Request, lists: Container[str] = ()) -> dict[str, Any]:
    """Query of the address, as the form of a page writes it: with empty fields, lists repeated.

    Parameters
    ----------
    request : Request
    lists : container of str
        Names of the fields that may be repeated.

    Returns
    -------
    dict
    """
    query = request.query_params
    return {name: query.getlist(name) if name in lists else query[name] for name in dict.fromkeys(query)}


def fault_words(error: InputError | ValidationError) -> str:
    """What is wrong with a question, in one line."""
    if isinstance(error, ValidationError):
        return "; ".join(worded({**fault, "loc": ("query", *fault["loc"])}) for fault in error.errors())
    return str(error)
