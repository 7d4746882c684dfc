"""Days and times as people write them, in an address or on the command line."""

from datetime import UTC, date, datetime

from bella.exceptions import InputError


def parse_day(text: str, name: str) -> date:
    """A day as a query or an option gives it.

    Parameters
    ----------
    name : str
        Of the parameter or option, for the message.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise InputError(f"{name}: {text[:40]!r} is not a day; write it as 2012-06-07") from error


def parse_utc(text: str | None, name: str) -> datetime | None:
    """UTC time from text; None stays None, a time without a zone is UTC.

    Parameters
    ----------
    name : str
        Of the parameter or option, for the message.

    Raises
    ------
    InputError
        If it is not a time.
    """
    if text is None:
        return None
    try:
        # a "+" in a query that nobody escaped arrives as a blank
        moment = datetime.fromisoformat(text.strip().replace(" +", "+"))
        return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    except (ValueError, OverflowError) as error:
        raise InputError(
            f"{name}: {text[:40]!r} is not a time; write a UTC time as 2012-06-07 or 2012-06-07T19:30:00Z"
        ) from error
