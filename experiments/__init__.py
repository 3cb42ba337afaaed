"""The experiment: plan, trials, simulated operator, recordings, metrics, tables, figures; no hardware, no Qt."""
