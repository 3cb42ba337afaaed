"""Thousands of small studies with values drawn at random: in which share each statement holds, and what decides it."""
