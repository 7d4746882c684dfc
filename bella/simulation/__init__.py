"""Simulated bursts and days of the simulator's own laws, as receivers record them and archives hold them."""

from bella.simulation.burst import SimulatedBurst, true_arrivals
from bella.simulation.receiver import Receiver, observe

__all__ = ["Receiver", "SimulatedBurst", "observe", "true_arrivals"]
