"""The pipeline as Prefect flows: a task opens, calls bella, records, returns.

Nothing of Prefect is imported before :func:`flows.environment.prepare` has told it where to live.
"""
