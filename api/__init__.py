"""The catalogue over HTTP: REST, the posterior store read-only, and the pages."""
