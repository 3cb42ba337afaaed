"""What the participant sees and hears; no page of the main window."""
