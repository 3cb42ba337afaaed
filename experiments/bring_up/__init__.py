"""Bringing a board up: one check after another, each with what to do where it fails; on any `RealDevice`."""
