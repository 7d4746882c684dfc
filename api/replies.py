"""What all replies have in common, and what all pages of a list say of the list."""

from pydantic import BaseModel, ConfigDict, Field

ORIGIN = "Where the data come from: archive, event, submission, user; or simulated, test."


class Reply(BaseModel):
    """Base of all replies."""

    model_config = ConfigDict(frozen=True)


class PageReply(Reply):
    """One page of a list."""

    total: int = Field(description="How many match, on all pages.")
    returned: int = Field(description="How many this page holds; of days, each origin counts.")
    truncated: bool = Field(description="True when more follow: go on at `next`.")
    next: str | None = Field(description="Address of the next page; null on the last.")
