"""What is painted on the window's canvases."""
