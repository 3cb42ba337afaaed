"""The experiment: plan, trials, simulated operator, recordings, metrics, tables, figures; no hardware, no Qt."""

import core  # noqa: F401  (before numpy: it keeps sums to one thread)
