"""Who may write: a token in the header of the request, checked against the checksums in the catalogue."""

from typing import Annotated

from fastapi import Depends, Request

from api.errors import ForbiddenError, UnauthorisedError
from api.service import CatalogueHere, ServiceHere
from bella.catalogue import ANONYMOUS

HOW = "send it as the header 'Authorization: Bearer TOKEN'; the operator makes one with bella token create"


def _submitter(request: Request, service: ServiceHere, catalogue: CatalogueHere) -> str:
    """Id of the token of a request; `ANONYMOUS` where submissions are open and it has none.

    Raises
    ------
    UnauthorisedError
        Where a token is needed and there is none, or none that is known.
    ForbiddenError
        Where it was revoked.
    """
    header = request.headers.get("authorization")
    if header is None:
        if service.settings.open_submissions:
            return ANONYMOUS
        raise UnauthorisedError(f"this needs a token: {HOW}")
    scheme, _, secret = header.partition(" ")
    token = catalogue.token_of(secret.strip()) if scheme.lower() == "bearer" else None
    if token is None:
        raise UnauthorisedError(f"the token is not known: {HOW}")
    if token.revoked_utc is not None:
        raise ForbiddenError(f"token {token.token_id} was revoked: ask the operator for another one")
    return token.token_id


Submitter = Annotated[str, Depends(_submitter)]
