"""The device, its brakes and its controllers, simulated; the files that describe them."""

import os

# before numpy is imported: its sums over long trials (over 10,000 ticks) have other last digits with other threads
os.environ["OPENBLAS_NUM_THREADS"] = "1"
