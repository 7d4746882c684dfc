"""
Read a running service
======================

A service keeps the answers about many bursts. Here one is started on this machine with the burst that comes with the
package; :class:`bella.client.Client` reads any other in the same way.
"""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path
from tempfile import mkdtemp

import bella
from bella.client import Client
from bella.exceptions import UnreachableError

# %%
# Start it: in a terminal these two lines are ``bella run --direct`` and ``bella serve``.
command = [str(Path(sys.executable).with_name("bella"))]
home = {**os.environ, "BELLA_HOME": mkdtemp(), "BELLA_DRAWS": "500"}
subprocess.run([*command, "run", "--direct"], env=home, check=True, capture_output=True)
with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = str(free.getsockname()[1])
server = subprocess.Popen(
    [*command, "serve", "--port", port], env=home, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
)
service = Client(f"http://127.0.0.1:{port}")

# %%
# Every burst of a year, with the answer about each, as an astropy table.
for _ in range(240):
    try:
        bursts = service.bursts(start="2012-01-01", stop="2013-01-01")
        break
    except UnreachableError:  # it is still starting
        time.sleep(0.5)
print(bursts["sentence"][0])
bursts["burst_id", "start_utc", "phi0_deg", "v_sw_km_s", "grade", "origin"]

# %%
# The track, and the posterior with all its draws.
burst_id = bursts["burst_id"][0]
print(service.track(burst_id)["frequency_mhz", "x_rsun", "y_rsun"][:3])
posterior = service.posterior(burst_id)
print(posterior["joint_draws"].sel(joint_parameter="phi0_deg").quantile([0.16, 0.5, 0.84]).to_numpy())

# %%
# The arrival times behind it, localised again on this machine with another preset.
arrivals = service.arrivals(burst_id)
again = bella.localise(arrivals[arrivals["frequency_mhz"].value > 0.8], preset="robust", draws=200)
figure = again.plot()

# %%
server.terminate()
server.wait()
