"""The Analyse page: a folder's charts and trials; every number is computed in `experiments`."""
