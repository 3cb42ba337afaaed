"""The verbs of the command line. What reads recordings, computes or draws is imported as its verb runs: 3 s for all."""
