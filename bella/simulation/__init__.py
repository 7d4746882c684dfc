"""Synthetic bursts: a beam on a Parker spiral, its light curves, and what a receiver makes of them."""

from bella.simulation.burst import SimulatedBurst, true_arrivals
from bella.simulation.receiver import Receiver, observe

__all__ = ["Receiver", "SimulatedBurst", "observe", "true_arrivals"]
