"""From recordings to metrics, trials.csv, statistics, box plots and the report."""
