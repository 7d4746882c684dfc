"""The catalogue over HTTP: REST, the posterior store read-only, and the pages."""

from bella.exceptions import require_extra

require_extra("fastapi")
