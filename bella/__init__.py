"""BELLA service: where was that radio burst, and how sure are we.

The rooms of this package hold the science and nothing of the service around it: importing any of them needs neither
Prefect nor FastAPI. Data flow one way: spectra, bursts, arrivals, localisations, track, record.
"""

__version__ = "0.2.0"
