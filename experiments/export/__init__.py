"""Recordings for other programs: BIDS-Motion and tidy CSV."""
