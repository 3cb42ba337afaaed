"""The Analyse page: a folder's charts, verdicts and trials; every number is computed in `experiments`."""
