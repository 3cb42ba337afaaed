"""Whole studies, headless: run, analyse again, sweep, replay."""
